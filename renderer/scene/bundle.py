"""Unpacks a scene: an .xml or .json file, or a .zip with one of them and its files.

Nothing in here parses a scene. Enters: bytes and a file name. Leaves: a folder with the files, the path of
the one scene file in it, and a digest of the content. Everything odd is refused with a sentence that says
what and why.
"""

from __future__ import annotations

import hashlib
import lzma
import re
import stat
import struct
import unicodedata
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import BinaryIO

SCENE_SUFFIXES = (".xml", ".json")
ROOT_WITHIN = 2**16  # bytes of an XML file in which its root element is looked for
PASSED_BEFORE_ROOT = (("<?", "?>"), ("<!--", "-->"), ("<!", ">"))
# Mitsuba looks for its plugins in the scene's folder first: code has no place there.
_CODE_SUFFIXES = (".so", ".dll", ".dylib", ".pyd", ".py", ".exe")
_CHUNK = 1 << 16
_ENTRY_MARK = b"PK\x01\x02"  # before each entry of a zip's list
# Of the bytes that a bundle may hold: up to so many a file may be packed tightly. An empty volume packs 1000:1.
_TIGHT_SHARE = 0.5
# What systems and file managers leave beside the files that were meant.
_LEFT_BEHIND = frozenset({".ds_store", "thumbs.db", "desktop.ini"})


class BundleError(Exception):
    """The bundle is not a scene that can be unpacked."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What a bundle may hold: files, bytes when unpacked, and unpacked/packed ratio of one large file."""

    files: int
    unpacked_bytes: int
    ratio: float


LOCAL_LIMITS = Limits(files=100_000, unpacked_bytes=64 << 30, ratio=1032.0)


@dataclass(frozen=True, slots=True)
class Bundle:
    """An unpacked upload.

    scene: path of the scene file relative to the folder; digest: sha256 of names and content.
    """

    name: str
    scene: str
    digest: str


def shown_name(name: str, fallback: str = "scene") -> str:
    """A name safe to show and to log: no path, no control characters, at most 80 characters."""
    last = re.split(r"[/\\]", unicodedata.normalize("NFC", name))[-1]
    stem = re.sub(r"\.(xml|json|zip)$", "", last, flags=re.IGNORECASE)
    kept = "".join(c for c in stem if unicodedata.category(c)[0] != "C")
    return re.sub(r"\s+", " ", kept).strip()[:80] or fallback


def unpack(source: BinaryIO, file_name: str, folder: Path, limits: Limits) -> Bundle:
    """Write the files of an upload below `folder`, which must be empty. Raises BundleError."""
    name = shown_name(file_name)
    suffix = PurePosixPath(file_name.lower()).suffix
    source.seek(0)
    start = source.read(4)
    source.seek(0)
    if suffix == ".zip" or start == b"PK\x03\x04":
        files = _unpack_zip(source, folder, limits)
    elif suffix in SCENE_SUFFIXES:
        content = source.read()
        (folder / f"scene{suffix}").write_bytes(content)
        files = {f"scene{suffix}": hashlib.sha256(content).hexdigest()}
    else:
        raise BundleError(f"{name} is neither .xml nor .json nor .zip; upload a Mitsuba scene file or a zip with it")
    scene = _scene_file(_without_other_xml(list(files), folder))
    return Bundle(name=name, scene=scene, digest=_digest(files))


def digest_of(folder: Path) -> str:
    """The digest of what lies in a folder now: that of its bundle, as long as nothing in it has changed."""
    files: dict[str, str] = {}
    for path in folder.rglob("*"):
        if path.is_file():
            with path.open("rb") as file:
                files[path.relative_to(folder).as_posix()] = hashlib.file_digest(file, "sha256").hexdigest()
    return _digest(files)


def _digest(files: dict[str, str]) -> str:
    """Of names and content. files: sha256 by path."""
    return hashlib.sha256("".join(f"{path}\0{files[path]}\n" for path in sorted(files)).encode()).hexdigest()


