"""Values for a scene's parameters: what `<default name="spp" value="64"/>` says is used where nobody gives another.

Enters: an XML file, or a zip with one, and texts by name. Leaves: a source that is loaded as the file alone would be;
its digest is that of the scene with these values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from renderer.errors import SceneError

LONGEST_VALUE = 1000  # characters


@dataclass(frozen=True, slots=True)
class SceneFile:
    """A scene's file with values for its parameters: `SceneFile("scene.xml", {"spp": "16"})`. They are texts, as in
    XML; numbers become what Python writes. Raises SceneError for what can be no value.
    """

    path: str | Path
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", {str(name): _text(name, v) for name, v in self.parameters.items()})


Source = str | Path | dict[str, Any] | SceneFile


def with_parameters(scene: str, assignments: Sequence[str]) -> str | SceneFile:
    """The source that a command's SCENE and its `-D name=value` options mean."""
    found: dict[str, str] = {}
    for assignment in assignments:
        name, is_given, value = assignment.partition("=")
        if not is_given or not name:
            raise SceneError(f"-D {assignment}: write -D name=value, for example -D radius=0.5")
        if name in found:
            raise SceneError(f"-D {name} is given twice, {found[name]!r} and {value!r}; give it once")
        found[name] = value
    return SceneFile(scene, found) if found else scene


def refuse_unknown(parameters: Mapping[str, str], known: Sequence[str], shown: str) -> None:
    """Raises SceneError for a parameter that the scene has not."""
    for name in parameters:
        if name not in known:
            has = f"its parameters are {', '.join(known)}" if known else "it has no <default>"
            raise SceneError(f"{shown}: the scene has no parameter {name!r}; {has}")


def _text(name: str, value: Any) -> str:
    text = str(value).lower() if isinstance(value, bool) else str(value)
    if len(text) > LONGEST_VALUE:
        raise SceneError(f"parameter {name}: its value has {len(text)} characters; use at most {LONGEST_VALUE}")
    if "$" in text:
        raise SceneError(f"parameter {name}: its value {text!r} names a parameter itself; write the value")
    return text
