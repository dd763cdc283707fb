"""Where files are looked for: in the scene's folder and in Mitsuba's own data; an upload's nowhere else."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import renderer
import renderer.scene.source as source
from renderer.backend import mitsuba, mitsuba_folder
from renderer.errors import SceneError
from renderer.scene.limits import UNTRUSTED
from renderer.scene.report import inspect_scene
from tests.faults.seeds import OBJ, scene

ROOT = Path(__file__).resolve().parents[3]
SPECTRUM = "400 0.5\n700 0.5\n"
METAL = '<shape type="cube"><bsdf type="{kind}"><string name="material" value="{name}"/></bsdf></shape>'
# Loads scenes from a working folder that holds whatever they name.
_REFUSALS = """
import sys
from pathlib import Path
from renderer.errors import SceneError
from renderer.scene.limits import UNTRUSTED
from renderer.scene.report import inspect_scene
for path in sorted(Path(sys.argv[1]).glob("*/scene.xml")):
    try:
        inspect_scene(path, UNTRUSTED)
        print("taken")
    except SceneError as error:
        print(str(error))
"""


def put(folder: Path, name: str, content: bytes | str) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def shape(kind: str, inner: str) -> str:
    return f'<shape type="{kind}">{inner}</shape>'


def naming(name: str) -> dict[str, str]:
    """Scenes that name a file in each way that there is."""
    file = f'<string name="filename" value="{name}"/>'
    texture = f'<texture type="bitmap" name="reflectance">{file}</texture>'
    return {
        "conductor": METAL.format(kind="conductor", name=name),
        "envmap": f'<emitter type="envmap">{file}</emitter>',
        "include": f'<include filename="{name}"/>',
        "obj": shape("obj", file),
        "roughconductor": METAL.format(kind="roughconductor", name=name),
        "spectrum": shape("cube", f'<bsdf type="diffuse"><spectrum name="reflectance" filename="{name}"/></bsdf>'),
        "texture": shape("cube", f'<bsdf type="diffuse">{texture}</bsdf>'),
        "volume": shape("sdfgrid", file),
    }


def test_the_wording_does_not_tell_which_files_of_the_working_folder_exist(tmp_path: Path) -> None:
    here = tmp_path / "here"
    for name in ("there.x", "data/ior/there.x.eta.spd", "data/ior/there.x.k.spd"):
        put(here, name, SPECTRUM)
    told = {}
    for name in ("there.x", "gone.x"):
        for kind, inner in naming(name).items():
            put(tmp_path, f"{name}/{kind}/scene.xml", scene(inner))
        command = [sys.executable, "-c", _REFUSALS, str(tmp_path / name)]
        done = subprocess.run(
            command, capture_output=True, text=True, cwd=here, env={"PYTHONPATH": str(ROOT)}, timeout=120
        )
        told[name] = [line.replace(name, "NAME") for line in done.stdout.splitlines()]
        assert len(told[name]) == len(naming(name)), done.stderr
    assert told["there.x"] == told["gone.x"]
    assert "taken" not in told["gone.x"]


def test_mitsuba_itself_looks_in_an_upload_and_its_own_data_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Should a name ever get past what is looked at before it."""
    elsewhere, seen, guarded = str(tmp_path / "elsewhere"), list[list[str]](), source.guarded

    def noting(*args: Any) -> Any:
        resolver = mitsuba().file_resolver()
        seen.append([str(resolver[i]) for i in range(len(resolver))])
        return guarded(*args)

    monkeypatch.setattr(source, "guarded", noting)
    path = put(tmp_path, "in/scene.xml", scene('<shape type="sphere"/>'))
    with source._file_resolver((str(mitsuba_folder()), elsewhere)):  # as where the process was started
        source.parse(path)
        source.parse(path, UNTRUSTED)
    mine, theirs = {*seen[0]}, {*seen[-1]}
    assert elsewhere in mine, "one's own scenes find what lies there"
    assert theirs == {str(mitsuba_folder()), str(path.parent)}


