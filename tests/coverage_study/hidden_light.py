"""Scenes whose light arrives through clear glass, water or mirrors alone: what a camera's paths hardly ever find.

Lengths in metres. A closed white room, 2 m wide, whose only light is a small lamp (or the sun) behind something clear.
`NAMES` lists them; those with a size in millimetres have a square lamp of that size, and equal power whatever its size:
a large one, which camera paths find, gives the same light (`findable`). With "+" there is a dim lamp in plain sight, so
that a picture settles without the light that is hidden. In `REACHABLE` targets can be reached: lamps that are found
through the same glass, or, with "*", one in plain sight that outshines the hidden one.
"""

from __future__ import annotations

from typing import Any

from renderer.backend import mitsuba

SIDE = 32
SIZES_MM = (10.0, 1.0, 0.1)
KINDS = ("slab", "sphere", "mirror")
MORE_KINDS = ("solid", "frosted", "ground", "thin", "masked", "panes", "zoomed", "white", "polished", "coated", "dark")
NAMES = (*(f"{kind}-{size:g}mm" for kind in KINDS for size in SIZES_MM), "pane-sun", "pane-disk", "water")
MORE_NAMES = tuple(f"{kind}-1mm+" for kind in (*KINDS, *MORE_KINDS))
REACHABLE = ("slab-1600mm", "mirror-900mm", "slab-1mm*", "sphere-1mm*", "mirror-0.1mm*", "bare-10mm")
DIM, BRIGHT = 0.3, 300.0  # radiance of a lamp in plain sight
POWER = 3.0  # W per channel, of a lamp
FINDABLE = 0.06  # metres, of a lamp that camera paths find


def scene(name: str) -> dict[str, Any]:
    """One of NAMES, MORE_NAMES or REACHABLE."""
    return _made(name, None)


def findable(name: str) -> dict[str, Any]:
    """The scene of that name with a light large enough to be found, of the same power."""
    return _made(name, FINDABLE)


def _made(name: str, size: float | None) -> dict[str, Any]:
    bare_name = name.removesuffix("+").removesuffix("*")
    if bare_name == "water":
        parts = _water(1.0 if size is None else size / 0.0045)
    elif bare_name.startswith("pane-"):
        is_sun = bare_name == "pane-sun" and size is None
        parts = _pane("sun" if is_sun else "disk", 1.0 if size is None else 10.0)
    else:
        kind, in_mm = bare_name.split("-")
        own = float(in_mm.removesuffix("mm")) / 1000
        parts = lit_by(kind, own if size is None else max(own, size))
    if name[-1] in "+*":
        lamp = _area(DIM if name.endswith("+") else BRIGHT)
        parts["plain"] = {"type": "sphere", "center": [-0.6, 0.6, -0.6], "radius": 0.1, "emitter": lamp}
    return parts


def lit_by(kind: str, size: float) -> dict[str, Any]:
    """A scene of one of KINDS or MORE_KINDS with a lamp of any size, in metres."""
    kinds = {"slab": _slab, "sphere": _sphere, "mirror": _mirror, "bare": bare}
    return (kinds | _MORE)[kind](size)


def bare(size: float) -> dict[str, Any]:
    """The room with a lamp in plain sight."""
    parts = _slab(size)
    return {name: part for name, part in parts.items() if name not in ("top", "bottom")}


def instanced(name: str) -> dict[str, Any]:
    """A scene whose glass is placed by an instance."""
    parts = scene(name)
    glass = {key: parts.pop(key) for key in ("bulb", "hollow")}
    parts["group"] = {"type": "shapegroup", **glass}
    parts["placed"] = {"type": "instance", "group": {"type": "ref", "id": "group"}}
    return parts


def _room(camera: dict[str, Any], parts: dict[str, Any], max_depth: int = 8) -> dict[str, Any]:
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": max_depth},
        "sensor": camera | {"film": {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}}},
        "room": {"type": "cube", "flip_normals": True, "bsdf": _grey(0.5)},
        **parts,
    }


def _camera(origin: tuple[float, ...], target: tuple[float, ...], fov: float = 60.0) -> dict[str, Any]:
    t: Any = mitsuba().ScalarTransform4f
    up = [0, 0, 1] if abs(target[0] - origin[0]) + abs(target[1] - origin[1]) > 1e-3 else [0, 1, 0]
    return {"type": "perspective", "fov": fov, "to_world": t().look_at(origin=origin, target=target, up=up)}


def _grey(reflectance: float) -> dict[str, Any]:
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": reflectance}}}


def _lamp(size: float, to_world: Any) -> dict[str, Any]:
    """A square that shines along its z axis with POWER."""
    return {
        "type": "rectangle",
        "to_world": to_world @ mitsuba().ScalarTransform4f().scale([size / 2, size / 2, 1]),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": POWER / (3.14159265 * size * size)}},
    }


