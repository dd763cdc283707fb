"""Functions of x that somebody types in: read as an expression of a few words, never run as a program.

Enters: a text such as `sin(x)^2 + 1/x`. Leaves: a function of arrays. Numbers, x, pi, e, + − * / ^, brackets and the
functions below are all there is; everything else is refused with its name.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from renderer.errors import SettingsError

Array = NDArray[np.float64]

LONGEST = 100  # characters
_DEEPEST = 40  # operations within each other
_FUNCTIONS: dict[str, Callable[..., Array]] = {
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "abs", "tanh")},
    "min": np.minimum,
    "max": np.maximum,
    "step": lambda x: np.where(x >= 0, 1.0, 0.0),
}
_TAKES_TWO = ("min", "max")
_CONSTANTS = {"pi": math.pi, "π": math.pi, "e": math.e}
_OPERATIONS: dict[type[ast.operator], Callable[..., Array]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}
KNOWN = f"x, numbers, pi, e, + − * / ^, brackets, {', '.join(_FUNCTIONS)}"


def function_of(text: str) -> Callable[[Array], Array]:
    """The function that an expression of x says: (k,) float64 → (k,) float64; inf and nan where it has no value.

    Raises SettingsError with the word that it does not know.
    """
    if len(text) > LONGEST:
        raise SettingsError(f"the expression has {len(text)} characters; it may have {LONGEST}")
    plain = text.strip().replace("^", "**").replace("−", "-").replace("·", "*").replace("×", "*")
    try:
        body = ast.parse(plain, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise SettingsError(f"{text!r} is no expression of x; known are {KNOWN}") from None
    tree = _read(body, _DEEPEST)

    def value(x: Array) -> Array:
        with np.errstate(all="ignore"):
            return np.broadcast_to(np.asarray(tree(x), dtype=np.float64), x.shape)

    return value


def _read(node: ast.expr, deepest: int) -> Callable[[Array], Array]:
    """An expression as a function. Numbers are floats from the start: no power of whole numbers grows without end."""
    if deepest == 0:
        raise SettingsError(f"the expression has more than {_DEEPEST} operations within each other")
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            constant = _float(number)
            return lambda x: np.full_like(x, constant)
        case ast.Name(id="x"):
            return lambda x: x
        case ast.Name(id=name) if name in _CONSTANTS:
            return lambda x: np.full_like(x, _CONSTANTS[name])
        case ast.UnaryOp(op=ast.UAdd() | ast.USub() as sign, operand=operand):
            inner, factor = _read(operand, deepest - 1), -1.0 if isinstance(sign, ast.USub) else 1.0
            return lambda x: factor * inner(x)
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATIONS:
            one, other, apply = _read(left, deepest - 1), _read(right, deepest - 1), _OPERATIONS[type(operator)]
            return lambda x: apply(one(x), other(x))
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in _FUNCTIONS:
            needed = 2 if name in _TAKES_TWO else 1
            if len(arguments) != needed:
                raise SettingsError(f"{name} takes {needed} value{'s' * (needed > 1)}, not {len(arguments)}")
            parts, call = [_read(argument, deepest - 1) for argument in arguments], _FUNCTIONS[name]
            return lambda x: call(*(part(x) for part in parts))
    raise SettingsError(f"{ast.unparse(node)[:40]!r} is not known; known are {KNOWN}")


def _float(number: float) -> float:
    try:
        return float(number)
    except OverflowError:
        return math.inf
