"""Facts about rewriting: the image gets the size asked for, and any integrator of the file is put aside."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from renderer.backend import mitsuba
from renderer.errors import SceneError, SettingsError
from renderer.scene.compile import load_scene
from renderer.scene.report import inspect_scene
from renderer.scene.rewrite import check_size, neutralise_unused
from renderer.settings import Settings, image_size

CROP = {"crop_offset_x": 2, "crop_offset_y": 3, "crop_width": 10, "crop_height": 5}


def scene(film: dict[str, Any] | None = None, **nodes: Any) -> dict[str, Any]:
    film = {"type": "hdrfilm", "width": 40, "height": 30} if film is None else film
    return {"type": "scene", "sensor": {"type": "perspective", "film": film}, "sky": {"type": "constant"}, **nodes}


def size_of(source: dict[str, Any], width: int | None = None, height: int | None = None) -> tuple[int, int]:
    loaded = load_scene(source, settings=Settings(width=width, height=height))
    film = loaded.sensor.film()
    assert (loaded.width, loaded.height) == tuple(int(s) for s in film.crop_size())
    return loaded.width, loaded.height


@pytest.mark.parametrize(
    ("asked", "given"),
    [
        ((None, None), (40, 30)),
        ((40, 30), (40, 30)),
        ((8, 6), (8, 6)),
        ((8, 100), (8, 100)),
        ((20, None), (20, 15)),
        ((None, 15), (20, 15)),
        ((7, None), (7, 5)),
        ((1, None), (1, 1)),
        ((None, 1), (1, 1)),
    ],
)
def test_one_side_scales_the_other_and_two_are_taken_as_they_are(
    asked: tuple[int | None, int | None], given: tuple[int, int]
) -> None:
    assert size_of(scene(), *asked) == given


def test_a_narrow_film_never_loses_its_last_pixel() -> None:
    assert size_of(scene({"type": "hdrfilm", "width": 1000, "height": 1}), width=10) == (10, 1)


def test_a_film_without_a_size_has_mitsubas_own() -> None:
    assert size_of(scene({"type": "hdrfilm"})) == (768, 576)
    assert size_of(scene({"type": "hdrfilm"}), height=48) == (64, 48)


def test_a_crop_window_is_kept_where_no_size_is_asked_for() -> None:
    loaded = load_scene(scene({"type": "hdrfilm", "width": 40, "height": 30, **CROP}))
    film = loaded.sensor.film()
    assert (loaded.width, loaded.height) == (10, 5)
    assert tuple(film.crop_offset()) == (2, 3)
    assert tuple(film.size()) == (40, 30)


@pytest.mark.parametrize(
    ("asked", "size", "film", "offset"),
    [
        ((20, None), (20, 10), (80, 60), (4, 6)),
        ((None, 10), (20, 10), (80, 60), (4, 6)),
        ((10, 5), (10, 5), (40, 30), (2, 3)),
        ((30, 5), (30, 5), (120, 30), (6, 3)),
        ((5, None), (5, 2), (20, 12), (1, 1)),
    ],
)
def test_a_size_scales_a_crop_window_with_its_film(
    asked: tuple[int | None, int | None], size: tuple[int, int], film: tuple[int, int], offset: tuple[int, int]
) -> None:
    """What is pictured stays the same: also where the size asked for is the crop's own, as a checkpoint has it."""
    loaded = load_scene(scene({"type": "hdrfilm", "width": 40, "height": 30, **CROP}), settings=Settings(*asked))
    made = loaded.sensor.film()
    assert (loaded.width, loaded.height) == size == tuple(int(n) for n in made.crop_size())
    assert (tuple(made.size()), tuple(made.crop_offset())) == (film, offset)


@pytest.mark.parametrize("asked", [{"width": 200}, {"height": 200}, {"width": 200, "height": 200}, {}])
def test_every_door_gives_a_cropped_film_the_same_size(asked: dict[str, int]) -> None:
    """The package gave 200×100, the service 200×200."""
    film = {"type": "hdrfilm", "width": 400, "height": 200, "crop_width": 100, "crop_height": 100}
    source = scene(film | {"crop_offset_x": 50, "crop_offset_y": 20})
    found = inspect_scene(source)
    size = image_size((found["width"], found["height"]), asked.get("width"), asked.get("height"))
    assert size == ((200, 200) if asked else (100, 100))
    settings = Settings(asked.get("width"), asked.get("height"))
    first = load_scene(source, settings=settings)
    again = load_scene(source).sized(settings)
    for loaded in (first, again, load_scene(source, settings=Settings(*size))):
        assert (loaded.width, loaded.height) == size
        assert loaded.film == ([800, 400, 100, 40, 200, 200] if asked else [400, 200, 50, 20, 100, 100])


