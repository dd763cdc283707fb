"""Facts about sources: the digest identifies a scene's contents, and what cannot be read is refused with its place."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from renderer.backend import mitsuba
from renderer.errors import MergeError, SceneError
from renderer.estimate.estimate import merge
from renderer.progress import render
from renderer.scene.compile import load_scene
from renderer.scene.source import parse
from renderer.settings import Settings, Target
from tests.files import write_png

SHARED = Path(__file__).resolve().parents[4] / "shared" / "scenes"

XML = """<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="3"/></integrator>
  <sensor type="perspective">
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/></film>
  </sensor>
  <shape type="rectangle">
    <bsdf type="diffuse">
      <texture type="bitmap" name="reflectance"><string name="filename" value="t.png"/></texture></bsdf>
  </shape>
  <shape type="ply"><string name="filename" value="m.ply"/></shape>
  <emitter type="constant"/>
</scene>
"""
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 {z}
3 0 1 2
"""


def write_scene(folder: Path, xml: str = XML, *, grey: int = 100, z: float = 0.0) -> Path:
    """A scene with a texture and a mesh in files beside it."""
    folder.mkdir(exist_ok=True)
    write_png(str(folder / "t.png"), np.full((2, 2, 3), grey, np.uint8))
    (folder / "m.ply").write_text(PLY.format(z=z))
    (folder / "scene.xml").write_text(xml)
    return folder / "scene.xml"


def ball(**changes: Any) -> dict[str, Any]:
    """A ball under a constant sky, as a Mitsuba dictionary. `sensor__fov=30` changes one nested value."""
    mi = mitsuba()
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 3},
        "sensor": {
            "type": "perspective",
            "fov": 45.0,
            "to_world": mi.ScalarTransform4f().look_at([0, 0, -4], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 8, "height": 6, "filter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": 4},
        },
        "ball": {
            "type": "sphere",
            "radius": 1.0,
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.1, 0.2, 0.3]}},
        },
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}},
    }
    for path, value in changes.items():
        *inner, last = path.split("__")
        at = scene
        for key in inner:
            at = at[key]
        at[last] = value
    return scene


def look_from(z: float) -> Any:
    return mitsuba().ScalarTransform4f().look_at([0, 0, z], [0, 0, 0], [0, 1, 0])


def test_equal_dictionaries_have_one_digest() -> None:
    assert parse(ball()).digest == parse(ball()).digest
    assert len(parse(ball()).digest) == 64


def test_a_spectrum_changes_the_digest_with_any_of_its_numbers() -> None:
    def digest(*values: tuple[float, float]) -> str:
        return parse(ball(ball__bsdf__reflectance={"type": "spectrum", "value": list(values)})).digest

    rising = [(400.0, 0.1), (500.0, 0.1), (600.0, 0.9)]
    changed = [rising, rising[::-1], [(400.0, 0.9), *rising[1:]], [*rising[:2], (601.0, 0.9)]]
    changed[1] = [(w, v) for (w, _), (_, v) in zip(rising, reversed(rising), strict=True)]
    assert len({digest(*values) for values in changed}) == 4
    assert digest(*rising) == digest(*rising)
    uniform = [ball(ball__bsdf__reflectance={"type": "spectrum", "value": v}) for v in (0.5, 0.50000001)]
    assert parse(uniform[0]).digest != parse(uniform[1]).digest


def test_an_object_that_is_made_already_is_refused_with_what_would_do() -> None:
    made = mitsuba().load_dict({"type": "sphere"})
    with pytest.raises(SceneError, match="other is a Shape that is made already; give the dictionary"):
        load_scene(ball(other=made))


@pytest.mark.parametrize(
    "change",
    [
        {"ball__radius": 1.0 + 1e-12},
        {"ball__center": [0.0, 0.0, 1e-9]},
        {"ball__flip_normals": True},
        {"ball__type": "cube", "ball__radius": 1.0},
        {"ball__bsdf__reflectance__value": [0.1, 0.2, 0.30001]},
        {"ball__bsdf__type": "plastic", "ball__bsdf__reflectance": None},
        {"ball__to_world": "identity"},
        {"sky__radiance__value": 2.0},
        {"sensor__fov": 45.5},
        {"sensor__to_world": "nearer"},
        {"sensor__film__filter": {"type": "gaussian"}},
        {"sensor__film__crop_width": 4},
        {"second": {"type": "sphere"}},
    ],
    ids=lambda change: next(iter(change)),
)
def test_any_property_that_changes_changes_the_digest(change: dict[str, Any]) -> None:
    made = {"identity": mitsuba().ScalarTransform4f(), "nearer": look_from(-3.9)}
    values = {k: made[v] if isinstance(v, str) and v in made else v for k, v in change.items()}
    changed = ball(**values)
    if changed["ball"]["type"] == "cube":
        del changed["ball"]["radius"]
    if changed["ball"]["bsdf"].get("reflectance") is None:
        del changed["ball"]["bsdf"]["reflectance"]
    assert parse(changed).digest != parse(ball()).digest


