"""Facts about channels: they are what Mitsuba's own aov integrator says of the same pixels."""

from __future__ import annotations

import numpy as np
import pytest

import renderer
from renderer import Settings
from renderer.backend import mitsuba
from tests.statistical.conftest import shared_scene

SIZE = 48
NAMES = ("albedo", "normal", "depth", "position", "shape_index")


def loaded(name: str, colour: str = "rgb") -> tuple[renderer.Scene, Settings]:
    """A scene, by gallery name or name of a shared scene, and its resolved settings."""
    known = {entry.name for entry in renderer.gallery.list_scenes()}
    source = name if name in known else shared_scene(name)
    scene = renderer.load_scene(source, settings=Settings(width=SIZE, height=SIZE, colour=colour))
    return scene, scene.resolved(Settings(width=SIZE, height=SIZE, seed=3), 16)


@pytest.mark.parametrize("name", ["cornell-box", "materials", "sdf-instance", "veach-ajar"])
def test_channels_agree_with_mitsubas_own(name: str) -> None:
    scene, settings = loaded(name)
    ours = scene.channels(settings, NAMES)
    mi = mitsuba()
    aov = mi.load_dict({"type": "aov", "aovs": "a:albedo,n:sh_normal,d:depth,p:position"})
    theirs = np.array(mi.render(scene.mitsuba_scene, sensor=scene.sensor, integrator=aov, spp=256, seed=1))[..., -10:]
    theirs[..., 6] = scene.similarity.original_distance(theirs[..., 6])  # ours are in the scene's own units
    is_whole = theirs[..., 6] > 0  # depth of pixels that are partly sky differs by convention
    for channel, part in (("albedo", slice(0, 3)), ("normal", slice(3, 6)), ("depth", slice(6, 7))):
        theirs_mean, ours_mean = theirs[..., part][is_whole].mean(axis=0), ours[channel][is_whole].mean(axis=0)
        scale = np.abs(theirs[..., part]).max()
        assert np.allclose(ours_mean, theirs_mean, atol=0.01 * scale), f"{channel}: {ours_mean}, aov {theirs_mean}"
        # Pixel by pixel: most pixels show one surface, on which no sample differs much.
        apart = np.abs(ours[channel] - theirs[..., part]).max(axis=-1)[is_whole]
        assert np.median(apart) < 0.02 * scale, f"{channel}: median difference {np.median(apart)}"


def test_positions_lie_at_their_depth_from_the_camera() -> None:
    scene, settings = loaded("cornell-box")
    found = scene.channels(settings, ("depth", "position"))
    eye = np.array(mitsuba().traverse(scene.sensor)["to_world"].matrix, np.float64).reshape(4, 4)[:3, 3]
    eye = scene.similarity.original_position(eye)
    distance = np.linalg.norm(found["position"] - eye, axis=-1)
    assert np.median(np.abs(distance - found["depth"][..., 0])) < 1e-3 * found["depth"].max()


def test_shape_indices_are_positions_in_the_scenes_list_and_minus_one_for_the_sky() -> None:
    scene, settings = loaded("glass-sky")
    index = scene.channels(settings, ("shape_index",))["shape_index"][..., 0]
    assert set(np.unique(index)) <= set(range(-1, len(scene.mitsuba_scene.shapes())))
    assert len(np.unique(index)) > 2
    assert (index == np.round(index)).all()


@pytest.mark.parametrize("colour", ["mono", "spectral"])
def test_geometry_does_not_depend_on_the_colour_model(colour: str) -> None:
    rgb, settings = loaded("cornell-box")
    other, other_settings = loaded("cornell-box", colour)
    a, b = rgb.channels(settings, NAMES), other.channels(other_settings, NAMES)
    for name in ("normal", "depth", "position"):
        assert np.array_equal(a[name], b[name]), name
    luminance = a["albedo"] @ np.array([0.2126, 0.7152, 0.0722])
    assert np.abs(b["albedo"] @ np.array([0.2126, 0.7152, 0.0722]) - luminance).mean() < 0.01