def _unpack_zip(source: BinaryIO, folder: Path, limits: Limits) -> dict[str, str]:
    """Unpack and return sha256 by path."""
    _check_entries(source, limits)
    try:
        with zipfile.ZipFile(source) as archive:
            entries = _vetted(archive, limits)
            return {path: _extract(archive, entry, folder / path) for path, entry in entries.items()}
    except UnicodeError as error:  # of a name that says it is UTF-8
        raise BundleError("the zip file is damaged (a name that is no text); pack it again") from error
    except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, ValueError, struct.error, LookupError) as error:
        raise BundleError(f"the zip file is damaged ({error}); pack it again") from error
    except (OverflowError, MemoryError) as error:
        raise BundleError("the zip file is damaged (impossible sizes); pack it again") from error
    except NotImplementedError as error:
        raise BundleError(f"the zip file uses a method that is not supported ({error}); use deflate") from error


def _check_entries(source: BinaryIO, limits: Limits) -> None:
    """Refuse a list of entries that is far too long before it is read: a million take half a minute and 500 MiB."""
    most, found, kept = 2 * limits.files + 1000, 0, b""  # folders are entries too
    while chunk := source.read(1 << 20):
        found += (kept + chunk).count(_ENTRY_MARK)
        kept = chunk[1 - len(_ENTRY_MARK) :]
        if found > most:
            raise BundleError(f"the zip file lists more than {most} files and folders; send fewer")
    source.seek(0)


def _vetted(archive: zipfile.ZipFile, limits: Limits) -> dict[str, zipfile.ZipInfo]:
    """The entries to unpack, by path; everything is checked before a byte is written."""
    entries: dict[str, zipfile.ZipInfo] = {}
    folded: set[str] = set()
    folders: set[PurePosixPath] = set()
    total = 0
    for entry in archive.infolist():
        if entry.is_dir() or entry.filename.endswith("\\") or _is_left_behind(entry.filename):
            continue
        path = _inside(entry.filename)
        shown = repr(entry.filename[:100])
        if _folded(path) in folded:
            raise BundleError(f"{shown} is in the zip file twice; keep one")
        folded.add(_folded(path))
        mode = entry.external_attr >> 16
        if stat.S_IFMT(mode) not in (0, stat.S_IFREG):
            raise BundleError(f"{shown} is a link or a special file; put the file itself into the zip")
        if path.lower().endswith(_CODE_SUFFIXES) or ".so." in path.lower():
            raise BundleError(f"{shown} is code, which a scene needs not; leave it out")
        if entry.flag_bits & 0x1:
            raise BundleError(f"{shown} is encrypted; pack it without a password")
        total += entry.file_size
        if total > limits.unpacked_bytes:
            raise BundleError(f"the files unpack to more than {limits.unpacked_bytes / 2**20:g} MiB; send less")
        tight_bytes = _TIGHT_SHARE * limits.unpacked_bytes
        if entry.file_size > max(tight_bytes, limits.ratio * max(1, entry.compress_size)):
            raise BundleError(
                f"{shown} unpacks to {entry.file_size / 2**20:.4g} MiB, more than {limits.ratio:g} times its packed "
                f"size; above {tight_bytes / 2**20:g} MiB send it packed less tightly, or split it"
            )
        entries[path] = entry
        folders.update(PurePosixPath(path).parents)
        if len(folders) > limits.files:
            raise BundleError(f"the files lie in more than {limits.files} folders; put more of them side by side")
        if len(entries) > limits.files:
            raise BundleError(f"the zip file holds more than {limits.files} files; send fewer")
    if both := folded & {_folded(str(one)) for one in folders}:
        raise BundleError(f"{min(both)[:100]!r} is a file and a folder in the zip file; rename one")
    if not entries:
        raise BundleError("the zip file is empty; put a scene.xml and its files into it")
    return entries


