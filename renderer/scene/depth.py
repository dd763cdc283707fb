"""What path depth is worth asking for."""

from __future__ import annotations

import math
from typing import Any

from renderer.backend import mitsuba
from renderer.scene.features import Features, has_bare_shape
from renderer.scene.vet.nodes import channels, properties

_REMAINDER = 1e-3  # of the light, that a limit may cost
_GLASS_DEPTH = 5  # in and out of one piece, the light behind it, and once more


def depth_advice(state: Any, max_depth: int, features: Features) -> str:
    """One sentence. max_depth: what the scene asks for, −1 unlimited."""
    if not features.reflects:
        return "Nothing reflects: depth 1 shows all the light there is."
    if features.has_transmission and 0 <= max_depth < _GLASS_DEPTH:
        return f"Light through glass needs depth {_GLASS_DEPTH} or more; at {max_depth} it stays dark."
    if any(node.type == mitsuba().ObjectType.Medium for node in state.nodes):
        return "Light is scattered in a medium, often many times: leave the depth unlimited, roulette ends its paths."
    albedo = _highest_albedo(state)
    if albedo is None:
        return "Unlimited depth ends by roulette; a limit of 8 to 16 is enough for most scenes without glass."
    if albedo >= 1:
        return (
            f"A surface reflects {albedo:.3g} of the light: in a closed room the light would never fade; set a limit."
        )
    enough = max(2, math.ceil(math.log(_REMAINDER) / math.log(albedo)) + 1) if albedo > 0 else 1
    return f"The brightest surface reflects {albedo:.3g}: depth {enough} leaves less than 0.1 % of the light unseen."


def _highest_albedo(state: Any) -> float | None:
    """The highest reflectance if all BSDFs are diffuse with known ones, else None."""
    mi = mitsuba()
    found = [0.5 if has_bare_shape(state) else 0.0]  # Mitsuba's default
    for node in state.nodes:
        if node.type != mi.ObjectType.BSDF or node.props.plugin_name() == "twosided":
            continue
        value = dict(properties(node)).get("reflectance", 0.5)
        if node.props.plugin_name() != "diffuse" or "Reference" in type(value).__name__:
            return None
        values = channels(value)
        if values is None or not values.size:
            return None
        found.append(float(values.max()))
    return max(found)