def test_a_crop_window_that_leaves_its_film_is_refused_at_every_size() -> None:
    film = {"type": "hdrfilm", "width": 40, "height": 30, **CROP, "crop_offset_x": 35}
    for width in (None, 10, 20, 7):
        with pytest.raises(SceneError, match=r"crop|Crop"):
            load_scene(scene(film), settings=Settings(width=width))


@pytest.mark.parametrize("film", [{"width": 16385, "height": 8}, {"width": 8, "height": 20000}])
def test_a_film_beyond_the_limit_is_refused_with_size_and_limit(film: dict[str, int]) -> None:
    with pytest.raises(SettingsError, match=rf"{film['width']}×{film['height']}.*1 to 16384"):
        load_scene(scene({"type": "hdrfilm", **film}))


def test_a_side_that_is_scaled_beyond_the_limit_is_refused() -> None:
    with pytest.raises(SettingsError, match=r"20000×16384"):
        load_scene(scene({"type": "hdrfilm", "width": 10000, "height": 8192}), settings=Settings(height=16384))


@pytest.mark.parametrize("size", [(0, 5), (5, 0), (-1, 5), (16385, 5)])
def test_sizes_outside_the_limits_are_refused(size: tuple[int, int]) -> None:
    with pytest.raises(SettingsError, match="each side must be from 1 to 16384"):
        check_size(*size)


def test_the_limits_themselves_are_allowed() -> None:
    check_size(1, 1)
    check_size(16384, 16384)


@pytest.mark.parametrize("inner", ["", '<integrator type="path"/><integer name="light_depth" value="4"/>'])
@pytest.mark.parametrize("plugin", ["prb", "moment", "of-a-friend"])
def test_any_integrator_of_a_file_is_put_aside_even_an_unknown_one(tmp_path: Path, plugin: str, inner: str) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(
        f'<scene version="3.0.0"><integrator type="{plugin}">{inner}</integrator><sensor type="perspective"/></scene>'
    )
    assert load_scene(path).width == 768


def test_a_sampler_of_a_file_is_never_loaded() -> None:
    sampler = (
        '<sampler type="blender"><integer name="verts" value="4096"/><integer name="vert_count" value="9"/></sampler>'
    )
    film = '<film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>'
    inner = f'<sensor type="perspective">{sampler}{film}</sensor><emitter type="constant"/>'
    state = mitsuba().parser.parse_string(
        mitsuba().parser.ParserConfig("llvm_ad_rgb"), f'<scene version="3.0.0">{inner}</scene>'
    )
    neutralise_unused(state)
    samplers = [node for node in state.nodes if node.type == mitsuba().ObjectType.Sampler]
    assert [(node.props.plugin_name(), list(node.props.keys())) for node in samplers] == [("independent", [])]


def test_a_loaded_scene_is_the_same_one_at_its_own_size_and_another_at_another() -> None:
    loaded = load_scene(scene())
    assert loaded.sized(Settings()) is loaded
    assert loaded.sized(Settings(width=40, height=30)) is loaded
    assert (loaded.sized(Settings(width=20)).width, loaded.sized(Settings(width=20)).height) == (20, 15)
    assert loaded.sized(Settings(width=20)).digest == loaded.digest


def test_the_scene_decides_what_the_settings_leave_open() -> None:
    loaded = load_scene(scene(integrator={"type": "path", "max_depth": 6}))
    resolved = loaded.resolved(Settings(seed=5), 16)
    assert (resolved.width, resolved.height, resolved.max_depth, resolved.replicate_size) == (40, 30, 6, 16)
    assert loaded.resolved(Settings(max_depth=2), 16).max_depth == 2
    assert loaded.resolved(Settings(max_depth=-1), 16).max_depth == -1
