"""Uploads from strangers: what is unpacked, and what is refused with which sentence."""

from __future__ import annotations

import io
import stat
import zipfile
from pathlib import Path

import pytest

from renderer.scene.bundle import Bundle, BundleError, Limits, shown_name, unpack

LIMITS = Limits(files=5, unpacked_bytes=4 << 20, ratio=50)


def zipped(*entries: tuple[str | zipfile.ZipInfo, bytes]) -> io.BytesIO:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries:
            archive.writestr(name, content, compress_type=zipfile.ZIP_DEFLATED)
    return packed


def unpacked(folder: Path, *entries: tuple[str | zipfile.ZipInfo, bytes]) -> Bundle:
    return unpack(zipped(*entries), "room.zip", folder, LIMITS)


def link(name: str) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name)
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    return info


def test_a_scene_and_its_files_are_unpacked(tmp_path: Path) -> None:
    bundle = unpacked(tmp_path, ("room/scene.xml", b"<scene/>"), ("room/meshes/a.ply", b"ply"))
    assert (bundle.scene, bundle.name) == ("room/scene.xml", "room")
    assert (tmp_path / "room/meshes/a.ply").read_bytes() == b"ply"


def test_the_digest_is_of_names_and_contents_not_of_the_packing(tmp_path: Path) -> None:
    folders = [tmp_path / str(i) for i in range(3)]
    for folder in folders:
        folder.mkdir()
    a, b = ("scene.xml", b"<scene/>"), ("a.ply", b"ply")
    assert unpacked(folders[0], a, b).digest == unpacked(folders[1], b, a).digest
    assert unpacked(folders[2], a, ("a.ply", b"PLY")).digest != unpack_digest(tmp_path, a, b)


def unpack_digest(folder: Path, *entries: tuple[str, bytes]) -> str:
    (folder / "again").mkdir()
    return unpacked(folder / "again", *entries).digest


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("/etc/passwd", "absolute path"),
        ("C:/windows/x", "absolute path"),
        ("../out.xml", "leads out of the zip"),
        ("a/../../out.xml", "leads out of the zip"),
        ("a\\..\\..\\out.xml", "leads out of the zip"),
        ("\\\\server\\out.xml", "absolute path"),
        ("a\x1bb.xml", "control character"),
        ("a/" * 40 + "x", "too long or too deep"),
        ("x" * 300, "too long or too deep"),
    ],
)
def test_names_that_lead_elsewhere_are_refused(tmp_path: Path, name: str, reason: str) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    with pytest.raises(BundleError, match=reason):
        unpacked(folder, ("scene.xml", b"<scene/>"), (name, b"x"))
    assert list(tmp_path.iterdir()) == [folder]
    assert list(folder.iterdir()) == []


def test_links_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BundleError, match="link or a special"):
        unpacked(tmp_path, ("scene.xml", b"<scene/>"), (link("a.ply"), b"/etc/passwd"))


