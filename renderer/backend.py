"""Chooses where kernels run: finds libLLVM and sets the Mitsuba variant, before Mitsuba is imported anywhere.

Dr.Jit loads libLLVM when a variant is first used. Debian 12's libLLVM 14 to 16 abort the process on real scenes, so
the wheel's own library is preferred and old ones are never taken.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import glob
import importlib
import importlib.metadata
import os
import platform
import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from renderer.errors import BackendError

OLDEST_LLVM = 17
LANES_AT_ONCE = 64  # of a kernel, that one processor takes before others may help
_SYSTEM_LLVM = (
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/lib/*/libLLVM*.so*",
    "/usr/lib64/libLLVM*.so*",
    "/opt/homebrew/opt/llvm/lib/libLLVM.dylib",
    "/usr/local/opt/llvm/lib/libLLVM.dylib",
)


def _llvm_version(path: str) -> int:
    found = re.search(r"llvm-(\d+)", path) or re.search(r"libLLVM(?:-|\.so\.)(\d+)", path)
    return int(found.group(1)) if found else 0


def find_llvm() -> str | None:
    """Path of a libLLVM that Dr.Jit can use: the wheel's, else the newest of the system from 17 on."""
    try:
        files = importlib.metadata.files("karellen-llvm-core") or []
    except importlib.metadata.PackageNotFoundError:
        files = []
    named = [f for f in files if re.fullmatch(r"libLLVM\.so\.\d+[.\d]*", f.name)]
    candidates = [str(Path(str(f.locate())).resolve()) for f in named]
    candidates += glob.glob(str(Path(sys.prefix) / "lib" / "libLLVM.so.*"))
    for path in candidates:
        if Path(path).is_file():
            return path
    system = [p for pattern in _SYSTEM_LLVM for p in glob.glob(pattern)]
    usable = [p for p in system if _llvm_version(p) >= OLDEST_LLVM or p.endswith(".dylib")]
    return max(usable, key=_llvm_version) if usable else None


def _has_cuda() -> bool:
    return ctypes.util.find_library("cuda") is not None or Path("/usr/lib/wsl/lib/libcuda.so.1").exists()


def choose_llvm() -> None:
    """Points Dr.Jit to a libLLVM that works, unless the user did. Must come before Dr.Jit's first import."""
    if "DRJIT_LIBLLVM_PATH" not in os.environ and (llvm := find_llvm()):
        os.environ["DRJIT_LIBLLVM_PATH"] = llvm


def _refuse_old_llvm() -> None:
    """An old libLLVM, loaded before we could choose, would abort the process in the middle of a render."""
    maps = Path("/proc/self/maps")
    loaded = re.findall(r"\S*libLLVM\S*", maps.read_text()) if maps.exists() else []
    if loaded and 0 < (version := max(map(_llvm_version, loaded))) < OLDEST_LLVM:
        raise BackendError(
            f"Dr.Jit has loaded LLVM {version}, and {OLDEST_LLVM} or newer is needed: import renderer before drjit and "
            "mitsuba, or point DRJIT_LIBLLVM_PATH at a newer library"
        )


def _limit_threads() -> None:
    """`FREDHOLM_THREADS`: how many threads kernels run on; one per processor by default. No bit depends on it."""
    import drjit as dr

    if (asked := os.environ.get("FREDHOLM_THREADS")) is None:
        return
    if not re.fullmatch(r"[1-9]\d{0,3}", asked):
        raise BackendError(f"FREDHOLM_THREADS is {asked!r}; give a number from 1 on, or leave it out to use all")
    dr.set_thread_count(int(asked))


@contextmanager
def reading_files() -> Iterator[None]:
    """While Mitsuba reads a scene's files: its reader of EXR has other threads read, and waits for ever without any."""
    import drjit as dr

    n = dr.thread_count()
    if n > 1:
        yield
        return
    dr.set_thread_count(2)
    try:
        yield
    finally:
        dr.set_thread_count(n)


def _share_passes() -> None:
    """Splits kernels among processors in small blocks of lanes.

    Dr.Jit's own blocks of 16384 lanes are a whole pass of a slow scene: one processor rendered it, the others waited.
    Its function for that is public in C++ and has no name in Python; where it is not found, some of that wait is back.
    """
    import drjit as dr

    try:
        library = ctypes.CDLL(str(next(Path(str(dr.__file__)).parent.glob("libdrjit-core.*"))))
        library["_Z23jit_llvm_set_block_sizej"](ctypes.c_uint32(LANES_AT_ONCE))
    except (OSError, AttributeError, StopIteration):
        return


# Mitsuba and Dr.Jit are used by one thread at a time: tracing and loading in two at once ends in other threads' errors,
# or ends the process. Taken by every way in, before anything is imported that imports Mitsuba.
one_at_a_time = threading.RLock()


def _mitsuba() -> ModuleType:
    """The `mitsuba` module, with the working variant that was found at first use."""
    with one_at_a_time:
        return _first_use()[0]


@cache
def _first_use() -> tuple[ModuleType, str]:
    """The module and its variant, which stays ours whatever `mitsuba.set_variant` is called with later."""
    found = _chosen()
    return found, str(found.variant())


