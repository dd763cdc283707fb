"""Facts about requirements: what a scene asks for is counted, and what is not modelled is refused with its place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from renderer.errors import SceneError, UnsupportedScene
from renderer.scene.requirements import Requirements, measure, refuse_unsupported
from renderer.scene.source import parse
from renderer.settings import STOKES

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
        (
            '  <shape type="sphere">\n\n    <bsdf type="polarizer"/><medium type="homogeneous"/></shape>',
            r"scene\.xml:5: polarised light.*media.*polarizer",
        ),
        (
            '  <medium type="homogeneous" id="fog"/><bsdf type="mask"><bsdf type="retarder"/></bsdf>',
            r"scene\.xml:3: .*media.*retarder",
        ),
        ('  <integrator type="volprim_rf_basic"/>', r"scene\.xml:3: .*volprim_rf_basic"),
    ],
    ids=["polarised fog", "nested retarder", "radiance field"],
)
def test_what_is_not_modelled_is_refused_with_its_name_and_line(tmp_path: Path, inside: str, named: str) -> None:
    with pytest.raises(UnsupportedScene, match=named):
        refuse_unsupported(measure(parse(xml(tmp_path, inside))))


def test_a_refusal_of_a_dictionary_names_the_node() -> None:
    with pytest.raises(UnsupportedScene, match=r"film.*bands of a spectral film"):
        refuse_unsupported(measured(eye={"type": "perspective", "film": {"type": "specfilm"}}))


@pytest.mark.parametrize(
    ("parts", "asks"),
    [
        ({"pane": {"type": "polarizer"}}, "polarizer"),
        ({"ball": {"type": "sphere", "bsdf": {"type": "mask", "inner": {"type": "circular"}}}}, "circular"),
        ({"integrator": {"type": "stokes", "inner": {"type": "path", "max_depth": 3}}}, "stokes"),
        ({"ball": {"type": "sphere", "bsdf": {"type": "pplastic"}}}, None),
    ],
    ids=["polariser", "nested", "integrator", "what Mitsuba renders without, too"],
)
def test_what_asks_for_polarised_light_is_named(parts: dict[str, Any], asks: str | None) -> None:
    found = measured(**parts)
    assert found.polarised_by == asks
    assert (STOKES in found.channels, "polarisation" in found.features) == (asks is not None, asks is not None)
    refuse_unsupported(found)


def test_polarised_light_has_no_red_green_and_blue_alone() -> None:
    red = {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [1, 0, 0]}}}
    assert measured(ball=red).variant == "rgb"
    assert measured(ball=red, pane={"type": "polarizer"}).variant == "spectral"
    assert measured(pane={"type": "polarizer"}).variant == "mono"


def test_a_scene_without_a_sensor_is_refused_with_an_example() -> None:
    with pytest.raises(SceneError, match=r'no sensor.*<sensor type="perspective"/>'):
        measure(parse({"type": "scene", "sky": {"type": "constant"}}))


@pytest.mark.skipif(not SHARED.is_dir(), reason="there is no folder of shared scenes beside the checkout")
def test_veach_mis_has_the_depth_and_lights_of_its_file() -> None:
    found = measure(parse(SHARED / "veach-mis" / "scene.xml"))
    assert found.emitters == {"area": 3} or sum(found.emitters.values()) >= 3
    assert found.max_depth == 3


def test_what_no_audit_looks_for_is_said() -> None:
    parts: dict[str, Any] = {
        "glass": {"type": "sphere", "bsdf": {"type": "dielectric"}},
        "floor": {"type": "rectangle", "bsdf": {"type": "diffuse"}},
    }
    assert measured(**parts).unheard == ()
    assert "not looked for" in measured(**parts, pane={"type": "polarizer"}).unheard[0]
    assert measured(floor=parts["floor"], integrator={"type": "stokes", "inner": {"type": "path"}}).unheard == ()
