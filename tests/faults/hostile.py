# ruff: noqa: E501 (the tables of cases are read by their columns)
"""Hostile and broken inputs, each with the words that its error has to say. Every one is a small generator."""

from __future__ import annotations

import io
import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass

from tests.faults.seeds import (
    OBJ,
    SKY,
    TRIANGLE,
    bundle,
    document,
    meshed,
    ply,
    png,
    scene,
    serialized,
    smoky,
    textured,
)

MEBIBYTE = 1 << 20


@dataclass(frozen=True, slots=True)
class Hostile:
    """One input. says: a pattern that its error must match."""

    name: str
    file_name: str
    make: Callable[[], bytes]
    says: str


def _xml(name: str, inner: str | Callable[[], str], says: str) -> Hostile:
    return Hostile(name, "scene.xml", lambda: scene(inner() if callable(inner) else inner), says)


def _json(name: str, says: str, **inner: object) -> Hostile:
    return Hostile(name, "scene.json", lambda: document(**inner), says)


def _raw(name: str, file_name: str, make: Callable[[], bytes], says: str) -> Hostile:
    return Hostile(name, file_name, make, says)


def _zip(name: str, files: dict[str, bytes], says: str) -> Hostile:
    return Hostile(name, "scene.zip", lambda: bundle(files), says)


def _bomb() -> bytes:
    """One file of more than half of what a bundle may hold, packed a thousand to one."""
    return bundle({"scene.xml": scene(SKY), "zeros.obj": b"\0" * (260 * MEBIBYTE)})


def _lying_size() -> bytes:
    """A zip whose directory says that a file is small."""
    packed = bytearray(bundle({"scene.xml": scene(SKY), "m.obj": OBJ * 5000}))
    at = packed.rindex(b"PK\x01\x02")
    struct.pack_into("<I", packed, at + 24, 10)
    return bytes(packed)


def _damaged_lzma() -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("scene.xml", scene(SKY))
    damaged = bytearray(packed.getvalue())
    for i in range(45, 75):
        damaged[i] ^= 0xFF
    return bytes(damaged)


def _link() -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("scene.xml", scene(SKY))
        info = zipfile.ZipInfo("m.obj")
        info.external_attr = 0o120777 << 16
        archive.writestr(info, "/etc/passwd")
    return packed.getvalue()


def _nested(depth: int) -> str:
    return '<bsdf type="twosided">' * depth + '<bsdf type="diffuse"/>' + "</bsdf>" * depth


def _film(width: str, height: str = "8") -> str:
    inner = f'<integer name="width" value="{width}"/><integer name="height" value="{height}"/>'
    return f'<sensor type="perspective"><film type="hdrfilm">{inner}</film></sensor>'


def _filmed(name: str, width: str, says: str, height: str = "8") -> Hostile:
    return Hostile(name, "a.xml", lambda: scene("", sensor=_film(width, height)), says)


def _mesh(kind: str, value: str) -> str:
    return f'<shape type="{kind}"><string name="filename" value="{value}"/></shape>'


def _spectrum(file: str) -> str:
    inner = f'<spectrum name="reflectance" filename="{file}"/>'
    return f'<shape type="cube"><bsdf type="diffuse">{inner}</bsdf></shape>'


def _outside(name: str, value: str) -> Hostile:
    return _xml(f"path: {name}", _mesh("obj", value), "outside the upload")


