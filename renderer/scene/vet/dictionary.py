"""A scene as a JSON document: Mitsuba's dictionary with numbers, texts, lists and objects only.

    {"type": "scene", "sensor": {"type": "perspective", "to_world": [{"look_at": {"origin": [0, 0, 4],
     "target": [0, 0, 0], "up": [0, 1, 0]}}]}, "ball": {"type": "sphere"}, "sky": {"type": "constant"}}

A transform is a 4×4 matrix (four rows of four), or a list of steps applied in order: {"translate": [x, y, z]},
{"rotate": {"axis": [x, y, z], "angle": degrees}}, {"scale": s or [x, y, z]}, {"look_at": {...}}, {"matrix": [[...]]}.
Mitsuba's own dictionary reader ends the process on some values (None is one), so everything is checked here.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from renderer.backend import mitsuba
from renderer.errors import SceneError
from renderer.scene.files.tables import check_spectrum
from renderer.scene.limits import SceneLimits
from renderer.scene.vet.budget import Budget
from renderer.scene.vet.plugins import INTEGRATORS, SAMPLERS, SHAPES, check_plugin
from renderer.scene.vet.references import check_reference, leads_out, meant

_TRANSFORMS = frozenset({"to_world", "to_uv"})
_UNTYPED = frozenset({"rgb", "spectrum", "ref"})  # dictionaries that are values, not plugins
_STEPS = ("translate", "rotate", "scale", "look_at", "matrix")
_MAX_LIST = 100_000
_MAX_KEY = 200


def read_document(text: bytes, name: str, folder: Path, limits: SceneLimits) -> dict[str, Any]:
    """The Mitsuba dictionary of a JSON document. Raises SceneError that names the place, as "scene.ball.radius".

    folder: where the files that it names must lie, if `limits` say so.
    """
    if len(text) > limits.xml_bytes:
        raise SceneError(f"{name}: larger than {limits.xml_bytes >> 20} MiB; keep meshes in files of their own")
    try:
        document = json.loads(text, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        raise SceneError(f"{name}:{error.lineno}: not well-formed JSON ({error.msg}); mend that line") from None
    except UnicodeDecodeError as error:
        raise SceneError(f"{name}: byte {error.start} is no {error.encoding.upper()}; save it as UTF-8 JSON") from None
    except (RecursionError, ValueError) as error:
        why = "nested too deep" if isinstance(error, RecursionError) else str(error)[:100]
        raise SceneError(f"{name}: cannot be read as JSON ({why}); save it as UTF-8 JSON") from None
    if not isinstance(document, dict):
        raise SceneError(f'{name}: the document is no object; write {{"type": "scene", …}}')
    return _Reader(folder, limits).scene(document)


def check_values(found: dict[Any, Any], where: str) -> None:
    """Refuses values in a Mitsuba dictionary that end its reader in a bare TypeError, or the process."""
    for key, value in found.items():
        if not isinstance(key, str):
            raise SceneError(f"{where}: {key!r} cannot be a name; names are texts")
        place = f"{where}.{key}"
        if isinstance(value, dict):
            check_values(value, place)
        elif value is None:
            raise SceneError(f"{place}: None is no value for a scene; leave the entry out")
        elif isinstance(value, (set, frozenset, bytes, range)) or callable(value):
            raise SceneError(
                f"{place}: a {type(value).__name__} is no value for a scene; give a number, text or dictionary"
            )


def _refuse_constant(text: str) -> Any:
    raise ValueError(f"{text} is not a finite number")


class _Reader:
    """Turns one document into a dictionary that is safe to hand on."""

    def __init__(self, folder: Path, limits: SceneLimits) -> None:
        self.folder = folder
        self.limits = limits
        self.n_objects = 0
        self.budget = Budget(limits)

    def scene(self, document: dict[str, Any]) -> dict[str, Any]:
        if document.get("type") != "scene":
            raise SceneError(f'scene: the outermost type is {document.get("type")!r}; it must be "scene"')
        return self.object(document, "scene", 1)

    def object(self, found: dict[str, Any], where: str, depth: int) -> dict[str, Any]:
        self.n_objects += 1
        if depth > self.limits.xml_depth:
            raise SceneError(f"{where}: objects are nested more than {self.limits.xml_depth} deep; flatten them")
        if self.n_objects > self.limits.xml_elements:
            raise SceneError(f"{where}: the scene has more than {self.limits.xml_elements} objects; use meshes")
        plugin = found.get("type")
        if not isinstance(plugin, str):
            raise SceneError(f'{where}: "type" is {plugin!r}; name the plugin, for example "sphere"')
        if plugin not in _UNTYPED:
            self.budget.count(where, is_shape=plugin in SHAPES)
        if plugin not in _UNTYPED and not (plugin in INTEGRATORS or plugin in SAMPLERS):
            check_plugin(plugin, where)
        if plugin == "scene" and depth > 1:
            raise SceneError(f"{where}: a scene cannot hold another scene; put its shapes into the outer one")
        made: dict[str, Any] = {}
        for key, value in found.items():
            if not key or len(key) > _MAX_KEY or "." in key or not key.isprintable():
                raise SceneError(f"{where}: {key[:40]!r} cannot be a name; use letters, digits, - and _")
            made[key] = self.value(key, value, f"{where}.{key}", depth, plugin)
        return made

    def value(self, key: str, value: Any, where: str, depth: int, plugin: str) -> Any:
        if isinstance(value, str):
            self.budget.text(key, value, where)
        if key in _TRANSFORMS:
            return transform(value, where)
        if isinstance(value, dict):
            return self.object(value, where, depth + 1)
        if isinstance(value, list):
            return self.numbers(value, where, is_spectrum=plugin == "spectrum")
        if (
            isinstance(value, str)
            and self.limits.is_confined
            and (key.lower().endswith("filename") or leads_out(value))
        ):
            check_reference(value, self.limits.root or self.folder, [self.folder], where)
            is_missing = not (self.folder / value).is_file() and meant(value, [self.folder]) is None
            if key.lower().endswith("filename") and is_missing:
                raise SceneError(f"{where}: {value[:200]!r} is missing; put that file beside the scene")
        if plugin == "spectrum" and key == "filename" and isinstance(value, str) and (self.folder / value).is_file():
            try:
                check_spectrum(self.folder / value)
            except SceneError as error:
                raise SceneError(f"{where}: {error}") from None
        if isinstance(value, (bool, str)):
            return value
        if isinstance(value, (int, float)):
            return _number(value, where)
        raise SceneError(f"{where}: {value!r} is no value for a scene; leave the entry out")

    def numbers(self, value: list[Any], where: str, *, is_spectrum: bool) -> Any:
        if len(value) > _MAX_LIST:
            raise SceneError(f"{where}: a list of {len(value)} entries; keep large data in files")
        if is_spectrum and value and all(isinstance(pair, list) and len(pair) == 2 for pair in value):
            return [(_number(a, where), _number(b, where)) for a, b in value]
        if len(value) != 3:
            raise SceneError(f"{where}: a list of {len(value)} entries; points, vectors and colours have three")
        return mitsuba().ScalarPoint3d([_number(v, where) for v in value])


def transform(value: Any, where: str) -> Any:
    """A Mitsuba transform from a 4×4 matrix or a list of steps, the first applied first."""
    mi = mitsuba()
    if _is_matrix(value):
        return _matrix(value, where)
    steps = [value] if isinstance(value, dict) else value
    if not isinstance(steps, list) or len(steps) > 64:
        raise SceneError(f"{where}: a transform is a 4×4 matrix or a list of {', '.join(_STEPS)}")
    made = mi.ScalarTransform4d()
    for step in steps:
        if not isinstance(step, dict) or len(step) != 1 or next(iter(step)) not in _STEPS:
            raise SceneError(f'{where}: a step is one of {", ".join(_STEPS)}, as in {{"translate": [0, 1, 0]}}')
        made = _step(*next(iter(step.items())), where) @ made
    return made


def _step(kind: str, value: Any, where: str) -> Any:
    identity = mitsuba().ScalarTransform4d()
    if kind == "matrix":
        return _matrix(value, where)
    if kind == "translate":
        return identity.translate(_vector(value, where))
    if kind == "scale":
        factors = [_number(value, where)] * 3 if isinstance(value, (int, float)) else _vector(value, where)
        return identity.scale(factors)
    if not isinstance(value, dict):
        raise SceneError(f"{where}: {kind} needs an object with its parts")
    try:
        if kind == "rotate":
            return identity.rotate(_vector(value["axis"], where), _number(value["angle"], where))
        return identity.look_at(*(_vector(value[part], where) for part in ("origin", "target", "up")))
    except KeyError as error:
        raise SceneError(f"{where}: {kind} needs {error}") from None


def _is_matrix(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 4 and all(isinstance(row, list) for row in value)


def _matrix(value: Any, where: str) -> Any:
    if not _is_matrix(value) or any(len(row) != 4 for row in value):
        raise SceneError(f"{where}: a matrix has four rows of four numbers")
    return mitsuba().ScalarTransform4d([[_number(v, where) for v in row] for row in value])


def _vector(value: Any, where: str) -> list[float]:
    if not isinstance(value, list) or len(value) != 3:
        raise SceneError(f"{where}: {value!r} must be a list of three numbers")
    return [_number(v, where) for v in value]


def _number(value: Any, where: str) -> Any:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SceneError(f"{where}: {value!r} must be a number")
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise SceneError(f"{where}: {value} is beyond 64 bits; write a smaller number")
    if not math.isfinite(value):
        raise SceneError(f"{where}: {value} is not finite; write a finite number")
    return value