def _slab(size: float) -> dict[str, Any]:
    """A lamp above a slab of glass that shuts off the room below, where the camera is."""
    t: Any = mitsuba().ScalarTransform4f
    return _room(
        _camera((0, -0.9, 0.2), (0, 0.3, -0.8), 70),
        {
            "lamp": _lamp(size, t().translate([0, 0, 0.8]).rotate([1, 0, 0], 180)),
            "top": _glass(t().translate([0, 0, 0.5]).scale([0.9999, 0.9999, 1]), 1.5),
            "bottom": _glass(t().translate([0, 0, 0.4]).rotate([1, 0, 0], 180).scale([0.9999, 0.9999, 1]), 1.5),
        },
    )


def _glass(to_world: Any, ior: float) -> dict[str, Any]:
    bsdf = {"type": "dielectric", "int_ior": ior, "ext_ior": 1.0}
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf}


def _sphere(size: float) -> dict[str, Any]:
    """A lamp in the air inside a hollow ball of glass."""
    t: Any = mitsuba().ScalarTransform4f
    glass = {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}
    hollow = {"type": "dielectric", "int_ior": 1.0, "ext_ior": 1.5}
    return _room(
        _camera((0, -0.9, 0.3), (0, 0.3, -0.5), 70),
        {
            "lamp": _lamp(size, t().translate([0, 0, 0.3]).rotate([1, 0, 0], 180)),
            "bulb": {"type": "sphere", "center": [0, 0, 0.3], "radius": 0.1, "bsdf": glass},
            "hollow": {"type": "sphere", "center": [0, 0, 0.3], "radius": 0.08, "bsdf": hollow},
        },
    )


def _mirror(size: float) -> dict[str, Any]:
    """A lamp that shines at a mirror, with a plate between it and what the camera sees."""
    t: Any = mitsuba().ScalarTransform4f
    return _room(
        _camera((0, -0.9, 0.2), (0, 0.3, -0.8), 70),
        {
            "lamp": _lamp(size, t().translate([0, 0, 0.5])),
            "shade": {
                "type": "rectangle",
                "to_world": t().translate([0, 0, 0.45]).scale(0.5),
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
            },
            "mirror": {
                "type": "rectangle",
                "to_world": t().translate([0, 0, 0.95]).rotate([1, 0, 0], 180).scale(0.9),
                "bsdf": {"type": "conductor", "material": "none"},
            },
        },
    )


def _pane(light: str, scale: float = 1.0) -> dict[str, Any]:
    """A dark room with a window pane under the sun: as a direction, or as a disk of half a degree far away, or `scale`
    times as large and as much less bright."""
    t: Any = mitsuba().ScalarTransform4f
    towards = [0.5, 0.4, -1.0]
    parts: dict[str, Any] = {
        "pane": {
            "type": "cube",
            "to_world": t().translate([0, 0, 1.0]).scale([0.5, 0.5, 0.01]),
            "bsdf": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0},
        },
        "lamp": {"type": "sphere", "center": [-0.6, 0.6, -0.6], "radius": 0.1, "emitter": _area(0.2)},
    }
    if light == "sun":
        parts["sun"] = {"type": "directional", "direction": towards, "irradiance": {"type": "rgb", "value": 3.0}}
    else:
        d = 200.0
        at = [-x * d for x in towards]
        radius = 0.0046 * d * 1.19 * scale
        parts["sun"] = {
            "type": "disk",
            "to_world": t().look_at(origin=at, target=[0, 0, 0], up=[0, 0, 1]).scale(radius),
            "emitter": _area(3.0 / (3.14159 * (0.0046 * scale) ** 2)),
        }
    made = _room(_camera((0, -0.9, 0.2), (0, 0.3, -0.8), 70), parts)
    made.pop("room")
    for name, axis, angle, side in (
        ("floor", [1, 0, 0], 0, [0, 0, -1]), ("left", [0, 1, 0], 90, [-1, 0, 0]), ("right", [0, 1, 0], -90, [1, 0, 0]),
        ("back", [1, 0, 0], 90, [0, 1, 0]), ("front", [1, 0, 0], -90, [0, -1, 0]),
    ):  # fmt: skip
        to_world = t().translate(side).rotate(axis, angle)
        made[name] = {"type": "rectangle", "to_world": to_world, "bsdf": _grey(0.5)}
    for name, at, sides in (
        ("above", [0, 0.75, 1], [1, 0.25, 1]), ("below", [0, -0.75, 1], [1, 0.25, 1]),
        ("beside", [0.75, 0, 1], [0.25, 0.5, 1]), ("besides", [-0.75, 0, 1], [0.25, 0.5, 1]),
    ):  # fmt: skip
        made[name] = {"type": "rectangle", "to_world": t().translate(at).scale(sides), "bsdf": _grey(0.5)}
    return made


