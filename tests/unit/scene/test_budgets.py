"""What costs a scene's reader more than its sender is refused while it is counted, before Mitsuba sees any of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import renderer.scene.source as source
from renderer.errors import SceneError
from renderer.scene.bundle import BundleError, Limits, unpack
from renderer.scene.limits import UNTRUSTED
from renderer.scene.report import inspect_scene
from renderer.scene.vet.budget import Budget
from tests.faults.seeds import bundle, document, scene

BALL = '<shape type="sphere"/>'


def doubled(times: int, first: str = "x" * 64) -> str:
    steps = "".join(f'<default name="a{i + 1}" value="$a{i}$a{i}"/>' for i in range(times))
    return f'<default name="a0" value="{first}"/>{steps}'


XML: dict[str, tuple[Callable[[], str], str]] = {
    "a parameter doubled 40 times": (lambda: doubled(40), r"the value of value has \d+ characters"),
    "a parameter doubled and used as a name": (
        lambda: doubled(5) + '<shape type="sphere" id="$a5"/>',
        "the id has 2048 characters, and the limit is 1000",
    ),
    "many doubled parameters": (
        lambda: doubled(11) + '<shape type="sphere"><string name="q" value="$a11"/></shape>' * 300,
        "with its parameters put in place the scene is larger than 32 MiB",
    ),
    "too many parameters": (
        lambda: "".join(f'<default name="p{i}" value="1"/>' for i in range(1001)),
        "1000 parameters",
    ),
    "a parameter used too often": (
        lambda: '<default name="p" value="1"/>' + '<float name="$p" value="$p"/>' * 10_001,
        "used more than 20000 times",
    ),
    "a parameter with a long name": (lambda: f'<default name="{"p" * 101}" value="1"/>', "has 101 characters"),
    "a long id": (lambda: f'<bsdf type="diffuse" id="{"a" * 20_000_000}"/>', "the id has 20000000 characters"),
    "a long name": (lambda: f'<shape type="cube"><string name="{"a" * 2000}" value=""/></shape>', "the name has 2000"),
    "a long text": (
        lambda: f'<shape type="cube"><string name="a" value="{"a" * 20_000_000}"/></shape>',
        "the value of value has 20000000 characters, and the limit is 262144",
    ),
    "a long file name": (lambda: f'<include filename="{"a" * 500_000}"/>', "the value of filename has 500000"),
    "60,000 spheres": (lambda: BALL * 60_000, "more than 5000 shapes; put them into meshes"),
    "many materials": (lambda: '<bsdf type="diffuse"/>' * 30_000, "more than 20000 objects"),
    "many search folders": (lambda: "", "more than 50 folders"),
}


@pytest.mark.parametrize("what", XML)
def test_a_costly_scene_is_refused_before_mitsuba_reads_it(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inner, says = XML[what]
    text = inner()
    if what == "many search folders":
        for i in range(60):
            (tmp_path / f"{i}").mkdir()
        text = "".join(f'<path value="{i}"/>' for i in range(60))

    def never(*_: object) -> None:
        raise AssertionError("Mitsuba was asked to read it")

    monkeypatch.setattr(source, "guarded", never)
    path = tmp_path / "scene.xml"
    path.write_bytes(scene(text))
    with pytest.raises(SceneError, match=says) as refused:
        inspect_scene(path, UNTRUSTED)
    assert len(str(refused.value)) < 400


@pytest.mark.parametrize(
    ("inner", "says"),
    [
        ({f"s{i}": {"type": "sphere"} for i in range(5001)}, "more than 5000 shapes"),
        ({f"s{i}": {"type": "diffuse"} for i in range(20_001)}, "more than 20000 objects"),
        ({"ball": {"type": "sphere", "id": "a" * 1001}}, r"scene\.ball\.id: the id has 1001 characters"),
        ({"ball": {"type": "sphere", "x": "a" * 300_000}}, "the value of x has 300000 characters"),
        ({"ball": {"type": ["sphere"]}}, "name the plugin"),
    ],
)
def test_a_costly_document_is_refused_too(inner: dict[str, object], says: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    path.write_bytes(document(**inner))
    with pytest.raises(SceneError, match=says):
        inspect_scene(path, UNTRUSTED)


def test_values_in_a_document_are_no_objects(tmp_path: Path) -> None:
    colours = {f"c{i}": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.1, 0.2, 0.3]}} for i in range(4)}
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(json.loads(document(**colours))))
    source.parse(path, replace(UNTRUSTED, objects=8))


def test_lengths_are_those_that_mitsuba_will_have() -> None:
    budget = Budget(UNTRUSTED)
    budget.define("a", "12345", "here")
    budget.define("ab", "$a$a", "here")
    budget.define("a", "x" * 100, "here")  # the first one counts
    assert budget.text("value", "$a", "here") == 5
    assert budget.text("value", "-$ab$a.", "here") == 1 + 10 + 5 + 1
    assert budget.text("value", "$abc", "here") == 11, "the longest name that fits"
    assert budget.text("value", "$unknown and $", "here") == len("$unknown and $")


def test_ones_own_scenes_may_be_large(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_bytes(scene(BALL * 6000 + f'<bsdf type="diffuse" id="{"a" * 2000}"/>'))
    source.parse(path)


def test_a_zip_makes_no_more_folders_than_files(tmp_path: Path) -> None:
    deep = {f"{i}/{'/'.join('abcdefgh')}/m.obj": b"" for i in range(20)}
    packed = tmp_path / "a.zip"
    packed.write_bytes(bundle({"scene.xml": scene("")} | deep))
    with packed.open("rb") as file, pytest.raises(BundleError, match="more than 100 folders"):
        unpack(file, "a.zip", tmp_path / "in", Limits(files=100, unpacked_bytes=1 << 20, ratio=100))
    assert not (tmp_path / "in").exists()


@pytest.mark.parametrize(
    ("declared", "encoding"), [("cp1252", "cp1252"), ("windows-1252", "cp1252"), ("cp437", "cp437")]
)
def test_an_encoding_that_mitsuba_reads_otherwise_is_refused(declared: str, encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    text = (
        f'<?xml version="1.0" encoding="{declared}"?>' + scene('<bsdf type="diffuse" id="Gr\u00fcn"/>' + BALL).decode()
    )
    path.write_bytes(text.encode(encoding))
    with pytest.raises(
        SceneError, match=rf"scene\.xml: Mitsuba cannot read the text encoding {declared}; save it as UTF-8"
    ):
        inspect_scene(path, UNTRUSTED)
    path.write_bytes(text.replace("\u00fc", "u").encode(encoding))
    inspect_scene(path, UNTRUSTED)


@pytest.mark.parametrize("encoding", ["utf-8", "iso-8859-1", "utf-16"])
def test_encodings_that_mitsuba_knows_are_taken(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    text = (
        f'<?xml version="1.0" encoding="{encoding}"?>' + scene('<bsdf type="diffuse" id="Gr\u00fcn"/>' + BALL).decode()
    )
    path.write_bytes(text.encode(encoding))
    inspect_scene(path, UNTRUSTED)