def test_a_camera_that_moves_by_less_than_six_digits_still_changes_the_digest() -> None:
    assert parse(ball(sensor__to_world=look_from(-4.000001))).digest != parse(ball()).digest


@pytest.mark.parametrize("value", [[0.1, 0.2, 0.3 + 1e-7], [0.1, 0.2, 0.3 + 1e-12]])
def test_a_colour_that_changes_by_less_than_six_digits_still_changes_the_digest(value: list[float]) -> None:
    assert parse(ball(ball__bsdf__reflectance__value=value)).digest != parse(ball()).digest


@pytest.mark.parametrize(
    "change",
    [
        {"sensor__film__width": 16},
        {"sensor__film__height": 1},
        {"sensor__film__component_format": "float32"},
        {"integrator__max_depth": 9},
        {"integrator": {"type": "direct"}},
        {"sensor__sampler__sample_count": 64},
        {"sensor__sampler": {"type": "stratified"}},
    ],
    ids=lambda change: next(iter(change)),
)
def test_film_size_integrator_and_sampler_are_no_part_of_the_scene(change: dict[str, Any]) -> None:
    assert parse(ball(**change)).digest == parse(ball()).digest


def test_a_scene_has_the_same_digest_in_any_folder(tmp_path: Path) -> None:
    a, b = write_scene(tmp_path / "a"), write_scene(tmp_path / "b")
    assert parse(a).digest == parse(b).digest == parse(str(a)).digest


def test_comments_and_white_space_are_no_part_of_the_scene(tmp_path: Path) -> None:
    a = write_scene(tmp_path / "a")
    b = write_scene(tmp_path / "b", XML.replace("\n", "\n\n <!-- nothing -->"))
    assert parse(a).digest == parse(b).digest


def test_the_digest_follows_the_bytes_of_every_file_named(tmp_path: Path) -> None:
    digests = {
        parse(write_scene(tmp_path / "a")).digest,
        parse(write_scene(tmp_path / "b", grey=101)).digest,
        parse(write_scene(tmp_path / "c", z=1e-3)).digest,
    }
    assert len(digests) == 3


def test_a_touched_file_of_equal_bytes_changes_nothing(tmp_path: Path) -> None:
    path = write_scene(tmp_path / "a")
    before = parse(path).digest
    assert parse(write_scene(tmp_path / "a")).digest == before


def test_a_scene_is_named_after_its_file_or_its_folder(tmp_path: Path) -> None:
    path = write_scene(tmp_path / "kitchen")
    assert parse(path).name == "kitchen"
    assert parse(shutil.copy(path, path.with_name("night.xml"))).name == "night"
    assert parse("cornell-box").name == "cornell-box"


def test_parsing_leaves_no_folder_in_the_file_resolver(tmp_path: Path) -> None:
    resolver = mitsuba().file_resolver()
    before = [str(resolver[i]) for i in range(len(resolver))]
    load_scene(write_scene(tmp_path / "a"))
    with pytest.raises(SceneError):
        parse(write_scene(tmp_path / "b", "<scene"))
    assert [str(resolver[i]) for i in range(len(resolver))] == before


def test_files_are_found_beside_the_scene_and_not_in_the_last_scenes_folder(tmp_path: Path) -> None:
    load_scene(write_scene(tmp_path / "a"))
    other = write_scene(tmp_path / "b")
    (tmp_path / "b" / "t.png").unlink()
    with pytest.raises(SceneError, match=r"t\.png"):
        load_scene(other)