XML = [
    _raw("empty file", "a.xml", lambda: b"", r"scene\.xml:1: not well-formed"),
    _raw("binary", "a.xml", lambda: bytes(range(256)) * 40, "not well-formed"),
    _raw("cut off", "a.xml", lambda: scene(SKY)[:-20], r"scene\.xml:\d+: not well-formed"),
    _raw("unknown encoding", "a.xml", lambda: b'<?xml version="1.0" encoding="klingon"?><scene/>', "encoding"),
    _raw("no scene", "a.xml", lambda: b"<html><body/></html>", "scene"),
    _raw("entities", "a.xml", lambda: b'<!DOCTYPE s [<!ENTITY a "aaaa">]><scene version="3.0.0">&a;</scene>', "DOCTYPE"),
    _raw("entity file", "a.xml", lambda: b'<!DOCTYPE s [<!ENTITY a SYSTEM "/etc/passwd">]><scene>&a;</scene>', "DOCTYPE"),
    _raw("no version", "a.xml", lambda: b"<scene></scene>", "version"),
    _raw("version of letters", "a.xml", lambda: b'<scene version="new"></scene>', "version"),
    _raw("version from the future", "a.xml", lambda: b'<scene version="99.0.0"></scene>', "sensor|version"),
    _xml("nested 1,000 deep", lambda: _nested(1000), "nested more than 32 deep"),
    _xml("nested 100,000 deep", lambda: _nested(100_000), "nested more than 32 deep"),
    _xml("300,000 elements", lambda: '<bsdf type="null"/>' * 300_000, "more than 20000 objects"),
    _xml("300,000 properties", lambda: '<bsdf type="null">' + '<float name="a" value="1"/>' * 300_000 + "</bsdf>", "more than 200000 elements"),
    _xml("a parameter doubled 40 times", lambda: '<default name="a0" value="aa"/>' + "".join(f'<default name="a{i + 1}" value="$a{i}$a{i}"/>' for i in range(40)), "characters, and the limit is"),
    _xml("attribute of a mebibyte", lambda: f'<shape type="{"a" * MEBIBYTE}"/>', "the type has 1048576 characters"),
    _xml("unknown plugin", '<shape type="teapot"/>', r"scene\.xml:3: the type 'teapot'"),
    _xml("plugin by path", '<shape type="../../evil"/>', "no plugin"),
    _xml("plugin by absolute path", '<shape type="/tmp/evil"/>', "no plugin"),
    _xml("plugin that reads memory", '<shape type="blender"><long name="verts" value="4096"/></shape>', "another program"),
    _xml("a mesh for a film", '<sensor type="perspective"><film type="ply"/></sensor>', "'ply' is no film"),
    _xml("plugin by parameter", '<default name="t" value="blender"/><shape type="$t"/>', "another program"),
    _xml("plugin of another kind", '<shape type="diffuse"/>', "diffuse"),
    _xml("a picture of nothing", '<shape type="cube"><bsdf type="diffuse"><texture type="bitmap" name="reflectance"/></bsdf></shape>', "'bitmap' has no filename"),
    _xml("a blend by a picture of nothing", '<shape type="cube"><bsdf type="blendbsdf"><texture type="bitmap" name="weight"/><bsdf type="diffuse"/><bsdf type="diffuse"/></bsdf></shape>', "'bitmap' has no filename"),
    _xml("unknown tag", "<shader/>", "shader"),
    _xml("misspelt property", '<shape type="sphere"><float name="radios" value="1"/></shape>', "radios"),
    _xml("a word for a number", '<shape type="sphere"><float name="radius" value="big"/></shape>', r"scene\.xml:3: .*big"),
    _xml("not a number", '<shape type="sphere"><float name="radius" value="nan"/></shape>', "nan|finite"),
    _xml("infinity", '<shape type="sphere"><float name="radius" value="1e999"/></shape>', "inf|finite|1e999"),
    _xml("endless transform", '<shape type="cube"><transform name="to_world"><scale value="inf"/></transform></shape>', "inf|finite"),
    _xml("a word for a colour", '<shape type="cube"><bsdf type="diffuse"><string name="reflectance" value="abc"/></bsdf></shape>', "reflectance"),
    _xml("a transform for a colour", '<shape type="cube"><bsdf type="diffuse"><transform name="reflectance"/></bsdf></shape>', "reflectance"),
    _xml("unknown reference", '<shape type="cube"><ref id="gone"/></shape>', "gone"),
    _xml("reference to itself", '<bsdf type="twosided" id="a"><ref id="a"/></bsdf>', r"scene\.xml:3: .*circular reference"),
    _xml("references in a ring", '<bsdf type="twosided" id="a"><ref id="b"/></bsdf><bsdf type="twosided" id="b"><ref id="a"/></bsdf>', r"scene\.xml:3: .*circular reference"),
    _xml("the same id twice", '<bsdf type="diffuse" id="a"/><bsdf type="diffuse" id="a"/>', "a"),
    _xml("two integers in one name", '<shape type="sphere"><float name="radius" value="1"/><float name="radius" value="2"/></shape>', r"scene\.xml:3: "),
    _xml("singular camera", '<sensor type="perspective"><transform name="to_world"><scale value="0"/></transform></sensor>', "."),
    _xml("camera of no width", '<shape type="cube"/><sensor type="perspective"><float name="fov" value="0"/></sensor>', "."),
    _raw("no sensor", "a.xml", lambda: scene("", sensor=""), "no sensor"),
    _filmed("picture too wide", "1000000", "16384"),
    _filmed("picture of no width", "0", "1 to 16384|width"),
    _filmed("picture of negative width", "-5", "1 to 16384|width|negative"),
    _filmed("width beyond 64 bits", "99999999999999999999", "99999999999999999999|width"),
    _xml("light without area", '<shape type="sphere"><float name="radius" value="0"/><emitter type="area"/></shape>', "light without area"),
]  # fmt: skip
REFERENCES = [
    _outside("absolute", "/etc/passwd"),
    _outside("up", "../../fredholm.sqlite"),
    _outside("up in the middle", "meshes/../../../etc/passwd"),
    _outside("back slashes", "..\\..\\etc\\passwd"),
    _outside("drive", "C:\\Windows\\win.ini"),
    _outside("home", "~/.ssh/id_rsa"),
    _outside("network", "\\\\host\\share\\a.obj"),
    _outside("control character", "m&#10;.obj"),
    _xml("path: long name", lambda: _mesh("obj", "a" * 5000), "outside the upload|missing"),
    _xml("path: device", _mesh("obj", "/dev/zero"), "outside the upload"),
    _xml("path: search folder", '<path value="/etc"/>', "outside the upload"),
    _xml("path: include", '<include filename="/etc/passwd"/>', "outside the upload"),
    _xml("path: spectrum", '<shape type="cube"><bsdf type="diffuse"><spectrum name="reflectance" filename="/etc/passwd"/></bsdf></shape>', "outside the upload"),
    _xml("path: by parameter", '<default name="d" value=".."/>' + _mesh("obj", "$d/$d/a.obj"), "outside the upload"),
    _xml("path: include by parameter", '<default name="d" value="/etc/passwd"/><include filename="$d"/>', "parameter"),
    _xml("path: material", '<shape type="cube"><bsdf type="conductor"><string name="material" value="../../../../etc/passwd"/></bsdf></shape>', "is not known; choose one of Mitsuba"),
    _xml("path: search folder by parameter", '<default name="d" value="/proc/self"/><path value="$d"/>' + _spectrum("environ"), "parameter"),
    _xml("path: where the service runs", _mesh("obj", "README.md"), "missing"),
    _xml("path: spectrum where the service runs", _spectrum("README.md"), "missing"),
    _json("path: document where the service runs", "missing", ball={"type": "obj", "filename": "README.md"}),
    _xml("path: include where the service runs", '<include filename="README.md"/>', "missing"),
    _zip("path: spectrum in an included text", {"scene.xml": scene('<path value="sub"/><include filename="b.txt"/>'), "sub/b.txt": f'<scene version="3.0.0">{_spectrum("/etc/passwd")}</scene>'.encode()}, "outside the upload"),
    _zip("includes that multiply", {"scene.xml": scene('<include filename="0.xml"/>' * 100)} | {f"{i}.xml": b'<scene version="3.0.0">' + f'<include filename="{i + 1}.xml"/>'.encode() * 100 + b"</scene>" for i in range(3)} | {"3.xml": b'<scene version="3.0.0"><shape type="sphere"/></scene>'}, "more than 1000 files are included"),
    _xml("missing file", _mesh("obj", "gone.obj"), r"scene\.xml:3: 'gone\.obj' is missing"),
    _zip("a folder for a file", {"scene.xml": scene(_mesh("obj", "meshes")), "meshes/a.obj": OBJ}, "is a folder"),
    _zip("include in a ring", {"scene.xml": scene('<include filename="b.xml"/>'), "b.xml": b'<scene version="3.0.0"><include filename="scene.xml"/></scene>'}, "includes itself"),
    _zip("includes 20 deep", {"scene.xml": scene('<include filename="0.xml"/>')} | {f"{i}.xml": f'<scene version="3.0.0"><include filename="{i + 1}.xml"/></scene>'.encode() for i in range(20)}, "more than 8 deep"),
    _zip("hostile XML in an include", {"scene.xml": scene('<include filename="b.xml"/>'), "b.xml": b'<scene version="3.0.0"><include filename="/etc/passwd"/></scene>'}, r"b\.xml:1: .*outside the upload"),
]  # fmt: skip
ZIPS = [
    _raw("zip: garbage", "a.zip", lambda: b"PK\x03\x04garbage", "damaged"),
    _raw("zip: cut off", "a.zip", lambda: bundle({"scene.xml": scene(SKY)})[:-30], "damaged"),
    _raw("zip: bomb", "a.zip", _bomb, "times its packed size|unpack to more than"),
    _raw("zip: lying size", "a.zip", _lying_size, "longer than|damaged"),
    _raw("zip: damaged lzma", "a.zip", _damaged_lzma, "damaged"),
    _raw("zip: link", "a.zip", _link, "is a link"),
    _zip("zip: up", {"../scene.xml": scene(SKY)}, r"leads out of the zip with '\.\.'"),
    _zip("zip: absolute", {"/scene.xml": scene(SKY)}, "absolute path"),
    _zip("zip: back slash", {"a\\scene.xml": scene(SKY)}, "."),
    _zip("zip: empty", {}, "is empty"),
    _zip("zip: no scene", {"readme.txt": b"hello"}, r"no \.xml scene file"),
    _zip("zip: two scenes", {"a.xml": scene(SKY), "b.xml": scene(SKY)}, "name the one to render"),
    _zip("zip: too many files", {"scene.xml": scene(SKY)} | {f"{i}.obj": OBJ for i in range(60)}, "more than 50 files"),
    _zip("zip: the same name in two cases", {"scene.xml": scene(SKY), "SCENE.xml": scene(SKY)}, "twice"),
    _zip("zip: code", {"scene.xml": scene('<shape type="cube"/>'), "plugins/cube.so": b"\x7fELF"}, "is code"),
    _zip("zip: a zip in it", {"scene.zip": bundle({"scene.xml": scene(SKY)})}, r"no \.xml scene file"),
    _raw("neither", "a.exe", lambda: b"MZ", r"neither \.xml"),
]
FILES = [
    _raw("ply: promises 4 billion vertices", "a.zip", lambda: meshed("ply", ply(4_000_000_000, 1, TRIANGLE)), "more than the file holds"),
    _raw("ply: promises more than 2^64", "a.zip", lambda: meshed("ply", ply(2**70, 1, TRIANGLE)), "damaged"),
    _raw("ply: negative", "a.zip", lambda: meshed("ply", ply(-3, 1, TRIANGLE)), "damaged"),
    _raw("ply: promises 4 billion faces", "a.zip", lambda: meshed("ply", ply(3, 4_000_000_000, TRIANGLE)), "more than the file holds|triangles"),
    _raw("ply: no header", "a.zip", lambda: meshed("ply", b"\0" * 1000), "damaged ply"),
    _raw("ply: cut off", "a.zip", lambda: meshed("ply", ply(3, 1, TRIANGLE[:20])), "more than the file holds"),
    _raw("ply: cut off in text", "a.zip", lambda: meshed("ply", ply(3, 1, b"0 0 0\n1 0 0\n", "ascii")), "more than the file holds"),
    _raw("ply: faces of vertices that are not there", "a.zip", lambda: meshed("ply", ply(3, 1, TRIANGLE[:36] + struct.pack("<B3i", 3, 0, 1, 77777))), "vert|index|damaged"),
    _raw("ply: such faces in text", "a.zip", lambda: meshed("ply", ply(3, 1, b"0 0 0\n1 0 0\n0 1 0\n3 0 1 77777\n", "ascii")), "names vertex 77777 of 3"),
    _raw("ply: such faces with a flag", "a.zip", lambda: meshed("ply", ply(3, 1, TRIANGLE[:36] + struct.pack("<B3iB", 3, 0, 1, 77777, 9)).replace(b"end_header", b"property uchar flag\nend_header")), "names vertex 77777 of 3"),
    _raw("ply: not finite", "a.zip", lambda: meshed("ply", ply(3, 1, struct.pack("<9f", *[float("nan")] * 9) + TRIANGLE[36:])), "finite"),
    _raw("obj: words", "a.zip", lambda: meshed("obj", b"v a b c\nf 1 2 3\n"), "damaged obj"),
    _raw("obj: faces of vertices that are not there", "a.zip", lambda: meshed("obj", OBJ + b"f 1 2 99\n"), "."),
    _raw("obj: empty", "a.zip", lambda: meshed("obj", b""), "."),
    _raw("serialized: promises 4 billion", "a.zip", lambda: meshed("serialized", serialized(4_000_000_000, 1)), "more than the file holds"),
    _raw("serialized: no such mesh", "a.zip", lambda: meshed("serialized", serialized(0, 0), '<integer name="shape_index" value="7"/>'), "shape_index is 7"),
    _raw("serialized: faces of vertices that are not there", "a.zip", lambda: meshed("serialized", serialized(3, 1, struct.pack("<9f3I", *[0.0] * 3, 1, 0, 0, 0, 1, 0, 0, 1, 77777))), "names vertex 77777 of 3"),
    _raw("serialized: garbage", "a.zip", lambda: meshed("serialized", b"\x1c\x04\x04\x00" + b"\xff" * 200), "damaged serialized"),
    _raw("picture: 4 gigapixels", "a.zip", lambda: textured("t.png", png(65000, 65000)), "pixels, and the limit|memory|cannot be read"),
    _raw("picture: garbage", "a.zip", lambda: textured("t.png", b"no picture"), "cannot be read as a picture"),
    _raw("picture: cut off", "a.zip", lambda: textured("t.png", png(64, 64)[:60]), "cannot be read|libpng"),
    _raw("volume: lying size", "a.zip", lambda: bundle({"scene.xml": scene('<shape type="sdfgrid"><string name="filename" value="f.vol"/></shape>'), "f.vol": b"VOL\x03" + struct.pack("<5i6f", 1, 20000, 20000, 20000, 1, *[0.0] * 6)}), "damaged volume"),
    _raw("grid: NaN", "a.zip", lambda: smoky(struct.pack("<8f", *[1.0] * 7, float("nan"))), "value number 7 is nan"),
    _raw("grid: negative", "a.zip", lambda: smoky(struct.pack("<8f", *[1.0] * 7, -1.0)), "value number 7 is -1"),
    _raw("grid: infinite", "a.zip", lambda: smoky(struct.pack("<8f", *[1.0] * 7, float("inf"))), "value number 7 is inf"),
    _raw("grid: cut off", "a.zip", lambda: smoky(struct.pack("<7f", *[1.0] * 7)), "its header promises 2×2×2×1"),
    _raw("grid: promises 10^28", "a.zip", lambda: smoky(b"", (1 << 30, 1 << 30, 1 << 30, 9)), "damaged volume"),
    _xml("medium: negative extinction", '<shape type="sphere"><medium name="interior" type="homogeneous"><float name="sigma_t" value="-1"/></medium></shape>', "sigma_t is -1"),
    _xml("medium: a grid that is even", '<shape type="sphere"><medium name="interior" type="homogeneous"><volume name="sigma_t" type="gridvolume"><string name="filename" value="no.vol"/></volume></medium></shape>', "is missing|heterogeneous"),
    _xml("meter: without area", '<shape type="rectangle"><transform name="to_world"><scale value="0"/></transform><sensor type="irradiancemeter"/></shape>', "no area"),
    _xml("meter: on no shape", '<sensor type="irradiancemeter"/>', "belongs to no shape"),
    _xml("medium: within itself", '<medium type="homogeneous" id="m"><ref id="m"/></medium><shape type="sphere"><ref id="m" name="interior"/></shape>', "."),
    _xml("medium: 1000 within each other", lambda: "".join('<medium type="homogeneous" name="m">' for _ in range(1000)) + "</medium>" * 1000, "nested more than"),
]  # fmt: skip
FILES += [
    _raw("picture: a reader by its name", "a.zip", lambda: textured("x.null?RES=1x1", b"x"), "cannot be read as a picture"),
    _raw("picture: such a reader for a PNG", "a.zip", lambda: textured("x.null?RES=1x1", png(4, 4)), "cannot be read as a picture"),
    _zip("spectrum: no text", {"scene.xml": scene(_spectrum("s.spd")), "s.spd": bytes(range(128, 256))}, r"scene\.xml:3: s\.spd:1: .* is not a wavelength"),
    _zip("spectrum: of a metal", {"scene.xml": scene('<shape type="cube"><bsdf type="conductor"><string name="material" value="My"/></bsdf></shape>'), "data/ior/My.eta.spd": b"\xff\n", "data/ior/My.k.spd": b"400 1\n700 1\n"}, r"My\.eta\.spd:1: "),
    _zip("curve: no text", {"scene.xml": scene(_mesh("linearcurve", "c.txt")), "c.txt": bytes(range(128, 256))}, r"scene\.xml:3: c\.txt:1: .* is not x, y, z"),
    _zip("ellipsoids: promise 4 billion", {"scene.xml": scene(_mesh("ellipsoids", "e.ply")), "e.ply": ply(0, 0).replace(b"vertex 0", b"vertex 4000000000").replace(b"element face 0\nproperty list uchar int vertex_indices\n", b"")}, "its header promises"),
    _zip("measured: garbage", {"scene.xml": scene('<shape type="cube"><bsdf type="measured"><string name="filename" value="m.bsdf"/></bsdf></shape>'), "m.bsdf": bytes(range(256))}, "damaged tensor file"),
    _zip("volume: not finite", {"scene.xml": scene(_mesh("sdfgrid", "f.vol")), "f.vol": b"VOL" + struct.pack("<B5i6f8f", 3, 1, 2, 2, 2, 1, *[0.0] * 6, *[float("nan")] * 8)}, "not finite|is nan"),
    _raw("XML: Windows' encoding", "a.xml", lambda: b'<?xml version="1.0" encoding="windows-1252"?>' + scene('<shape type="cube" id="caf\u00e9"/>').decode().encode("cp1252"), "cannot read the text encoding windows-1252"),
    _raw("XML: UTF-16 that says UTF-8", "a.xml", lambda: ('<?xml version="1.0" encoding="UTF-8"?>' + scene(SKY).decode()).encode("utf-16"), "encoding"),
]  # fmt: skip
DOCUMENTS = [
    _raw("json: cut off", "a.json", lambda: document()[:-5], r"scene\.json:1: not well-formed JSON"),
    _raw("json: nothing", "a.json", lambda: b"", r"scene\.json:1"),
    _raw("json: a list", "a.json", lambda: b"[1, 2]", "no object"),
    _raw("json: NaN", "a.json", lambda: document(ball={"type": "sphere", "radius": float("nan")}), "not a finite number"),
    _raw("json: 1e999", "a.json", lambda: document(ball={"type": "sphere"}).replace(b'"sphere"', b'"sphere", "radius": 1e999'), "not finite"),
    _raw("json: 4300 digits", "a.json", lambda: b'{"type": "scene", "a": ' + b"9" * 5000 + b"}", "."),
    _raw("json: nested 100,000 deep", "a.json", lambda: b'{"type":' * 100_000, "nested too deep|not well-formed"),
    _raw("json: no text", "a.json", lambda: b"\xff\xfe\x00", "JSON"),
    _json("json: null", r"scene\.ball\.radius: None", ball={"type": "sphere", "radius": None}),
    _json("json: a picture of nothing", r"scene\.ball: 'bitmap' has no filename", ball={"type": "bitmap"}),
    _json("json: a blend of nothing", r"scene\.ball: 'blendbsdf' has no weight", ball={"type": "blendbsdf"}),
    _json("json: no type", r"scene\.ball: \"type\"", ball={"radius": 1}),
    _json("json: type of a number", r"scene\.ball: \"type\"", ball={"type": 7}),
    _json("json: unknown plugin", r"scene\.ball: the type 'teapot'", ball={"type": "teapot"}),
    _json("json: plugin that reads memory", "another program", ball={"type": "blender"}),
    _json("json: file outside", "outside the upload", ball={"type": "obj", "filename": "/etc/passwd"}),
    _json("json: nested transform", r"scene\.ball\.to_world: .*one of", ball={"type": "sphere", "to_world": [{"twist": 3}]}),
    _json("json: matrix of three rows", r"scene\.ball\.to_world", ball={"type": "sphere", "to_world": [[1, 0, 0]] * 3}),
    _json("json: list of four", "have three", ball={"type": "sphere", "center": [1, 2, 3, 4]}),
    _json("json: a scene in a scene", "cannot hold another scene", inner={"type": "scene"}),
    _json("json: name with a dot", "cannot be a name", **{"a.b": {"type": "sphere"}}),
    _json("json: unknown property", "radios", ball={"type": "sphere", "radios": 1.0}),
    _json("json: beyond 64 bits", "64 bits", ball={"type": "sphere", "radius": 2**70}),
    _json("json: reference to nothing", "gone", ball={"type": "sphere", "b": {"type": "ref", "id": "gone"}}),
]  # fmt: skip
ALL = [*XML, *REFERENCES, *ZIPS, *FILES, *DOCUMENTS]
