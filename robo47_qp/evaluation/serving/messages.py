"""Messages of policy servers: msgpack, with numpy arrays as openpi-client writes them.

An array is a map of four byte strings: `__ndarray__`, `data`, `dtype` and `shape`; a numpy number
is one of three: `__npgeneric__`, `data` and `dtype` (openpi-client 0.1.2,
https://pypi.org/project/openpi-client/). Only numbers, truth values and text cross: nothing is
unpickled, and no other class is made.
"""

from collections.abc import Mapping
from typing import Any

import msgpack
import numpy as np

from robo47_qp.errors import Robo47Error

_ARRAY, _NUMBER = b"__ndarray__", b"__npgeneric__"
_DATA, _TYPE, _SHAPE = b"data", b"dtype", b"shape"
_KINDS = "biufSU"
"""Kinds of arrays that cross: truth values, whole and other numbers, text."""
_LONGEST_TYPE = 16
"""Characters of the name of a type: `<f8` and the like, not the fields of a structure."""


class MessageError(Robo47Error):
    """A message that cannot be read, or an answer that cannot be sent."""


def packed(content: Mapping[str, Any]) -> bytes:
    """Return a map as a message.

    Raises:
        MessageError: It is no map, or holds what is no number, text, list, map or array of these.
    """
    if not isinstance(content, Mapping):
        raise MessageError(f"An answer must be a map of names to values; found {content!r:.200}")
    try:
        return msgpack.packb(content, default=_plain)  # type: ignore[no-any-return]
    except (TypeError, ValueError, OverflowError) as error:
        raise MessageError(f"A message must hold numbers, text and arrays; found {error}") from None


def unpacked(message: bytes) -> dict[str, Any]:
    """Return the map of a message; its arrays cannot be written to.

    Raises:
        MessageError: It is no msgpack, no map at the top, or has an array that is none.
    """
    try:
        content = msgpack.unpackb(message, object_hook=_array)
    except (
        ValueError,
        TypeError,
        OverflowError,
        RecursionError,
        msgpack.exceptions.UnpackException,
    ) as error:
        words = str(error) or type(error).__name__
        raise MessageError(f"A message must be msgpack; found {words[:200]}") from error
    if not isinstance(content, dict):
        kind = type(content).__name__
        raise MessageError(f"A message must be a map of names to values; found a {kind}")
    return content


def _plain(value: object) -> dict[bytes, Any]:
    """Return what stands for an array or a number of numpy in a message."""
    if not isinstance(value, np.ndarray | np.generic):
        raise TypeError(f"a {type(value).__name__}")
    if value.dtype.kind not in _KINDS:
        raise TypeError(f"an array of {value.dtype}")
    if isinstance(value, np.ndarray):
        return {
            _ARRAY: True,
            _DATA: value.tobytes(),
            _TYPE: value.dtype.str,
            _SHAPE: list(value.shape),
        }
    return {_NUMBER: True, _DATA: value.item(), _TYPE: value.dtype.str}


def _array(found: dict[Any, Any]) -> Any:
    """Return the array or number that a map stands for; any other map as it is."""
    if _ARRAY in found:
        kind, data, shape = _type(found), found.get(_DATA), found.get(_SHAPE)
        if not isinstance(shape, list) or not all(type(n) is int and n >= 0 for n in shape):
            raise ValueError("an array whose shape is no list of whole numbers")
        if not isinstance(data, bytes):
            raise ValueError("an array without its data")
        return np.frombuffer(data, dtype=kind).reshape(shape)
    if _NUMBER in found:
        kind, data = _type(found), found.get(_DATA)
        if not isinstance(data, bool | int | float | str | bytes):
            raise ValueError("a number without its value")
        return kind.type(data)
    return found


def _type(found: dict[Any, Any]) -> np.dtype[Any]:
    name = found.get(_TYPE)
    if not isinstance(name, str) or len(name) > _LONGEST_TYPE:
        raise ValueError("an array without the name of its type")
    try:
        kind = np.dtype(name)
    except SyntaxError as error:
        raise ValueError(f"an array of {name!r}") from error
    if kind.kind not in _KINDS:
        raise ValueError(f"an array of {name}")
    return kind
