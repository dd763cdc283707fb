"""Messages without the folders of this machine: what went wrong is told, where the service lives is not."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterable
from functools import cache
from pathlib import Path

_MARK = "…"  # for what was left out
# Not the second slash of http://, nor one between two words.
_FOLDERS = re.compile(r"(?<![\w/.…-])(?<!:/)/(?!/)(?:[^\s/'\"<>|;,()\\]+/)+")
_WINDOWS = re.compile(r"(?<!\w)(?:[A-Za-z]:|\\)[\\/](?:[^\s\\/'\"<>|;,()]+[\\/])*")


def without_paths(text: str, roots: Iterable[str | Path] = ()) -> str:
    """A text in which absolute paths are cut to their last part, whoever named them: so none tells whether it exists.

    roots: folders whose files are named as they lie in them, whatever is in the folders' own names.
    """
    for root in sorted(map(str, roots), key=len, reverse=True):
        text = _cut(text, root, "")
    for root in sorted(_own_roots(), key=len, reverse=True):
        # As any other folder: else the answer would tell which process gave it.
        text = _cut(text, root, f"{_MARK}/", f"{_MARK}/{Path(root).name}")
    text = _FOLDERS.sub(f"{_MARK}/", text)
    text = _WINDOWS.sub(lambda found: f"{_MARK}/", text)
    # A root and what was below it are one path.
    return re.sub(rf"{_MARK}/(?:[^\s/'\"<>|;,()]+/)+", f"{_MARK}/", text)


def _cut(text: str, root: str, by: str, alone: str = "") -> str:
    """by: what stands for the root of a path; alone: for the root itself."""
    if len(root) < 2:
        return text
    text = re.sub(rf"(?<![\w.-]){re.escape(root)}[\\/]", lambda _: by, text)
    return re.sub(rf"(?<![\w.-]){re.escape(root)}(?![\w.-])", lambda _: alone, text)


@cache
def _own_roots() -> frozenset[str]:
    """Folders that this process knows of; a shorter part of one is none."""
    found = {os.getcwd(), os.path.expanduser("~"), tempfile.gettempdir(), sys.prefix, sys.base_prefix}
    return frozenset(str(Path(one).absolute()) for one in found if len(Path(one).parts) > 2)
