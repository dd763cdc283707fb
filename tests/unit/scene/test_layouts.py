"""How people lay out what they zip, and how programs write file names: what is meant is found, and nothing else."""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import renderer
from renderer.errors import SceneError
from renderer.scene.bundle import LOCAL_LIMITS, unpack
from renderer.scene.limits import UNTRUSTED
from renderer.scene.source import parse
from renderer.scene.vet.references import meant
from tests.files import write_png

REPORTS = Path(__file__).resolve().parents[4] / "shared" / "reports"
ZIPS = sorted((REPORTS / "zips").glob("*.zip"))


def scene_with(texture: str, more: str = "") -> str:
    return f"""<scene version="3.0.0"><sensor type="perspective"><film type="hdrfilm">
<integer name="width" value="8"/><integer name="height" value="8"/></film></sensor><emitter type="constant"/>{more}
<shape type="rectangle"><bsdf type="diffuse"><texture name="reflectance" type="bitmap">
<string name="filename" value="{texture}"/></texture></bsdf></shape></scene>"""


def laid_out(root: Path, scene: str, texture: str, more: str = "", picture: str = "textures/checker.png") -> Path:
    """A scene file below `root`, and a picture there."""
    path = root / scene
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(scene_with(texture, more))
    (root / picture).parent.mkdir(parents=True, exist_ok=True)
    write_png(str(root / picture), np.full((4, 4, 3), 200, np.uint8))
    return path


@pytest.mark.skipif(not ZIPS, reason="the zips of public reports are not here")
@pytest.mark.parametrize("path", ZIPS, ids=lambda path: path.stem)
def test_zips_from_public_reports_render(path: Path, tmp_path: Path) -> None:
    estimate = renderer.render(path, renderer.Target(spp=4), renderer.Settings(width=16, height=16))
    assert estimate.mean.mean() > 0.1
    with path.open("rb") as file:  # as an upload
        bundle = unpack(file, path.name, tmp_path, LOCAL_LIMITS)
    assert parse(tmp_path / bundle.scene, replace(UNTRUSTED, root=tmp_path)).assets.texture_pixels > 0


@pytest.mark.parametrize(
    "texture",
    ["../textures/checker.png", "../Textures/CHECKER.PNG", r"..\textures\checker.png", "../textures/./checker.png"],
)
def test_textures_beside_the_folder_of_the_scene_are_found(tmp_path: Path, texture: str) -> None:
    path = laid_out(tmp_path, "scenes/scene.xml", texture)
    for limits in (None, replace(UNTRUSTED, root=tmp_path)):
        assert parse(path, limits).assets.texture_pixels == 16
    with pytest.raises(SceneError, match="outside the upload"):
        parse(path, UNTRUSTED)  # a scene that came without the folders around it


@pytest.mark.parametrize("texture", [r"textures\checker.png", "Textures/Checker.PNG", r"TEXTURES\checker.png"])
def test_slashes_and_case_of_other_systems_are_understood(tmp_path: Path, texture: str) -> None:
    """As .xml beside its files, as a zip, and as an upload; in XML and in JSON."""
    path = laid_out(tmp_path, "scene.xml", texture)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.write(path, "scene.xml")
        archive.write(tmp_path / "textures/checker.png", "textures/checker.png")
    (tmp_path / "room.zip").write_bytes(packed.getvalue())
    bitmap = {"type": "diffuse", "reflectance": {"type": "bitmap", "filename": texture}}
    document = {"type": "scene", "sensor": {"type": "perspective"}, "map": {"type": "rectangle", "bsdf": bitmap}}
    (tmp_path / "a.json").write_text(json.dumps(document))
    for source, limits in (
        (path, None),
        (path, UNTRUSTED),
        (tmp_path / "room.zip", None),
        (tmp_path / "a.json", UNTRUSTED),
    ):
        assert parse(source, limits).assets.texture_pixels == 16
    assert renderer.load_scene(path).mitsuba_scene.shapes()


def test_a_name_that_could_mean_two_files_means_none(tmp_path: Path) -> None:
    (tmp_path / "A.png").touch()
    (tmp_path / "a.PNG").touch()
    if len(list(tmp_path.iterdir())) < 2:
        pytest.skip("this file system does not tell case apart")
    assert meant("a.png", [tmp_path]) is None
    assert meant("A.png", [tmp_path]) == "A.png"


@pytest.mark.parametrize("texture", ["../../secret.png", "../../out/secret.png", r"..\..\secret.png"])
def test_what_lies_outside_the_bundle_stays_out_of_reach(tmp_path: Path, texture: str) -> None:
    root = tmp_path / "root"
    path = laid_out(root, "scenes/scene.xml", texture)
    write_png(str(tmp_path / "secret.png"), np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(SceneError, match="outside the upload"):
        parse(path, replace(UNTRUSTED, root=root))


def test_a_search_path_does_not_open_the_folder_above(tmp_path: Path) -> None:
    """From the scene's folder the name stays inside, from the added folder it does not."""
    root = tmp_path / "root"
    (tmp_path / "out").mkdir()
    write_png(str(tmp_path / "out/secret.png"), np.zeros((4, 4, 3), np.uint8))
    path = laid_out(root, "scenes/scene.xml", "../out/secret.png", more='<path value=".."/>')
    with pytest.raises(SceneError, match=r"outside the upload|is missing"):
        parse(path, replace(UNTRUSTED, root=root))


def test_xml_that_nothing_includes_is_not_looked_at(tmp_path: Path) -> None:
    path = laid_out(tmp_path, "scene.xml", "textures/checker.png")
    (tmp_path / "old.xml").write_text('<scene version="0.6.0"><film type="ldrfilm"/><bsdf type="phong"/></scene>')
    (tmp_path / "notes.xml").write_text("<!DOCTYPE x><x>")
    assert parse(path, UNTRUSTED).assets.texture_pixels == 16
    included = laid_out(tmp_path, "scene.xml", "textures/checker.png", more='<include filename="old.xml"/>')
    with pytest.raises(SceneError, match=r"old\.xml:1: the type 'ldrfilm'"):
        parse(included, UNTRUSTED)


def test_an_include_in_another_case_is_named(tmp_path: Path) -> None:
    path = laid_out(tmp_path, "scene.xml", "textures/checker.png", more='<include filename="Parts.xml"/>')
    (tmp_path / "parts.xml").write_text('<scene version="3.0.0"/>')
    if (tmp_path / "Parts.xml").exists():
        pytest.skip("this file system does not tell case apart")
    with pytest.raises(SceneError, match=r"'Parts\.xml' is missing; did you mean 'parts\.xml'"):
        parse(path, UNTRUSTED)