def _folded(path: str) -> str:
    """Some systems do not tell apart case, or é from e with an accent: what is one name there is one here."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", path).casefold())


def _is_left_behind(name: str) -> bool:
    """Whether an entry is no file of the scene but what macOS or Windows puts beside them: forks, icons, settings."""
    parts = name.replace("\\", "/").split("/")
    return "__MACOSX" in parts or parts[-1].startswith("._") or parts[-1].lower() in _LEFT_BEHIND


def _inside(name: str) -> str:
    """The path of an entry below the folder. Refuses what would lead out of it, on any system."""
    shown = repr(name[:100])
    if any(unicodedata.category(c)[0] == "C" for c in name):
        raise BundleError(f"{shown} has a control character in its name; rename the file")
    name = name.replace("\\", "/")  # some programs of Windows write it so
    path = PurePosixPath(name)
    if path.is_absolute() or re.match(r"^[A-Za-z]:", name):
        raise BundleError(f"{shown} is an absolute path; paths in the zip must be relative")
    if ".." in path.parts:
        raise BundleError(f"{shown} leads out of the zip with '..'; paths must stay inside")
    if len(path.parts) > 32 or any(len(part.encode()) > 255 for part in path.parts) or len(name) > 1000:
        raise BundleError(f"{shown} is too long or too deep; shorten the path")
    return str(path)


def _extract(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, target: Path) -> str:
    """Write one file, at most as long as it says it is; return its sha256."""
    digest = hashlib.sha256()
    written = 0
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with archive.open(entry) as packed, target.open("xb") as unpacked:
            while chunk := packed.read(_CHUNK):
                written += len(chunk)
                if written > entry.file_size:
                    raise BundleError(f"{entry.filename[:100]!r} is longer than the zip file says; pack it again")
                digest.update(chunk)
                unpacked.write(chunk)
    except OSError as error:
        raise BundleError(f"{entry.filename[:100]!r} cannot be unpacked ({error.strerror}); rename it") from error
    return digest.hexdigest()


def _without_other_xml(paths: list[str], folder: Path) -> list[str]:
    """The paths without XML files that are something else, a read-me or an export's settings, where a scene is left."""
    kept = [p for p in paths if not p.lower().endswith(".xml") or _root_of(folder / p) in ("scene", "")]
    return kept if any(path.lower().endswith(SCENE_SUFFIXES) for path in kept) else paths


def _root_of(path: Path) -> str:
    """The name of an XML file's root element; "" where its beginning does not tell."""
    with path.open("rb") as file:
        start = file.read(ROOT_WITHIN).replace(b"\0", b"").decode("latin-1")  # UTF-16, too
    at = 0
    while (at := start.find("<", at)) >= 0:
        passed = next((p for p in PASSED_BEFORE_ROOT if start.startswith(p[0], at)), None)
        if passed is None:
            found = re.match(r"[\w:.-]+", start[at + 1 : at + 100])
            return found[0] if found else ""
        at = start.find(passed[1], at + len(passed[0]))
        if at < 0:
            return ""
    return ""


def _scene_file(paths: list[str]) -> str:
    """The one scene: scene.xml or scene.json, or the only such file, of the topmost folder that has any."""
    for suffix in SCENE_SUFFIXES:
        candidates = [path for path in paths if path.lower().endswith(suffix)]
        if not candidates:
            continue
        top = min(path.count("/") for path in candidates)
        topmost = sorted(path for path in candidates if path.count("/") == top)
        named = [path for path in topmost if PurePosixPath(path).name.lower() == f"scene{suffix}"]
        if len(named) == 1:
            return named[0]
        if len(topmost) > 1:
            shown = ", ".join(topmost[:3])
            raise BundleError(f"there are {len(topmost)} scene files ({shown}); name the one to render scene{suffix}")
        return topmost[0]
    raise BundleError("there is no .xml scene file in the zip; add the scene as scene.xml")