def _area(radiance: float) -> dict[str, Any]:
    return {"type": "area", "radiance": {"type": "rgb", "value": radiance}}


def _water(scale: float = 1.0) -> dict[str, Any]:
    """A 5 × 4 mm lamp, or `scale` times as large, above water; the camera, in the air too, looks at the floor below."""
    t: Any = mitsuba().ScalarTransform4f
    lamp = _lamp(0.0045 * scale, t().translate([0, 0, 0.5]).rotate([1, 0, 0], 180).scale([1.118, 0.894, 1]))
    lamp["emitter"] = _area(POWER / (3.14159 * 0.005 * 0.004 * scale**2))
    return _room(
        _camera((0, -0.7, 0.7), (0, 0.1, -0.9), 60),
        {"lamp": lamp, "water": _glass(t().translate([0, 0, -0.3]).scale([0.9999, 0.9999, 1]), 1.33)},
    )


# ------------------------------ More of the kind ------------------------------


def _rough(alpha: float, inside: float = 1.5, outside: float = 1.0) -> dict[str, Any]:
    return {"type": "roughdielectric", "alpha": alpha, "int_ior": inside, "ext_ior": outside}


def _solid(size: float) -> dict[str, Any]:
    """The lamp cast into the glass."""
    parts = _sphere(size)
    parts.pop("hollow")
    return parts


def _frosted(size: float) -> dict[str, Any]:
    """The bulb in a globe of frosted glass."""
    globe = {"type": "sphere", "center": [0, 0, 0.3]}
    outer, inner = {"radius": 0.2, "bsdf": _rough(0.3)}, {"radius": 0.18, "bsdf": _rough(0.3, 1.0, 1.5)}
    return _sphere(size) | {"globe": globe | outer, "within": globe | inner}


def _ground(size: float) -> dict[str, Any]:
    """A slab whose lower side is ground."""
    parts = _slab(size)
    parts["bottom"]["bsdf"] = _rough(0.1)
    return parts


def _thin(size: float) -> dict[str, Any]:
    parts = _slab(size)
    parts.pop("top")
    parts["bottom"]["bsdf"] = {"type": "thindielectric"}
    return parts


def _masked(size: float) -> dict[str, Any]:
    """A curtain that lets a third of the light through, in place of glass."""
    parts = _slab(size)
    parts.pop("top")
    parts["bottom"]["bsdf"] = {"type": "mask", "opacity": 0.7, "bsdf": _grey(0.5)}
    return parts


def _panes(size: float) -> dict[str, Any]:
    """Four slabs, one below the other."""
    t: Any = mitsuba().ScalarTransform4f
    parts = _slab(size)
    for k, z in enumerate((0.3, 0.2, 0.1)):
        parts[f"top{k}"] = _glass(t().translate([0, 0, z]).scale([0.9999, 0.9999, 1]), 1.5)
        bottom = t().translate([0, 0, z - 0.05]).rotate([1, 0, 0], 180).scale([0.9999, 0.9999, 1])
        parts[f"bottom{k}"] = _glass(bottom, 1.5)
    return parts | {"integrator": {"type": "path", "max_depth": 20}}


def _zoomed(size: float) -> dict[str, Any]:
    """A view into a small part of what is lit."""
    parts = _slab(size)
    parts["sensor"] |= _camera((0.3, -0.5, -0.3), (0.35, 0.3, -1.0), 3)
    return parts


def _white(size: float) -> dict[str, Any]:
    """Walls that keep light for many bounces."""
    parts = _sphere(size)
    parts["room"]["bsdf"] = _grey(0.8)
    return parts | {"integrator": {"type": "path", "max_depth": -1}}


def _polished(size: float) -> dict[str, Any]:
    """A mirror that is not quite one."""
    parts = _mirror(size)
    parts["mirror"]["bsdf"] = {"type": "roughconductor", "material": "Al", "alpha": 0.005}
    return parts


def _coated(size: float) -> dict[str, Any]:
    """Black lacquer for a mirror."""
    parts = _mirror(size)
    black = {"type": "rgb", "value": 0.02}
    parts["mirror"]["bsdf"] = {"type": "plastic", "diffuse_reflectance": black}
    return parts


def _dark(size: float) -> dict[str, Any]:
    """Walls that keep hardly any light."""
    parts = _slab(size)
    parts["room"]["bsdf"] = _grey(0.02)
    return parts


_MORE = {
    **{"solid": _solid, "frosted": _frosted, "ground": _ground, "thin": _thin, "masked": _masked, "panes": _panes},
    **{"zoomed": _zoomed, "white": _white, "polished": _polished, "coated": _coated, "dark": _dark},
}
