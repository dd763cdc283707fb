"""What a scene's text may cost before anything is made of it: objects, shapes, long texts, parameters.

Mitsuba copies texts many times over, puts parameters (`$name`) in place wherever they are named, in each other too, and
takes about a millisecond for each shape. Counted here, too much of any is refused within a second.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from renderer.errors import SceneError
from renderer.scene.limits import SceneLimits

# Attributes and keys that name things; all others hold values.
_LONGEST_PARAMETER = 100
_NAMES = frozenset({"id", "name", "type", "key", "as"})


@dataclass
class Budget:
    """Counts what the files of one scene hold together. Raises SceneError once one of the limits is passed."""

    limits: SceneLimits
    objects: int = 0
    shapes: int = 0
    uses: int = 0
    expanded_bytes: int = 0
    # Characters of each parameter's value once those in it are put in place, by the length of its name and its name.
    parameters: dict[int, dict[str, int]] = field(default_factory=dict)

    def count(self, where: str, *, is_shape: bool) -> None:
        """One more object: a shape, or something else that a plugin makes."""
        self.objects += 1
        self.shapes += is_shape
        if self.shapes > self.limits.shapes:
            raise SceneError(f"{where}: the scene has more than {self.limits.shapes} shapes; put them into meshes")
        if self.objects > self.limits.objects:
            raise SceneError(
                f"{where}: the scene has more than {self.limits.objects} objects; use materials and textures again by "
                "their ids"
            )

    def text(self, key: str, value: str, where: str) -> int:
        """A text of the scene; how many characters it has with parameters put in place."""
        length = len(value) if "$" not in value else self._expanded(value, where)
        most = self.limits.name_length if key in _NAMES else self.limits.value_length
        if length > most:
            what = f"the {key}" if key in _NAMES else f"the value of {key}"
            raise SceneError(
                f"{where}: {what[:80]} has {length} characters, and the limit is {most}; shorten it, and keep large "
                "data in files"
            )
        return length

    def define(self, name: str, value: str, where: str) -> None:
        """A parameter's default. The first one counts, and the longest name that fits, as in Mitsuba."""
        if len(name) > _LONGEST_PARAMETER:
            raise SceneError(f"{where}: the name of a parameter has {len(name)} characters; use {_LONGEST_PARAMETER}")
        length = self.text("value", value, where)
        by_name = self.parameters.setdefault(len(name), {})
        by_name.setdefault(name, length)
        if sum(map(len, self.parameters.values())) > self.limits.parameters:
            raise SceneError(f"{where}: the scene has more than {self.limits.parameters} parameters; use fewer")

    def _expanded(self, value: str, where: str) -> int:
        first, *rest = value.split("$")
        self.uses += len(rest)
        if self.uses > self.limits.parameter_uses:
            raise SceneError(
                f"{where}: parameters are used more than {self.limits.parameter_uses} times; write the values "
                "themselves"
            )
        lengths = sorted(self.parameters, reverse=True)
        total = len(first)
        for part in rest:
            # Unknown ones are refused by Mitsuba, with a message of its own.
            known = next((n for n in lengths if part[:n] in self.parameters[n]), None)
            total += 1 + len(part) if known is None else self.parameters[known][part[:known]] + len(part) - known
        self.expanded_bytes += total
        if self.expanded_bytes > self.limits.xml_bytes:
            raise SceneError(
                f"{where}: with its parameters put in place the scene is larger than {self.limits.xml_bytes >> 20} "
                "MiB; use shorter values"
            )
        return total