@pytest.mark.parametrize(
    ("source", "named"),
    [
        ("none.xml", r"none\.xml: no such file"),
        ("scene.obj", r"scene\.obj: a scene is an \.xml file"),
        ("teapot", r"no built-in scene is called \"teapot\".*cornell-box"),
    ],
)
def test_a_source_that_is_not_there_is_refused_with_what_would_do(source: str, named: str) -> None:
    with pytest.raises(SceneError, match=named):
        load_scene(source)


def test_a_folder_is_no_scene(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"a scene is an \.xml file|no built-in scene"):
        load_scene(tmp_path)


def test_a_folder_called_like_a_built_in_scene_does_not_hide_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "furnace").mkdir()
    monkeypatch.chdir(tmp_path)
    assert parse("furnace").name == "furnace"


@pytest.mark.parametrize(
    ("xml", "named"),
    [
        ("", r"scene\.xml:1: "),
        (XML.replace("</sensor>", ""), r"scene\.xml:12: "),
        (XML.replace('type="constant"', 'type="sunset"'), r"scene\.xml:11: .*sunset.*remove it or"),
        (XML.replace('type="constant"', 'type="sunsk"'), r"scene\.xml:11: .*did you mean sunsky"),
        (XML.replace('<integer name="width"', '<integer nam="width"'), r"scene\.xml:4: "),
        (XML.replace('value="8"', 'value="eight"'), r"scene\.xml:4: .*eight"),
        (XML.replace('<emitter type="constant"/>', '<ref id="gone"/>'), r"gone"),
        (XML.replace('value="t.png"', 'value="u.png"'), r"scene\.xml:8: .*u\.png.*is missing; put that file beside"),
        (XML.replace('value="m.ply"', 'value="n.ply"'), r"scene\.xml:10: .*n\.ply.*is missing; put that file beside"),
    ],
    ids=["empty", "unclosed", "plugin", "almost a plugin", "attribute", "number", "reference", "texture", "mesh"],
)
def test_a_faulty_scene_is_refused_with_its_place_and_cause(tmp_path: Path, xml: str, named: str) -> None:
    with pytest.raises(SceneError, match=named):
        load_scene(write_scene(tmp_path / "a", xml))


def test_a_broken_texture_is_refused_with_its_place(tmp_path: Path) -> None:
    path = write_scene(tmp_path / "a")
    (tmp_path / "a" / "t.png").write_bytes(b"not a picture")
    with pytest.raises(SceneError, match=r"scene\.xml:8: .*t\.png: cannot be read as a picture"):
        load_scene(path)


def test_a_misspelt_property_is_refused_as_mitsuba_does() -> None:
    # Reading a property marks it as used, so that reading them all for the digest hides the spelling mistake.
    with pytest.raises(SceneError, match="radios"):
        load_scene(ball(ball__radios=2.0))


def test_a_dictionary_without_a_scene_is_refused() -> None:
    for source in ({}, {"type": "sphere"}, {"type": "scene"}):
        with pytest.raises(SceneError, match="sensor"):
            load_scene(source)


def question(scene: dict[str, Any], settings: Settings) -> Any:
    return render(load_scene(scene, settings=settings), Target(spp=4), settings)


def test_an_image_with_hidden_lights_is_not_merged_with_one_that_shows_them() -> None:
    # The flag stands at the integrator, which is not digested; but it decides what the image shows.
    shown = question(ball(), Settings(seed=1))
    hidden = question(ball(integrator__hide_emitters=True), Settings(seed=2))
    assert not np.allclose(shown.mean, hidden.mean, rtol=0.2)
    with pytest.raises(MergeError):
        merge(shown, hidden)


def test_a_crop_window_and_a_whole_film_of_the_same_size_are_not_merged() -> None:
    cropped = ball(sensor__film__crop_width=4, sensor__film__crop_height=3)
    window = question(cropped, Settings(seed=1))
    whole = question(ball(sensor__film__width=4, sensor__film__height=3), Settings(seed=2))
    assert (window.width, window.height) == (whole.width, whole.height) == (4, 3)
    with pytest.raises(MergeError):
        merge(window, whole)


@pytest.mark.skipif(not SHARED.is_dir(), reason="there is no folder of shared scenes beside the checkout")
@pytest.mark.parametrize("name", ["cornell-box", "veach-mis"])
def test_scenes_from_elsewhere_have_the_same_digest_each_time(name: str) -> None:
    path = SHARED / name / "scene.xml"
    assert parse(path).digest == parse(path).digest
    assert parse(path).name == name
