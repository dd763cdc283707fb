# ruff: noqa: E501 (the tables of mutations are read by their columns)
"""Mutations of valid inputs: bytes of anything, words of texts, members of zips. Deterministic for a seed."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable

from tests.faults.seeds import OBJ, PARTS, TRIANGLE, bundle, document, ply, png, scene, serialized

NUMBERS = [
    "nan",
    "inf",
    "-inf",
    "1e999",
    "-1",
    "0",
    "1e-45",
    "1e38",
    str(2**31),
    str(2**63),
    str(-(2**63)),
    "",
    "x",
    "0x10",
]
PLUGINS = ["sphere", "cube", "obj", "ply", "serialized", "instance", "shapegroup", "merge", "blender", "sdfgrid", "diffuse",
           "conductor", "mask", "bitmap", "envmap", "area", "point", "sunsky", "projector", "homogeneous", "path", "scene",
           "perspective", "thinlens", "batch", "hdrfilm", "../evil", "", "ellipsoids", "linearcurve", "measured"]  # fmt: skip
VALUES = [
    None,
    True,
    -1,
    0,
    1e300,
    2**63,
    "",
    "x",
    [],
    [1, 2, 3],
    {},
    {"type": "sphere"},
    [[1]],
    {"type": "ref", "id": "ball"},
]
Input = tuple[str, bytes]

_RICH = (
    '<bsdf type="twosided" id="w"><bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf></bsdf>'
    '<shape type="sphere"><float name="radius" value="0.5"/><ref id="w"/></shape>'
    '<shape type="cube"><transform name="to_world"><translate x="2"/><rotate y="1" angle="30"/></transform>'
    '<bsdf type="roughconductor"><float name="alpha" value="0.2"/></bsdf></shape>'
    '<shape type="ply"><string name="filename" value="m.ply"/><ref id="w"/></shape>'
    '<shape type="obj"><string name="filename" value="m.obj"/><emitter type="area"><spectrum name="radiance" '
    'value="400:1, 700:2"/></emitter></shape>'
    '<shape type="disk"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">'
    '<string name="filename" value="t.png"/></texture></bsdf></shape>'
)


_FILES = (
    '<shape type="cube"><bsdf type="diffuse"><spectrum name="reflectance" filename="s.spd"/></bsdf></shape>'
    '<shape type="sphere"><bsdf type="conductor"><string name="material" value="My"/></bsdf></shape>'
    '<shape type="linearcurve"><string name="filename" value="c.txt"/></shape>'
    '<shape type="sdfgrid"><string name="filename" value="v.vol"/></shape>'
    '<shape type="ply"><string name="filename" value="m.ply"/><bsdf type="diffuse">'
    '<texture type="bitmap" name="reflectance"><string name="filename" value="t.png"/></texture></bsdf></shape>'
)


def seeds() -> list[Input]:
    """The valid inputs that mutations start from."""
    parts = {"m.ply": ply(3, 1, TRIANGLE), "m.obj": OBJ, "t.png": png(4, 4)}
    mesh = scene('<shape type="serialized"><string name="filename" value="m.serialized"/></shape>')
    ball = {"type": "sphere", "radius": 0.5, "center": [1, 0, 0], "bsdf": {"type": "plastic"}}
    placed = {"type": "cube", "to_world": [{"rotate": {"axis": [0, 1, 0], "angle": 30}}, {"scale": 0.5}]}
    return [
        ("a.xml", scene(_RICH.split('<shape type="ply">')[0])),
        ("b.zip", bundle({"scene.xml": scene(_RICH), **parts})),
        (
            "c.json",
            document(ball=ball, cube=placed, lamp={"type": "point", "intensity": {"type": "rgb", "value": [1, 2, 3]}}),
        ),
        ("d.zip", bundle({"scene.xml": mesh, "m.serialized": serialized(3, 1, TRIANGLE[:36] + bytes(12))})),
        ("e.zip", bundle({"scene.xml": scene(_FILES), **PARTS})),
    ]


def mutated(seed: int, canaries: list[str]) -> Input:
    """One mutated input. canaries: paths that it may ask for."""
    rng = random.Random(seed)
    name, content = rng.choice(seeds())
    for _ in range(rng.choice((1, 1, 2, 4))):
        if name.endswith(".zip") and rng.random() < 0.7:
            content = _in_zip(content, rng, canaries)
        elif name.endswith(".json") and rng.random() < 0.6:
            content = _in_document(content, rng, canaries)
        elif name.endswith(".xml") and rng.random() < 0.7:
            content = _in_text(content, rng, canaries)
        else:
            content = _in_bytes(content, rng)
    return name, content


def _in_bytes(content: bytes, rng: random.Random) -> bytes:
    made = bytearray(content)
    for _ in range(rng.randint(1, 8)):
        at = rng.randrange(len(made) + 1)
        span = rng.randint(1, 40)
        action = rng.randrange(4)
        if action == 0 and made:
            made[at % len(made)] = rng.randrange(256)
        elif action == 1:
            del made[at : at + span]
        elif action == 2:
            made[at:at] = made[at : at + span]
        else:
            made[at:at] = rng.randbytes(span)
    return bytes(made)


def _in_text(content: bytes, rng: random.Random, canaries: list[str]) -> bytes:
    text = content.decode("utf-8", "replace")
    actions: list[Callable[[], str]] = [
        lambda: _swap(text, r'value="[^"]*"', f'value="{rng.choice(NUMBERS)}"', rng),
        lambda: _swap(text, r'type="[^"]*"', f'type="{rng.choice(PLUGINS)}"', rng),
        lambda: _swap(text, r'name="[^"]*"', f'name="{rng.choice(("radius", "filename", "to_world", "a", ""))}"', rng),
        lambda: _swap(text, r'value="[^"]*"', f'value="{rng.choice(canaries)}"', rng),
        lambda: _swap(text, r"<(\w+) ", f"<{rng.choice(('include', 'path', 'ref', 'medium', 'default', 'float'))} ", rng),
        lambda: _swap(text, r"</\w+>", "", rng),
        lambda: _swap(text, r"(<shape.*?</shape>)", r"\1\1\1", rng),
        lambda: _swap(text, "</scene>", f'<include filename="{rng.choice(canaries)}"/></scene>', rng),
        lambda: _swap(text, "</scene>", f'<shape type="obj"><string name="filename" value="{rng.choice(canaries)}"/></shape></scene>', rng),
        lambda: _swap(text, "</scene>", _asking(rng.choice(canaries), rng), rng),
        lambda: _swap(text, r'(?<=filename" )value="[^"]*"', f'value="{rng.choice(canaries)}"', rng),
        lambda: _swap(text, "</scene>", f'<path value="{rng.choice(canaries).rpartition("/")[0]}"/></scene>', rng),
    ]  # fmt: skip
    return rng.choice(actions)().encode()


def _asking(name: str, rng: random.Random) -> str:
    """Something that asks for a file by its name."""
    shape, plain = '<shape type="cube">{}</shape></scene>', f'<string name="filename" value="{name}"/>'
    return rng.choice(
        (
            shape.format(f'<bsdf type="conductor"><string name="material" value="{name}"/></bsdf>'),
            shape.format(f'<bsdf type="roughconductor"><string name="material" value="{name}"/></bsdf>'),
            shape.format(f'<bsdf type="diffuse"><spectrum name="reflectance" filename="{name}"/></bsdf>'),
            shape.format(f'<bsdf type="measured">{plain}</bsdf>'),
            f'<default name="x" value="{name}"/><shape type="ply"><string name="filename" value="$x"/></shape></scene>',
            f'<emitter type="envmap">{plain}</emitter></scene>',
            *(
                f'<shape type="{kind}">{plain}</shape></scene>'
                for kind in ("ply", "linearcurve", "sdfgrid", "ellipsoids")
            ),
            shape.format(
                '<bsdf type="diffuse"><texture type="volume" name="reflectance">'
                f'<volume type="gridvolume" name="volume">{plain}</volume></texture></bsdf>'
            ),
        )
    )


def _swap(text: str, pattern: str, by: str, rng: random.Random) -> str:
    found = list(re.finditer(pattern, text, re.DOTALL))
    if not found:
        return text
    one = rng.choice(found)
    return text[: one.start()] + (one.expand(by) if "\\1" in by else by) + text[one.end() :]


def _in_zip(content: bytes, rng: random.Random, canaries: list[str]) -> bytes:
    import io
    import zipfile

    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            files = {name: archive.read(name) for name in archive.namelist()}
    except Exception:
        return _in_bytes(content, rng)
    if not files:
        return content
    name = rng.choice(list(files))
    action = rng.randrange(5)
    if action == 0:
        del files[name]
    elif action == 1:
        files[rng.choice((f"../{name}", f"/{name}", f"a/{name}", canaries[0], "plugins/sphere.so", "x" * 300))] = files[
            name
        ]
    elif name.endswith(".xml") and action < 4:
        files[name] = _in_text(files[name], rng, canaries)
    else:
        files[name] = _in_bytes(files[name], rng)
    return bundle(files)


def _in_document(content: bytes, rng: random.Random, canaries: list[str]) -> bytes:
    try:
        whole = json.loads(content)
    except ValueError:
        return _in_bytes(content, rng)
    at = whole
    while isinstance(at, dict) and at:
        key = rng.choice(list(at))
        if isinstance(at[key], dict) and at[key] and rng.random() < 0.7:
            at = at[key]
            continue
        action = rng.randrange(5)
        if action == 0:
            del at[key]
        elif action == 1:
            at[key] = rng.choice(VALUES)
        elif action == 2:
            at["type"] = rng.choice(PLUGINS)
        elif action == 3:
            at["filename"] = rng.choice(canaries)
        else:
            at[rng.choice(("radius", "to_world", "a", "", "a.b"))] = rng.choice(VALUES)
        break
    return json.dumps(whole).encode()
