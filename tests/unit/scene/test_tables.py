"""Spectra, curves, tensors, ellipsoids, volumes, pictures: what is wrong is said before Mitsuba reads them."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.files.picture import read_grid, read_picture
from renderer.scene.files.tables import check_curves, check_ellipsoids, check_spectrum, check_tensors
from renderer.scene.files.voxels import check_file
from renderer.scene.messages import plain
from renderer.scene.source import guarded
from tests.files import write_png

NAN, CENTRE = float("nan"), struct.pack("<3f", 0, 0, 0)


def tensors(*fields: tuple[bytes, int, tuple[int, ...], bytes]) -> bytes:
    """A tensor file of (name, number of the type, shape, values)."""
    head_length = 18 + sum(13 + len(name) + 8 * len(shape) for name, _, shape, _ in fields)
    head, body = b"tensor_file\0\1\0" + struct.pack("<I", len(fields)), b""
    for name, kind, shape, values in fields:
        head += struct.pack("<H", len(name)) + name
        head += struct.pack("<HBQ", len(shape), kind, head_length + len(body)) + struct.pack(f"<{len(shape)}Q", *shape)
        body += values
    return head + body


def volume(sides: tuple[int, int, int], values: list[float], version: int = 3) -> bytes:
    return (
        b"VOL"
        + struct.pack("<B5i6f", version, 1, *sides, 1, 0, 0, 0, 1, 1, 1)
        + struct.pack(f"<{len(values)}f", *values)
    )


def centres(count: int, more: str = "") -> bytes:
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    return f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{axes}{more}end_header\n".encode()


def linear(path: Path) -> None:
    check_curves(path, 2)


def spline(path: Path) -> None:
    check_curves(path, 4)


def sdf(path: Path) -> None:
    read_grid(path, 2)


def look_through(path: Path) -> None:
    check_file(path, read_grid(path))


REFUSED: dict[str, tuple[Callable[[Path], object], bytes, str]] = {
    "spectrum: empty": (check_spectrum, b"", "0 lines"),
    "spectrum: one line": (check_spectrum, b"# a\n400 1\n", "1 lines"),
    "spectrum: no text": (check_spectrum, bytes(range(128, 256)), ":1: .*is not a wavelength"),
    "spectrum: UTF-16": (check_spectrum, "400 1\n700 1\n".encode("utf-16"), ":1: .*is not a wavelength"),
    "spectrum: not finite": (check_spectrum, b"400 1\n500 nan\n", ":2: '500 nan' is not"),
    "spectrum: backwards": (check_spectrum, b"700 1\n400 1\n", ":2: wavelength 400 follows 700"),
    "spectrum: twice": (check_spectrum, b"400 1\n400 1\n", "sort them, each once"),
    "spectrum: one word": (check_spectrum, b"400\n700\n", ":1: '400' is not"),
    "spectrum: long word": (check_spectrum, b"400 " + b"x" * 10**5, ":1: '400 x{36}' is not"),
    "spectrum: five megabytes": (check_spectrum, b"#" * (5 << 20), "and the limit is"),
    "curve: empty": (linear, b"\n\n", "no curve"),
    "curve: short": (spline, b"0 0 0 1\n1 0 0 1\n\n2 0 0 1\n", ":2: a curve of 2 points"),
    "curve: the last one short": (linear, b"0 0 0 1\n1 0 0 1\n\n2 0 0 1\n", ":4: a curve of 1 points"),
    "curve: negative": (linear, b"0 0 0 1\n1 0 0 -1\n", ":2: a radius of -1"),
    "curve: not finite": (linear, b"0 0 0 1\n1 0 inf 1\n", ":2: '1 0 inf 1' is not"),
    "curve: no text": (linear, b"\xff\xfe\x00", ":1: "),
    "tensors: another file": (check_tensors, b"hello", "does not begin"),
    "tensors: cut off": (check_tensors, tensors((b"a", 10, (4,), bytes(16)))[:30], "damaged tensor"),
    "tensors: promise more": (check_tensors, tensors((b"a", 10, (2**40,), bytes(16))), "promises 1099511627776 values"),
    "tensors: promise 2^80": (check_tensors, tensors((b"a", 10, (2**40, 2**40), b"")), "more than the file holds"),
    "tensors: many fields": (check_tensors, b"tensor_file\0\1\0\xff\xff\xff\xff", "4294967295 fields"),
    "tensors: no such type": (check_tensors, tensors((b"a", 77, (4,), bytes(16))), "of the type 77"),
    "tensors: not finite": (check_tensors, tensors((b"a", 10, (1,), struct.pack("<f", NAN))), "not finite"),
    "tensors: a name that is no text": (check_tensors, tensors((b"\xff", 10, (1,), bytes(4))), "damaged tensor"),
    "ellipsoids: promise more": (check_ellipsoids, centres(1000) + CENTRE, "promises"),
    "ellipsoids: promise 4 billion": (check_ellipsoids, centres(4 * 10**9) + CENTRE, "promises"),
    "ellipsoids: a list": (check_ellipsoids, centres(1, "property list uchar int a\n") + CENTRE, "the list 'a'"),
    "ellipsoids: another file": (check_ellipsoids, b"hello", "no PLY header"),
    "volume: header alone": (read_grid, volume((2, 2, 2), [])[:40], "no Mitsuba volume"),
    "volume: cut off": (read_grid, volume((2, 2, 2), [0.0] * 7), "promises 2×2×2×1"),
    "volume: another version": (read_grid, volume((2, 2, 2), [0.0] * 8, 4), "damaged volume"),
    "volume: not finite": (look_through, volume((2, 2, 2), [0.0] * 7 + [NAN]), "number 7 is nan"),
    "volume: flat": (sdf, volume((1, 2, 2), [0.0] * 4), "needs 2 along each side"),
}  # fmt: skip
TAKEN: dict[str, tuple[Callable[[Path], object], bytes]] = {
    "spectrum": (check_spectrum, b"# caf\xe9\n\n400 1\r\n 700.5\t2e-3 more\n"),
    "curves": (linear, b"0 0 0 1\n1 0 0 1\n\n\n2 0 0 1\n3 0 0 0\n"),
    "spline": (spline, b"".join(b"%d 0 0 .1\n" % i for i in range(4))),
    "tensors": (check_tensors, tensors((b"theta_i", 10, (2, 2), bytes(16)), (b"description", 1, (5,), b"hello"))),
    "ellipsoids": (check_ellipsoids, centres(2) + 2 * CENTRE),
    "volume": (sdf, volume((2, 2, 2), [0.5] * 8)),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_wrong_in_a_file_is_said(what: str, tmp_path: Path) -> None:
    check, content, says = REFUSED[what]
    (tmp_path / "file.x").write_bytes(content)
    with pytest.raises(SceneError, match=says) as refused:
        check(tmp_path / "file.x")
    assert str(refused.value).startswith("file.x:")
    assert len(str(refused.value)) < 300


@pytest.mark.parametrize("what", TAKEN)
def test_usual_files_are_taken(what: str, tmp_path: Path) -> None:
    check, content = TAKEN[what]
    (tmp_path / "file.x").write_bytes(content)
    check(tmp_path / "file.x")


@pytest.mark.parametrize("name", ["x.null", "x.null?RES=1x1", "x.null?RES=30000x30000&CHANNELS=3", "x.png?a=b", "x"])
def test_the_name_of_a_picture_chooses_no_reader(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"no picture")
    with pytest.raises(SceneError, match="of no format that Mitsuba reads"):
        read_picture(tmp_path / name)
    write_png(str(tmp_path / "t.png"), np.full((2, 3, 3), 9, np.uint8))
    (tmp_path / "t.png").rename(tmp_path / name)
    if ".null" in name:
        with pytest.raises(SceneError, match="cannot be read as a picture"):
            read_picture(tmp_path / name)
    else:
        assert (read_picture(tmp_path / name).width, read_picture(tmp_path / name).height) == (3, 2)


def test_a_message_that_quotes_bytes_is_a_sentence_with_its_place() -> None:
    def call() -> None:
        b'At scene.xml (line 3, col 2): bad line "\xcd\xff"'.decode()

    with pytest.raises(SceneError, match=r'^scene\.xml:3: bad line "'):
        guarded(call, "scene", ())


def test_a_folder_is_not_cut_in_half_by_the_end_of_a_message() -> None:
    folder = "/" + "/".join("secret" for _ in range(20))
    for length in range(480, 640, 7):
        assert "secret" not in plain("x" * length + f' "{folder}/a.ply"', (folder,))
