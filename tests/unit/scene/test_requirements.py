"""Facts about requirements: what a scene asks for is counted, and what is not modelled is refused with its place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from renderer.errors import SceneError, UnsupportedScene
from renderer.scene.requirements import Requirements, measure, refuse_unsupported
from renderer.scene.source import parse

SHARED = Path(__file__).resolve().parents[4] / "shared" / "scenes"
SENSOR = {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}}


def measured(**nodes: Any) -> Requirements:
    return measure(parse({"type": "scene", "sensor": SENSOR, **nodes}))


def xml(tmp_path: Path, inside: str) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0">\n  <sensor type="perspective"/>\n{inside}\n</scene>\n')
    return path


def test_plugins_are_counted_by_kind() -> None:
    glass = {"type": "dielectric"}
    found = measured(
        a={"type": "sphere", "bsdf": glass},
        b={"type": "sphere", "bsdf": glass},
        c={"type": "rectangle", "bsdf": {"type": "diffuse"}, "emitter": {"type": "area"}},
        sky={"type": "constant"},
    )
    assert found.shapes == {"sphere": 2, "rectangle": 1}
    assert found.bsdfs == {"dielectric": 2, "diffuse": 1}
    assert found.emitters == {"area": 1, "constant": 1}
    assert found.warnings == ()


def test_a_scene_without_emitters_is_legal_but_odd() -> None:
    assert measured(a={"type": "sphere"}).warnings == ("no emitters: the image will be black",)


@pytest.mark.parametrize(
    ("integrator", "depth", "rr_depth", "hide"),
    [
        (None, -1, 5, False),
        ({"type": "path"}, -1, 5, False),
        ({"type": "path", "max_depth": 7, "rr_depth": 9, "hide_emitters": True}, 7, 9, True),
        ({"type": "path", "rr_depth": 0}, -1, 1, False),
        ({"type": "direct"}, 2, 5, False),
        ({"type": "volpath", "max_depth": 65}, 65, 5, False),
        ({"type": "aov", "aovs": "d:depth", "inner": {"type": "path", "max_depth": 4}}, 4, 5, False),
    ],
)
def test_what_the_scene_asks_of_its_integrator_is_kept(
    integrator: dict[str, Any] | None, depth: int, rr_depth: int, hide: bool
) -> None:
    found = measured(**({} if integrator is None else {"integrator": integrator}), sky={"type": "constant"})
    assert (found.max_depth, found.rr_depth, found.hide_emitters) == (depth, rr_depth, hide)


@pytest.mark.parametrize(
    ("inside", "named"),
    [
        ('  <medium type="homogeneous" id="fog"/>', r"scene\.xml:3: .*participating media.*homogeneous"),
        (
            '  <shape type="sphere">\n    <medium name="interior" type="heterogeneous">\n'
            '    <volume name="albedo" type="constvolume"/></medium></shape>',
            r"scene\.xml:4: .*participating media.*heterogeneous",
        ),
        (
            '  <shape type="sphere">\n\n    <bsdf type="polarizer"/></shape>',
            r"scene\.xml:5: .*polarised light.*polarizer",
        ),
        ('  <bsdf type="twosided"><bsdf type="retarder"/></bsdf>', r"scene\.xml:3: .*retarder"),
        ('  <integrator type="stokes"><integrator type="path"/></integrator>', r"scene\.xml:3: .*stokes"),
    ],
    ids=["medium", "medium in a shape", "polariser", "nested retarder", "stokes"],
)
def test_what_is_not_modelled_is_refused_with_its_name_and_line(tmp_path: Path, inside: str, named: str) -> None:
    with pytest.raises(UnsupportedScene, match=named):
        refuse_unsupported(measure(parse(xml(tmp_path, inside))))


def test_a_refusal_of_a_dictionary_names_the_node() -> None:
    with pytest.raises(UnsupportedScene, match=r"fog.*participating media"):
        refuse_unsupported(measured(fog={"type": "homogeneous"}))


def test_a_scene_without_a_sensor_is_refused_with_an_example() -> None:
    with pytest.raises(SceneError, match=r'no sensor.*<sensor type="perspective"/>'):
        measure(parse({"type": "scene", "sky": {"type": "constant"}}))


@pytest.mark.skipif(not SHARED.is_dir(), reason="there is no folder of shared scenes beside the checkout")
@pytest.mark.parametrize(
    ("name", "cause"),
    [("vol-cbox", "participating media"), ("hetvol", "participating media"), ("cbox-polarized", "polarised light")],
)
def test_scenes_from_elsewhere_that_need_more_are_refused_with_their_file(name: str, cause: str) -> None:
    with pytest.raises(UnsupportedScene, match=rf"scene\.xml:\d+: .*{cause}"):
        refuse_unsupported(measure(parse(SHARED / name / "scene.xml")))


@pytest.mark.skipif(not SHARED.is_dir(), reason="there is no folder of shared scenes beside the checkout")
def test_veach_mis_has_the_depth_and_lights_of_its_file() -> None:
    found = measure(parse(SHARED / "veach-mis" / "scene.xml"))
    assert found.emitters == {"area": 3} or sum(found.emitters.values()) >= 3
    assert found.max_depth == 3
