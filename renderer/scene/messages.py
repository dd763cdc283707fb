"""Mitsuba's messages as people want them: file:line, no source positions, and what to do about it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from renderer.backend import mitsuba

_HINTS = (
    (r"invalid lookat", "'up' must not be parallel to the direction of sight, nor 'target' be 'origin'; turn 'up'"),
    (r"Only one environment emitter", "keep one of constant, envmap and sunsky, and remove the others"),
    (r"field .* already exists", "the faces hold two lists; export texture coordinates per vertex"),
    (r"unreferenced|unqueried|not queried|unused", "remove that property or mend its name"),
    (
        r"reference to unknown|unresolved reference|not find referenced|undefined reference",
        "define an object with that id",
    ),
    (r"does not exist|not found!|could not be (found|opened)|unable to open|cannot open", "check the name"),
    (r"could not parse RGB value", "write three numbers from 0 to 1, as in 0.2, 0.4, 0.8"),
    (
        r"Texture::mean\(\): not implemented",
        "this material needs the mean of its colours, which colours of vertices and faces do not tell; use principled",
    ),
    (r"could not (convert|parse)|invalid (number|value)|parse (floating|integer)", "write a number"),
)
_MAX_LENGTH = 600


def place_of(state: Any, node: Any, folders: tuple[str, ...]) -> str:
    """Where a node stands: "scene.xml:12", or "scene.ball" in a dictionary."""
    return located(mitsuba().parser.file_location(state, node), folders)


def plain(message: str, folders: tuple[str, ...]) -> str:
    """A message of Mitsuba's without its source positions, places as file:line, and a way out where one is known."""
    lines = [line.strip() for line in message.splitlines() if line.strip()]
    kept = [re.sub(r"\[[a-z_]+\.(cpp|h):\d+\]\s*", "", line) for line in lines]
    text = located(" ".join(kept), folders)[:_MAX_LENGTH].rstrip(".!")  # cut last: half a folder's name is not known
    text = re.sub(r"^(At|(Error )?while loading)\s+", "", text, flags=re.IGNORECASE)
    for pattern, hint in _HINTS:
        if re.search(pattern, text, re.IGNORECASE):
            return f"{text}; {hint}"
    return text


def has_place(text: str) -> bool:
    """Whether a message begins with a place."""
    return re.match(r"([^:]+\.xml:\d+|scene(\.[^: ]+)*): ", text) is not None


def located(text: str, folders: tuple[str, ...]) -> str:
    """Text with Mitsuba's places in short form, and paths relative to the scene's folder."""
    for folder in dict.fromkeys([*folders, *(str(Path(folder).resolve()) for folder in folders)]):
        text = text.replace(folder.rstrip("/\\") + "/", "").replace(folder.rstrip("/\\") + "\\", "")
    text = re.sub(r" \(line (\d+), col \d+\)", r":\1", text)
    text = re.sub(r'dictionary node "root"', "scene", text)
    return re.sub(r'dictionary node "([^"]*)"', r"scene.\1", text)