@pytest.mark.parametrize("other", ["A.PLY", "caf\u00e9/a.ply cafe\u0301/a.ply", "stra\u00dfe.ply strasse.ply"])
def test_names_that_are_one_name_on_some_systems_are_refused(tmp_path: Path, other: str) -> None:
    first, second = other.split() if " " in other else ("a.ply", other)
    with pytest.raises(BundleError, match="twice"):
        unpacked(tmp_path, ("scene.xml", b"<scene/>"), (first, b"1"), (second, b"2"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("file", "inner"), [("a", "a/b"), ("A", "a/b"), ("m/A.ply", "m/a.PLY/x"), ("\u00e9", "e\u0301/x")]
)
def test_a_name_of_a_file_and_a_folder_is_refused(tmp_path: Path, file: str, inner: str) -> None:
    for entries in (((file, b"1"), (inner, b"2")), ((inner, b"2"), (file, b"1"))):
        with pytest.raises(BundleError, match="is a file and a folder"):
            unpacked(tmp_path, ("scene.xml", b"<scene/>"), *entries)
        assert list(tmp_path.iterdir()) == []


def test_bombs_are_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(BundleError, match="50 times its packed size"):
        unpacked(tmp_path, ("scene.xml", b"<scene/>"), ("zeros", bytes(3 << 20)))
    assert list(tmp_path.iterdir()) == []


def test_a_tightly_packed_file_of_moderate_size_is_taken(tmp_path: Path) -> None:
    """A volume grid of zeros packs a thousand to one, and is no bomb: half of what a bundle may hold is free."""
    assert unpacked(tmp_path, ("scene.xml", b"<scene/>"), ("grid.vol", bytes(2 << 20))).scene == "scene.xml"
    assert (tmp_path / "grid.vol").stat().st_size == 2 << 20


@pytest.mark.parametrize("name", ["._scene.xml", "room/._scene.xml", "__MACOSX/scene.xml", "room/__MACOSX/._a.xml"])
@pytest.mark.parametrize("more", ["Thumbs.db", "room/.DS_Store", "textures/desktop.ini"])
def test_what_systems_leave_beside_the_files_is_left_out(tmp_path: Path, name: str, more: str) -> None:
    bundle = unpacked(tmp_path, (name, b"fork"), ("room/scene.xml", b"<scene/>"), (more, b"x"))
    assert bundle.scene == "room/scene.xml"
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["scene.xml"]


def test_paths_written_with_backslashes_are_folders(tmp_path: Path) -> None:
    bundle = unpacked(tmp_path, ("room\\", b""), ("room\\scene.xml", b"<scene/>"), ("room\\maps\\a.png", b"png"))
    assert bundle.scene == "room/scene.xml"
    assert (tmp_path / "room" / "maps" / "a.png").read_bytes() == b"png"


def test_too_much_is_refused(tmp_path: Path) -> None:
    parts = [(f"{i}.bin", bytes(900 << 10)) for i in range(5)]
    with pytest.raises(BundleError, match="more than 4 MiB"):
        unpacked(tmp_path, *parts)
    with pytest.raises(BundleError, match="more than 5 files"):
        unpacked(tmp_path, *((f"{i}.xml", b"") for i in range(6)))


def test_an_endless_list_of_folders_is_refused_before_it_is_read(tmp_path: Path) -> None:
    """A million of them took half a minute and 500 MiB, though each is skipped."""
    folders = [(f"{i:06d}/", b"") for i in range(30_000)]  # more than one part of the file
    with pytest.raises(BundleError, match="lists more than 1010 files and folders"):
        unpacked(tmp_path, ("scene.xml", b"<scene/>"), *folders)
    assert unpacked(tmp_path, ("scene.xml", b"<scene/>"), *folders[:900]).scene == "scene.xml"


def test_a_file_longer_than_declared_is_refused(tmp_path: Path) -> None:
    packed = bytearray(zipped(("scene.xml", b"<scene/>" * 1000)).getvalue())
    directory = packed.index(b"PK\x01\x02")
    packed[directory + 24 : directory + 28] = (10).to_bytes(4, "little")
    with pytest.raises(BundleError, match=r"longer than the zip file says|damaged"):
        unpack(io.BytesIO(bytes(packed)), "a.zip", tmp_path, LIMITS)


@pytest.mark.parametrize("content", [b"PK\x03\x04 nonsense", b""])
def test_what_is_no_zip_is_told(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(BundleError, match="damaged"):
        unpack(io.BytesIO(content), "a.zip", tmp_path, LIMITS)


def test_a_zip_without_or_with_several_scenes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BundleError, match=r"no \.xml scene file"):
        unpacked(tmp_path, ("a.ply", b""))
    with pytest.raises(BundleError, match="2 scene files"):
        unpacked(tmp_path, ("a.xml", b""), ("b.xml", b""))


@pytest.mark.parametrize(
    "other",
    [
        b"<readme/>",
        b'\xef\xbb\xbf<?xml version="1.0"?>\n<!-- <scene> -->\n<!DOCTYPE COLLADA>\n<COLLADA version="1.4">',
        '<?xml version="1.0" encoding="utf-16"?><export/>'.encode("utf-16"),
    ],
    ids=["bare", "after comments", "UTF-16"],
)
@pytest.mark.parametrize("name", ["scene.xml", "box.json"])
def test_xml_that_is_no_scene_is_passed_over(tmp_path: Path, name: str, other: bytes) -> None:
    content = b"<!-- by hand --><scene version='3.0.0'/>" if name.endswith(".xml") else b"{}"
    assert unpacked(tmp_path, (f"box/{name}", content), ("box.xml", other)).scene == f"box/{name}"


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BundleError, match=r"neither \.xml nor \.json nor \.zip"):
        unpack(io.BytesIO(b"hello"), "a.blend", tmp_path, LIMITS)


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ("room.xml", "room"),
        ("../../etc/passwd.zip", "passwd"),
        ("C:\\Users\\me\\box.ZIP", "box"),
        ("a\x1b[31m\u202eb.xml", "a[31mb"),
        ("  .xml", "scene"),
        ("x" * 200, "x" * 80),
    ],
)
def test_names_are_shown_without_paths_and_controls(given: str, shown: str) -> None:
    assert shown_name(given) == shown


def test_a_name_that_is_no_text_is_told_in_plain_words(tmp_path: Path) -> None:
    packed = zipped(("scene.xml", b"<scene/>"), ("é.ply", b"ply")).getvalue().replace("é".encode(), b"\x80\xa9")
    with pytest.raises(BundleError, match=r"damaged \(a name that is no text\); pack it again"):
        unpack(io.BytesIO(packed), "room.zip", tmp_path, LIMITS)