def _chosen() -> ModuleType:
    """The `mitsuba` module with a working variant set: `FREDHOLM_VARIANT` if given, else CUDA, else LLVM.

    Raises BackendError with one sentence that says what is missing.
    """
    choose_llvm()
    import drjit as dr
    import mitsuba as mi

    if not str(mi.variant() or os.environ.get("FREDHOLM_VARIANT")).startswith("cuda"):
        _refuse_old_llvm()
    if mi.variant() is not None and "FREDHOLM_VARIANT" not in os.environ:
        variant = str(mi.variant())
        if not variant.startswith(("llvm_ad_", "cuda_ad_")) or "polarized" in variant:
            raise BackendError(f"the Mitsuba variant {variant} is set; choose llvm_ad_rgb or cuda_ad_rgb")
        _limit_threads()
        _share_passes()
        return mi
    asked = os.environ.get("FREDHOLM_VARIANT")
    if asked is not None and (
        asked not in mi.variants() or not re.fullmatch(r"(llvm|cuda)_ad_(rgb|mono|spectral)", asked)
    ):
        known = [v for v in mi.variants() if re.fullmatch(r"(llvm|cuda)_ad_(rgb|mono|spectral)", v)]
        raise BackendError(f"FREDHOLM_VARIANT is {asked}; choose one of {', '.join(known)}")
    wanted = [asked] if asked else (["cuda_ad_rgb"] if _has_cuda() else []) + ["llvm_ad_rgb"]
    for variant in wanted:
        backend = dr.JitBackend.CUDA if variant.startswith("cuda") else dr.JitBackend.LLVM
        if dr.has_backend(backend):
            mi.set_variant(variant)
            _limit_threads()
            _share_passes()
            mi.set_log_level(mi.LogLevel.Error)
            return mi
    if asked and asked.startswith("cuda"):
        raise BackendError(f"{asked} needs an NVIDIA driver, and none answered; unset FREDHOLM_VARIANT to use the CPU")
    raise BackendError(
        f"no libLLVM of version {OLDEST_LLVM} or newer was found: install one (Debian: apt install libllvm19; "
        "macOS: brew install llvm) or point DRJIT_LIBLLVM_PATH at it"
    )


# The variant in use where it is not the process's own, as Mitsuba's extension module of that variant.
_active: ContextVar[tuple[str, ModuleType] | None] = ContextVar("active_variant", default=None)


class _ActiveMitsuba:
    """The `mitsuba` module as the variant in use has it; see `using`."""

    def __getattr__(self, name: str) -> Any:
        active = _active.get()
        if active is None:
            mi, own = _first_use()
            if mi.variant() != own:  # the process has gone on to another one
                active = own, importlib.import_module(f"mitsuba.{own}")
        if active is not None:
            if name == "variant":
                return lambda: active[0]
            if (found := getattr(active[1], name, None)) is not None:
                return found
        return getattr(_mitsuba(), name)


_ACTIVE_MITSUBA: Any = _ActiveMitsuba()


def mitsuba() -> Any:
    """Mitsuba's module with a working variant: the one that `using` named, else the process's own.

    Raises BackendError with one sentence that says what is missing.
    """
    _mitsuba()
    return _ACTIVE_MITSUBA


def mitsuba_folder() -> Path:
    """Where Mitsuba's package and its own data lie."""
    return Path(str(_mitsuba().__file__)).parent


@contextmanager
def using(variant: str) -> Iterator[None]:
    """Inside, `mitsuba()` is this variant. Scenes of several variants then live side by side in a process.

    Mitsuba's own `set_variant` reloads its Python parts (0.15 s) and concerns the whole process.
    """
    mi = _mitsuba()
    own = variant == mi.variant()
    token = _active.set(None if own else (variant, importlib.import_module(f"mitsuba.{variant}")))
    try:
        yield
    finally:
        _active.reset(token)


def variant_for(colour: str, is_coloured: bool, is_spectral: bool = False, is_polarised: bool = False) -> str:
    """The variant that computes with `colour`: mono, rgb or spectral; auto is the leanest that the scene allows.

    is_spectral: whether the scene allows nothing else. Otherwise `FREDHOLM_VARIANT`, or a variant that was set before,
    decides for auto. is_polarised: whether light is; Mitsuba 3.9 has no variant for that in rgb, and auto is spectral
    where there is colour. Raises BackendError for an unknown one.
    """
    with one_at_a_time:
        mi, own = _first_use()
    if colour == "auto" and is_spectral:
        colour = "spectral"
    if colour == "auto":
        if os.environ.get("FREDHOLM_VARIANT") or not own.endswith("_rgb") or is_coloured:
            colour = own.rsplit("_", 1)[1]
            colour = "spectral" if is_polarised and colour == "rgb" and is_coloured else colour
            colour = "mono" if is_polarised and colour == "rgb" else colour
        else:
            colour = "mono"
    wanted = f"{own.rsplit('_', 1)[0]}_{colour}{'_polarized' if is_polarised else ''}"
    if wanted not in mi.variants():
        raise BackendError(f"colour is {colour!r}, and this Mitsuba has no variant {wanted}; it has {mi.variants()}")
    return wanted


def colour_of(variant: str) -> str:
    """How radiance depends on wavelength in a variant: mono, rgb or spectral."""
    return variant.split("_")[2]


def versions() -> dict[str, str]:
    """Versions that an image depends on, for its metadata."""
    names = {"fredholm": "fredholm", "mitsuba": "mitsuba", "drjit": "drjit", "numpy": "numpy"}
    found = {}
    for key, name in names.items():
        try:
            found[key] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[key] = "unknown"
    return found


def made_with(variant: str) -> str:
    """What decides about the bits of an image beside scene and settings: versions, and the kind of device."""
    known = versions()
    named = ", ".join(f"{name} {known[name]}" for name in ("fredholm", "mitsuba", "drjit"))
    kind = variant.partition("_")[0]
    return f"{named}, {kind} on {platform.machine()}" if kind == "llvm" else f"{named}, {kind}"