@pytest.mark.parametrize("kind", ["conductor", "roughconductor"])
def test_a_metal_is_one_of_mitsubas_or_lies_beside_the_scene(kind: str, tmp_path: Path) -> None:
    unknown = put(tmp_path, "a/scene.xml", scene(METAL.format(kind=kind, name="mine")))
    for limits in (UNTRUSTED, None):
        with pytest.raises(SceneError, match=r"scene\.xml:3: the material 'mine' is not known; choose one of Mitsuba"):
            inspect_scene(unknown, limits)
    inspect_scene(put(tmp_path, "b/scene.xml", scene(METAL.format(kind=kind, name="Au"))), UNTRUSTED)
    for part in ("eta", "k"):
        put(tmp_path, f"a/data/ior/mine.{part}.spd", SPECTRUM)
    inspect_scene(unknown, UNTRUSTED)


def test_a_metal_elsewhere_is_told_alike_whether_there_is_one(tmp_path: Path) -> None:
    told = set()
    for part in ("eta", "k"):
        put(tmp_path, f"outside/there.{part}.spd", SPECTRUM)
    for leads in (f"{tmp_path}/outside", "../../../outside"):
        for name in ("there", "gone"):
            path = put(tmp_path, "in/scene.xml", scene(METAL.format(kind="conductor", name=f"{leads}/{name}")))
            put(tmp_path, "in/data/ior/Own.eta.spd", SPECTRUM)
            with pytest.raises(SceneError) as refused:
                inspect_scene(path, replace(UNTRUSTED, root=path.parent))
            told.add(str(refused.value).replace(f"{leads}/{name}"[:80], "NAME"))
    assert len(told) == 1
    assert "the material 'NAME' is not known" in told.pop()


def test_no_file_of_a_scene_stands_in_for_mitsubas_own_data(tmp_path: Path) -> None:
    """A table that Mitsuba reads once serves all scenes of its process."""
    red = '<shape type="cube"><bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.1, 0.1"/></bsdf></shape>'
    gold = METAL.format(kind="conductor", name="Au")
    settings = renderer.Settings(width=8, height=6, colour="spectral")

    def rendered(path: Path) -> np.ndarray:
        loaded = renderer.load_scene(path, settings=settings)
        return renderer.render(loaded, renderer.Target(spp=16), settings).moments.mean

    for path in ("srgb.coeff", *(f"ior/Au.{part}.spd" for part in ("eta", "k"))):
        content = (mitsuba_folder() / "data" / path).read_bytes()
        for folder in ("dirty", "dirty/sub"):
            put(tmp_path, f"{folder}/data/{path}", SPECTRUM if path.endswith("spd") else bytes(len(content)))
    dirty = put(tmp_path, "dirty/scene.xml", scene('<path value="sub"/>' + red + gold))
    clean = put(tmp_path, "clean/scene.xml", scene(red + gold))
    assert np.array_equal(rendered(dirty), rendered(clean))


def test_files_of_ones_own_may_lie_where_the_process_was_started(tmp_path: Path) -> None:
    put(tmp_path, "m.obj", OBJ)
    code = "from renderer.scene.report import inspect_scene; print(inspect_scene('a/scene.xml')['triangles'])"
    put(tmp_path, "a/scene.xml", scene(naming("m.obj")["obj"]))
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT)},
        timeout=120,
    )
    assert done.stdout.strip() == "1", done.stderr


def test_an_upload_finds_its_own_files(tmp_path: Path) -> None:
    put(tmp_path, "sub/m.obj", OBJ)
    path = put(tmp_path, "scene.xml", scene('<path value="sub"/>' + naming("m.obj")["obj"]))
    assert inspect_scene(path, replace(UNTRUSTED, root=tmp_path))["triangles"] == 1
