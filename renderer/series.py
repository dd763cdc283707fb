"""Several pictures of one scene as one job: all of its sensors, values of its parameters, or both.

Enters: a source, settings, which sensors, and a list of values for parameters. Leaves: members, one after the other,
each with a loaded scene: members that differ by their sensor alone share it, and the kernels that were compiled for it.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from renderer.errors import SettingsError
from renderer.scene.parameters import SceneFile, Source
from renderer.settings import Settings

if TYPE_CHECKING:
    from renderer.scene.compile import Scene

Sensors = Literal["all"] | Sequence[str | int] | None
MOST_MEMBERS = 10_000
_LONGEST_LABEL = 100  # characters


@dataclass(frozen=True, slots=True)
class Member:
    """One picture of a series. label: what tells it from the others, fit for a file's name. place: its number, from 0,
    of `count` in all. sensor: its index. parameters: the values that it has.
    """

    label: str
    scene: Scene
    settings: Settings
    place: int
    count: int
    sensor: int
    parameters: Mapping[str, str]


def series(
    source: Source,
    settings: Settings | None = None,
    *,
    sensors: Sensors = "all",
    sweep: Sequence[Mapping[str, Any]] = (),
) -> Iterator[Member]:
    """The members of a series, to be rendered each: `render(member.scene, target, member.settings)`.

    sensors: all, those named, or (None) the one that the settings name. sweep: values for parameters, a mapping for
    each; none: the scene as it is. Raises SettingsError for names that the scene has not, SceneError for values.
    """
    from renderer.scene.compile import load_scene

    asked = settings or Settings()
    variants = list(sweep) or [{}]
    labels = _Labels()
    for place, values in enumerate(variants):
        described = _with(source, values)
        texts = described.parameters if isinstance(described, SceneFile) else {}
        scene = load_scene(described, settings=replace(asked, sensor=None, camera=None))
        chosen = [asked.sensor] if sensors is None else sensors
        which = range(len(scene.sensors)) if chosen == "all" else chosen
        for k, name in enumerate(which):
            own = replace(asked, sensor=name)
            sized = scene.sized(own)
            fact = sized.sensors[sized.sensor_index]
            parts = [] if sensors is None else [fact.name or str(fact.index)]
            parts += [f"{key}={texts[key]}" for key in values]
            count = len(which) * len(variants)
            if count > MOST_MEMBERS:
                raise SettingsError(f"the series has {count} pictures; ask for at most {MOST_MEMBERS}")
            label, at = labels.of("-".join(parts)), place * len(which) + k
            yield Member(label, sized, own, at, count, fact.index, texts)


def product(values: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """All combinations of values by name, the last name changing fastest."""
    return [dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())]


def _with(source: Source, values: Mapping[str, Any]) -> Source:
    """The source with more values for its parameters."""
    if not values:
        return source
    if isinstance(source, dict):
        raise SettingsError("the scene is a dictionary, which has no parameters; sweep over a file's")
    given = source.parameters if isinstance(source, SceneFile) else {}
    for name in values:
        if name in given:
            raise SettingsError(f"parameter {name} has the value {given[name]!r} and is swept over; give one of both")
    return SceneFile(source.path if isinstance(source, SceneFile) else source, {**given, **values})


class _Labels:
    """Labels that file names can have, each once."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def of(self, text: str) -> str:
        """A label like the text."""
        plain = re.sub(r"[^\w.=+-]+", "-", text)[:_LONGEST_LABEL].strip("-.") or "picture"
        label = next(one for n in itertools.count(1) if (one := plain if n == 1 else f"{plain}-{n}") not in self._taken)
        self._taken.add(label)
        return label
