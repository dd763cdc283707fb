"""The rewrites in order, each on or off: what enters is a parsed scene, what leaves is another, with notes on it."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import replace
from typing import Any

from renderer.errors import SceneError, SettingsError
from renderer.scene.geometry import bounds, children
from renderer.scene.requirements import Requirements
from renderer.scene.rewrite.emission import Unscalable
from renderer.scene.rewrite.faces import without_flat_faces
from renderer.scene.rewrite.film import neutralise_unused
from renderer.scene.rewrite.lights import without_dark_lights, without_flat_shapes
from renderer.scene.rewrite.similarity import MODERATE_SCALE, Similarity, apply, choose
from renderer.scene.source import Parsed

# Names by which they are switched off, in the order in which they run.
FLAT_SHAPES, DARK_LIGHTS, SIMILARITY, FLAT_FACES = "flat shapes", "dark lights", "similarity", "flat faces"
ALL = (FLAT_SHAPES, DARK_LIGHTS, SIMILARITY, FLAT_FACES)
_LEAST_SHARE = 0.1  # of flat faces, from which it is worth building the scene again without them
_TOLD_SCALE = 2.0**24  # a rescaling that is worth a note


def check_names(rewrites: Collection[str]) -> None:
    """Refuses names that are no rewrite's."""
    for name in rewrites:
        if name not in ALL:
            raise SettingsError(f"rewrite is {name!r}; choose from {', '.join(ALL)}")


def all_but(left_out: Collection[str]) -> tuple[str, ...]:
    """All rewrites except those named. Refuses names that are no rewrite's."""
    check_names(left_out)
    return tuple(name for name in ALL if name not in left_out)


def digest_with(digest: str, rewrites: Collection[str]) -> str:
    """The identity of a scene that some rewrites are switched off for: its pictures differ, if by little."""
    if set(rewrites) == set(ALL):
        return digest
    return hashlib.sha256(f"{digest}:{','.join(sorted(rewrites))}".encode()).hexdigest()


def before_loading(
    parsed: Parsed, needs: Requirements, rewrites: Collection[str]
) -> tuple[Parsed, Similarity, tuple[str, ...]]:
    """The parsed scene to load, how it lies to the one that was read, and notes on what was dropped or changed."""
    state: Any = parsed.state
    notes: list[str] = []
    if FLAT_SHAPES in rewrites:
        state, told = without_flat_shapes(state, parsed)
        notes += told
    if DARK_LIGHTS in rewrites and not needs.hide_emitters:  # a hidden light is seen once it is none
        state, told = without_dark_lights(state, parsed)
        notes += told
    similarity = Similarity()
    if SIMILARITY in rewrites:
        state, similarity, told = _placed(state, parsed)
        notes += told
    if state is parsed.state:
        from renderer.backend import mitsuba

        state = mitsuba().parser.ParserState(state)
    neutralise_unused(state)
    return replace(parsed, state=state), similarity, tuple(notes)


def after_loading(scene: Any, rewrites: Collection[str], name: str) -> tuple[str, ...]:
    """Changes a loaded Mitsuba scene in place and returns notes on it. Raises SceneError for a light without area."""
    if FLAT_FACES not in rewrites:
        return ()
    found, dropped = without_flat_faces(scene, _LEAST_SHARE)
    if not found:
        return ()
    for shape in scene.shapes():
        if shape.is_mesh() and shape.is_emitter() and not float(shape.surface_area()[0]) > 0:
            raise SceneError(
                f"{name}: the mesh {shape.id() or 'without a name'!r} is a light without area, which emits nothing; "
                "give it some size, or use a point or spot light"
            )
    what = "dropped" if dropped else "no ray can hit"
    return (f"{what} {found} triangles of zero area",)


def _placed(state: Any, parsed: Parsed) -> tuple[Any, Similarity, list[str]]:
    """The scene under the similarity that suits it, or as much of that as its plugins allow."""
    kept = {index for _, index in children(state, state.root)}
    wanted = choose(bounds([shape for shape in parsed.shapes if shape.index in kept]))
    notes, hindrance = [], ""
    moderate = min(max(wanted.scale, 1 / MODERATE_SCALE), MODERATE_SCALE)
    for tried in (wanted, Similarity(moderate, wanted.centre), Similarity(1.0, wanted.centre), Similarity()):
        try:
            made = apply(state, tried)
        except Unscalable as why:
            hindrance = hindrance or str(why)
            continue
        if hindrance and tried.scale == 1:
            notes.append(f"not rescaled: {hindrance}")
        if tried.centre != (0.0, 0.0, 0.0):
            notes.append("moved to the origin from " + ", ".join(f"{x:.7g}" for x in tried.centre))
        if tried.scale > _TOLD_SCALE or tried.scale < 1 or (hindrance and tried.scale != 1):
            more = f" and not by {wanted.scale:g}: {hindrance}" if hindrance else ""
            notes.append(f"rescaled by {tried.scale:g}{more}")
        return made, tried, notes
    raise AssertionError("the identity is always possible")
