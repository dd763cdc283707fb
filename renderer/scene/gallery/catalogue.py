"""The catalogue of built-in scenes, in the order in which they are shown."""

from __future__ import annotations

from renderer.errors import SceneError

from . import (
    caustic,
    cloudy_glass,
    cornell_box,
    fog,
    furnace,
    gap,
    glass_sky,
    many_lights,
    materials,
    plates,
    ring_sky,
    smoke,
)
from .gallery_scene import GalleryScene

_SCENES = (
    cornell_box.SCENE,
    plates.SCENE,
    materials.SCENE,
    ring_sky.SCENE,
    glass_sky.SCENE,
    caustic.SCENE,
    many_lights.SCENE,
    gap.SCENE,
    fog.SCENE,
    smoke.SCENE,
    cloudy_glass.SCENE,
    furnace.SCENE,
)


def list_scenes() -> tuple[GalleryScene, ...]:
    """All built-in scenes, easiest to read first."""
    return _SCENES


def find(name: str) -> GalleryScene:
    """The built-in scene of that name; SceneError names the known ones where there is none."""
    for scene in _SCENES:
        if scene.name == name:
            return scene
    known = ", ".join(scene.name for scene in _SCENES)
    raise SceneError(f'no built-in scene is called "{name}"; the gallery has {known}')
