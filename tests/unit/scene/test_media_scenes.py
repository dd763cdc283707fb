"""Facts about scenes with media before they are rendered: what is refused, what is told, what stays out."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import renderer
from renderer.backend import mitsuba
from renderer.errors import SceneError, SettingsError
from renderer.scene.limits import UNTRUSTED, SceneLimits

NAN = float("nan")


def volume(values: Any, size: tuple[int, int, int, int] = (2, 2, 2, 1), bounds: Any = (0, 0, 0, 1, 1, 1)) -> bytes:
    """A volume file."""
    return b"VOL\x03" + struct.pack("<5i6f", 1, *size, *bounds) + np.asarray(values, "<f4").tobytes()


def load_with_grid(folder: Path, limits: SceneLimits | None = None) -> Any:
    """A scene with the grid that lies in the folder."""
    (folder / "scene.xml").write_text(
        '<scene version="3.0.0">\n<sensor type="perspective"/>\n<shape type="cube"><bsdf type="null"/>\n'
        '<medium name="interior" type="heterogeneous"><volume name="sigma_t" type="gridvolume">'
        '<string name="filename" value="smoke.vol"/></volume></medium></shape></scene>'
    )
    return renderer.load_scene(folder / "scene.xml", limits=limits)


@pytest.mark.parametrize(
    ("contents", "told"),
    [
        (volume([1, 1, 1, NAN, 1, 1, 1, 1]), "value number 3 is nan; values go from 0 to 1e\\+30"),
        (volume([1, 1, 1, 1, 1, 1, 1, -0.5]), "value number 7 is -0.5; values go from 0"),
        (volume([1, np.inf] * 4), "value number 1 is inf"),
        (volume([1, 3e38] * 4), "value number 1 is 3e\\+38"),
        (volume([1] * 7), "its header promises 2×2×2×1 values"),
        (volume([], (0, 2, 2, 1)), "its header promises 0×2×2×1 values"),
        (volume([1] * 8, (1 << 30, 1 << 30, 1 << 30, 3)), "its header promises 1073741824×"),
        (volume([1] * 8, bounds=(0, 0, 0, 1, 1, NAN)), "its bounds are"),
        (b"VOL\x03", "is no Mitsuba volume file"),
        (b"", "is no Mitsuba volume file"),
    ],
    ids=["NaN", "negative", "infinite", "huge value", "cut off", "empty", "lying size", "bounds", "header", "nothing"],
)
def test_a_grid_that_no_medium_can_have_is_refused_with_its_place(tmp_path: Path, contents: bytes, told: str) -> None:
    (tmp_path / "smoke.vol").write_bytes(contents)
    with pytest.raises(SceneError, match=rf"scene\.xml:4: .*{told}"):
        load_with_grid(tmp_path)


def test_a_grid_beyond_the_memory_limit_is_refused_before_it_is_read(tmp_path: Path) -> None:
    side = 1024
    (tmp_path / "smoke.vol").write_bytes(volume([], (side, side, side, 1)))
    with (tmp_path / "smoke.vol").open("r+b") as file:
        file.truncate(48 + 4 * side**3)  # a file with a hole: it takes no room
    with pytest.raises(SceneError, match=r"4096 MiB of memory, and the limit is 2048 MiB"):
        load_with_grid(tmp_path, UNTRUSTED)


def scene(**more: Any) -> dict[str, Any]:
    return {"type": "scene", "sensor": {"type": "perspective"}, "sky": {"type": "constant"}, **more}


def grid(values: Any) -> dict[str, Any]:
    data = mitsuba().VolumeGrid(np.asarray(values, np.float32))
    return {"type": "heterogeneous", "sigma_t": {"type": "gridvolume", "grid": data}, "albedo": 0.5}


@pytest.mark.parametrize(
    ("medium", "told"),
    [
        ({"type": "homogeneous", "sigma_t": -1.0}, "sigma_t is -1; it cannot be negative"),
        ({"type": "homogeneous", "sigma_t": {"type": "rgb", "value": [1, -0.1, 1]}}, "sigma_t is -0.1"),
        ({"type": "homogeneous", "scale": -2.0}, "scale is -2"),
        ({"type": "homogeneous", "albedo": -0.5}, "albedo is -0.5"),
        ({"type": "homogeneous", "sigma_t": {"type": "constvolume", "value": -3.0}}, "value is -3"),
        ({**grid(np.ones((2, 2, 2))), "type": "homogeneous"}, "make the medium heterogeneous"),
        (grid(np.full((2, 2, 2), NAN)), "value number 0 is nan"),
    ],
    ids=["extinction", "one channel", "scale", "albedo", "constant volume", "grid for even", "grid in memory"],
)
def test_numbers_that_no_medium_can_have_are_refused(medium: dict[str, Any], told: str) -> None:
    with pytest.raises(SceneError, match=told):
        renderer.load_scene(scene(cloud={"type": "cube", "interior": medium}))


def test_grids_in_memory_tell_scenes_apart_and_serve_every_colour() -> None:
    clouds = [scene(cloud={"type": "cube", "interior": grid(np.full((2, 3, 4), v))}) for v in (0.1, 0.2)]
    digests = {renderer.load_scene(cloud).digest for cloud in clouds}
    assert len(digests) == 2
    assert renderer.load_scene(clouds[0]).colour == "mono"  # one channel is no colour
    coloured = scene(cloud={"type": "cube", "interior": grid(np.ones((2, 3, 4, 3)))})
    assert renderer.load_scene(coloured).colour == "rgb"
    assert renderer.load_scene(clouds[0], settings=renderer.Settings(colour="spectral")).colour == "spectral"


def test_what_an_integrator_without_media_means_is_told() -> None:
    fog = {"type": "cube", "interior": {"type": "homogeneous"}}
    told = renderer.load_scene(scene(cloud=fog, integrator={"type": "path"})).warnings
    assert any(re.match(r"integrator 'path': Mitsuba leaves media out", warning) for warning in told)
    told = renderer.load_scene(scene(cloud=fog, integrator={"type": "volpath"})).warnings
    assert not any("media" in warning for warning in told)


def test_a_scene_without_media_has_the_kernel_of_surfaces() -> None:
    from renderer.equation.path import PathKernel
    from renderer.equation.volume_path import VolumeKernel

    settings = renderer.Settings(width=8, height=8)
    for more, kind in (({}, PathKernel), ({"interior": {"type": "homogeneous"}}, VolumeKernel)):
        loaded = renderer.load_scene(scene(cloud={"type": "cube", **more}), settings=settings)
        assert type(loaded.kernel(loaded.resolved(settings, 4))) is kind


def test_a_lesson_says_that_it_knows_no_media() -> None:
    from renderer.lesson.pixel import Lesson

    loaded = renderer.load_scene(
        scene(cloud={"type": "cube", "interior": {"type": "homogeneous"}}), settings=renderer.Settings(colour="rgb")
    )
    with pytest.raises(SettingsError, match="participating media"):
        Lesson(loaded, 0, 0)


def test_a_scene_with_media_is_not_audited() -> None:
    from renderer.audit.run import is_needed

    mi = mitsuba()
    ball = {"type": "sphere", "bsdf": {"type": "dielectric"}, "to_world": mi.ScalarTransform4f().translate([0, 0, 3])}
    lamp = {"type": "point", "position": mi.ScalarPoint3f(0, 3, 0)}
    settings = renderer.Settings(width=8, height=8)
    for more, needed in (({}, True), ({"interior": {"type": "homogeneous"}}, False)):
        loaded = renderer.load_scene(scene(ball=ball | more, lamp=lamp, floor={"type": "rectangle"}), settings=settings)
        assert is_needed(loaded, loaded.resolved(settings, 4)) == needed
