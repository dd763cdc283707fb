"""What callers do otherwise than meant: threads, other variants, wrong kinds of values. Right, or one sentence."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import renderer
from renderer.backend import mitsuba
from renderer.errors import SceneError, SettingsError, UnsupportedScene
from renderer.scene.files.mesh import read_mesh
from renderer.settings import Settings, Target

ROOT = Path(__file__).resolve().parents[2]
SMALL = Settings(width=16, height=16)
ONE = Target(spp=4)
BALL: dict[str, Any] = {"type": "scene", "sensor": {"type": "perspective"}, "b": {"type": "sphere"}}

THREADS = """
import threading, renderer
said, seen = [], {}
def go(name, seed):
    try:
        settings = renderer.Settings(width=16, height=16, seed=seed)
        seen[name, seed] = float(renderer.render(name, renderer.Target(spp=16), settings).mean.sum())
    except BaseException as error:
        said.append(repr(error))
asked = [(name, seed) for seed in (0, 1) for name in ("furnace", "cornell-box", "caustic")]
threads = [threading.Thread(target=go, args=one) for one in asked]
[t.start() for t in threads]; [t.join() for t in threads]
together, seen = seen, {}
for one in asked: go(*one)
assert not said, said
assert together == seen, (together, seen)
print("the same")
"""


def test_renders_in_several_threads_take_turns_from_the_first_use_on() -> None:
    """They ended in AttributeErrors at first use, and with warmed scenes in a RuntimeError or SIGSEGV."""
    done = subprocess.run([sys.executable, "-c", THREADS], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout) == (0, "the same\n"), done.stderr[-2000:]


def test_a_variant_that_is_set_later_is_the_callers_own() -> None:
    code = """
import renderer, mitsuba
ask = lambda: renderer.render("cornell-box", renderer.Target(spp=4), renderer.Settings(width=8, height=8)).mean
before = ask()
for variant in ("scalar_rgb", "llvm_ad_spectral"):
    mitsuba.set_variant(variant)
    assert (ask() == before).all() and mitsuba.variant() == variant
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (None, r"scene\.x: None is no value for a scene; leave the entry out"),
        ({"type": "sphere", "radius": None}, r"scene\.x\.radius: None is no value"),
        (b"x", r"scene\.x: a bytes is no value"),
        (print, r"scene\.x: a builtin_function_or_method is no value"),
    ],
)
def test_values_that_end_mitsubas_reader_are_refused_by_place(value: Any, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        renderer.load_scene(BALL | {"x": value})


def test_objects_that_are_made_already_are_refused_by_a_sentence() -> None:
    mi = mitsuba()
    made = {"bsdf": {"type": "diffuse"}, "sensor": {"type": "perspective"}}
    for key, one in made.items():
        with pytest.raises(SceneError, match="made already; give the dictionary or file"):
            renderer.load_scene(BALL | {key: mi.load_dict(one)})
    with pytest.raises(SceneError, match="made already"):
        renderer.load_scene(BALL | {"m": mi.Mesh("m", 3, 1)})
    sources: tuple[Any, ...] = (mi.load_dict(BALL), 5, None)
    for source in sources:
        with pytest.raises(SceneError, match="give a file, a gallery name, or the dictionary"):
            renderer.load_scene(source)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"target": 16}, "target is 16; give a Target"),
        ({"settings": {"width": 8}}, "settings are {'width': 8}; give Settings"),
        ({"start": "a.exr"}, "start is 'a.exr'; give an Estimate"),
    ],
)
def test_other_things_than_were_meant_are_told(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(SettingsError, match=said):
        renderer.render("furnace", **({"target": ONE, "settings": SMALL} | arguments))


def xml(tmp_path: Path, inner: str, film: str = "", up: str = "0,1,0", sensor: str = "") -> Path:
    path = tmp_path / "scene.xml"
    look = f'<transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="{up}"/></transform>'
    path.write_text(f'<scene version="3.0.0"><sensor type="perspective">{look}{film}{sensor}</sensor>{inner}</scene>')
    return path


def test_spectral_films_and_responses_are_refused_by_name_and_spoil_nothing(tmp_path: Path) -> None:
    """They passed the check of uploads, and could never be rendered."""
    spectrum = '<spectrum name="srf" value="400:1,700:1"/>'
    film = f'<film type="specfilm">{spectrum.replace("srf", "band")}</film>'
    for more, said in (({"film": film}, "specfilm"), ({"sensor": spectrum}, "srf")):
        source = xml(tmp_path, "", **more)
        for colour in ("auto", "spectral"):
            with pytest.raises(UnsupportedScene, match=said):
                renderer.load_scene(source, settings=Settings(colour=colour))
    assert renderer.render("cornell-box", ONE, Settings(width=8, height=8, colour="spectral")).mean.mean() > 0


def test_messages_about_scenes_say_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"'up' must not be parallel to the direction of sight"):
        renderer.load_scene(xml(tmp_path, "", up="0,0,1"))
    with pytest.raises(SceneError, match="keep one of constant, envmap and sunsky"):
        renderer.load_scene(xml(tmp_path, '<emitter type="constant"/><emitter type="constant"/>'))


HEAD = (
    b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
)
CORNERS = b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n"


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        (
            "quad.ply",
            HEAD + b"property list uchar int vertex_indices\nend_header\n" + CORNERS + b"4 0 1 2 3\n",
            "a face has 4 corners, and 3 are known; triangulate the mesh",
        ),
        (
            "quad.ply",
            HEAD.replace(b"ascii", b"binary_little_endian")
            + b"property list uchar int vertex_indices\nend_header\n"
            + np.arange(12, dtype="<f4").tobytes()
            + b"\x04"
            + np.arange(4, dtype="<i4").tobytes(),
            "a face has 4 corners",
        ),
        (
            "uv.ply",
            HEAD
            + b"property list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
            + CORNERS
            + b"3 0 1 2 6 0 0 1 0 1 1\n",
            "the list 'texcoord' of the faces is not known; leave it out",
        ),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\n", "negative indices"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1/-3 2/-2 3/-1\n", "negative indices"),
    ],
)
def test_meshes_that_mitsuba_does_not_read_are_refused_with_the_reason(name: str, data: bytes, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        read_mesh(data, name, name[-3:])


def test_a_render_that_stands_still_holds_no_other_thread_up() -> None:
    """Between two snapshots nobody waits for a generator that its caller has put aside."""
    waiting: Any = renderer.progressive("furnace", Target(spp=256), SMALL)
    next(waiting)
    found: list[float] = []
    other = threading.Thread(target=lambda: found.append(renderer.render("furnace", ONE, SMALL).spp))
    other.start()
    other.join(timeout=120)
    assert found == [4]
    waiting.close()
