"""Errors of the renderer: one class per decision that a caller can take. The docstring is the default message."""

from __future__ import annotations

import os
from pathlib import Path


class FredholmError(Exception):
    """Rendering failed."""

    def __init__(self, message: str | None = None) -> None:
        super().__init__(message or (self.__doc__ or "").strip())


class BackendError(FredholmError):
    """No compute backend works on this machine: install a libLLVM of version 17 or newer, or a CUDA driver."""


class SceneError(FredholmError):
    """The scene could not be read: mend the scene."""


class UnsupportedScene(SceneError):
    """The scene needs something that this renderer does not model."""


class SettingsError(FredholmError, ValueError):
    """A setting or target is outside its range: choose another value."""


class CheckpointError(FredholmError):
    """The file is not a Fredholm estimate that can be read back."""


class MergeError(FredholmError):
    """These estimates must not be merged: they overlap or answer different questions."""


def check_name(path: Path, what: str, error: type[FredholmError]) -> None:
    """Raises `error` where a file's name, or that of a folder above it, is no UTF-8: Mitsuba and OpenEXR take no other.

    what: the file's part, as "the scene".
    """
    whole = os.path.abspath(path)
    try:
        whole.encode()
    except UnicodeEncodeError:
        shown = os.fsencode(whole).decode("utf-8", "backslashreplace")
        raise error(
            f"{what} is {shown}, whose name is not UTF-8; rename it, or, where it is, run in a UTF-8 locale"
        ) from None
