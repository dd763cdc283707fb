"""Small valid scenes and files that hostile inputs are made from."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib

SENSOR = (
    '<sensor type="perspective"><film type="hdrfilm"><integer name="width" value="8"/>'
    '<integer name="height" value="6"/></film></sensor>'
)
SKY = '<emitter type="constant"/>'
OBJ = b"v -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n"


def scene(inner: str, *, sensor: str = SENSOR, sky: str = SKY) -> bytes:
    """An XML scene with something in it."""
    return f'<scene version="3.0.0">{sensor}\n{sky}\n{inner}\n</scene>'.encode()


def document(**inner: object) -> bytes:
    """A JSON scene with something in it."""
    film = {"type": "hdrfilm", "width": 8, "height": 6}
    whole = {"type": "scene", "sensor": {"type": "perspective", "film": film}, "sky": {"type": "constant"}, **inner}
    return json.dumps(whole).encode()


def bundle(files: dict[str, bytes], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    """A zip of files."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", compression) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return packed.getvalue()


def meshed(kind: str, content: bytes, inner: str = "") -> bytes:
    """A bundle whose scene names one mesh file."""
    shape = f'<shape type="{kind}"><string name="filename" value="m.{kind}"/>{inner}</shape>'
    return bundle({"scene.xml": scene(shape), f"m.{kind}": content})


def textured(name: str, content: bytes) -> bytes:
    """A bundle whose scene names one picture."""
    texture = f'<texture type="bitmap" name="reflectance"><string name="filename" value="{name}"/></texture>'
    return bundle(
        {"scene.xml": scene(f'<shape type="cube"><bsdf type="diffuse">{texture}</bsdf></shape>'), name: content}
    )


def smoky(values: bytes, size: tuple[int, int, int, int] = (2, 2, 2, 1)) -> bytes:
    """A bundle whose scene has a medium of a grid with these float32 values."""
    grid = '<volume name="sigma_t" type="gridvolume"><string name="filename" value="s.vol"/></volume>'
    cloud = f'<shape type="cube"><medium name="interior" type="heterogeneous">{grid}</medium></shape>'
    header = b"VOL\x03" + struct.pack("<5i6f", 1, *size, 0, 0, 0, 1, 1, 1)
    return bundle({"scene.xml": scene(cloud), "s.vol": header + values})


def png(width: int, height: int) -> bytes:
    """A PNG header that promises a size, with hardly anything behind it."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"\0" * 100)) + chunk(b"IEND", b"")
    )


def real_png() -> bytes:
    """A picture of 4×4 that can be read."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    rows = b"".join(b"\0" + bytes((40 * y + 10 * x) % 256 for x in range(12)) for y in range(4))
    head = struct.pack(">IIBBBBB", 4, 4, 8, 2, 0, 0, 0)
    start = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head)
    return start + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def ply(vertices: int, faces: int, body: bytes = b"", encoding: str = "binary_little_endian") -> bytes:
    """A PLY file that promises so many vertices and faces."""
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat {encoding} 1.0\nelement vertex {vertices}\n{axes}element face {faces}\n"
    return (head + "property list uchar int vertex_indices\nend_header\n").encode() + body


def serialized(vertices: int, triangles: int, body: bytes = b"") -> bytes:
    """A serialized mesh that promises so many vertices and triangles."""
    packed = zlib.compress(struct.pack("<I", 0x1000) + b"m\0" + struct.pack("<QQ", vertices, triangles) + body)
    return struct.pack("<HH", 0x041C, 4) + packed + struct.pack("<QI", 0, 1)


TRIANGLE = struct.pack("<9f", -1, -1, 0, 1, -1, 0, 0, 1, 0) + struct.pack("<B3i", 3, 0, 1, 2)

VOLUME = b"VOL" + struct.pack("<B5i6f8f", 3, 1, 2, 2, 2, 1, 0, 0, 0, 1, 1, 1, *[0.5] * 8)
# A file of each kind that a scene names.
PARTS = {
    "m.ply": ply(3, 1, TRIANGLE),
    "m.obj": OBJ,
    "t.png": real_png(),
    "v.vol": VOLUME,
    "s.spd": b"400 0.5\n550 0.6\n700 0.4\n",
    "c.txt": b"".join(b"%d 0 0 .1\n" % i for i in range(5)),
    "data/ior/My.eta.spd": b"400 1.5\n700 1.4\n",
    "data/ior/My.k.spd": b"400 0.1\n700 0.2\n",
}
