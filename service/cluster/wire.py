"""Messages between a render process, the gate and the workers: a little JSON, and arrays as they are.

No message is ever unpickled: what a render process says, which reads strangers' scenes, is data and stays that.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

_LENGTH = struct.Struct("<I")
FRAME = struct.Struct("<Q")  # before each message on a socket: its bytes
MOST_BYTES = 1 << 32
_KINDS = frozenset("iuf")


class BadMessage(ValueError):
    """Bytes that are no message."""


def pack(told: dict[str, Any], **arrays: NDArray[Any]) -> bytes:
    """A message of plain values and named arrays."""
    listed = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    shapes = [[name, array.dtype.str, list(array.shape)] for name, array in listed.items()]
    head = json.dumps({"told": told, "arrays": shapes}).encode()
    return b"".join([_LENGTH.pack(len(head)), head, *(array.tobytes() for array in listed.values())])


def unpack(message: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """What was packed; the arrays are views of the message. Raises BadMessage."""
    try:
        (size,) = _LENGTH.unpack_from(message)
        at = _LENGTH.size + size
        head = json.loads(bytes(message[_LENGTH.size : at]))
        told, arrays = head["told"], {}
        for name, kind, shape in head["arrays"]:
            dtype = np.dtype(kind)
            if dtype.kind not in _KINDS:
                raise BadMessage(f"an array of the type {kind}")
            count = int(np.prod(shape, dtype=np.int64))
            arrays[name] = np.frombuffer(message, dtype, count, at).reshape(shape)
            at += count * dtype.itemsize
    except BadMessage:
        raise
    except (struct.error, ValueError, KeyError, TypeError) as error:
        raise BadMessage(f"{len(message)} bytes are no message: {error}") from None
    if at != len(message) or not isinstance(told, dict):
        raise BadMessage(f"a message of {len(message)} bytes has {len(message) - at} too many")
    return told, arrays


def narrowed(counts: NDArray[np.integer]) -> NDArray[Any]:
    """The same counts in as few bytes as hold them."""
    most = int(counts.max(initial=0))
    return counts.astype(np.uint8 if most < 1 << 8 else np.uint16 if most < 1 << 16 else np.uint32)
