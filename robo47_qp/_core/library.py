"""Loads the compiled core, and tells which backend is chosen: it, or the numpy reference."""

import importlib.util
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.machinery import SourceFileLoader
from threading import Lock
from types import ModuleType
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robo47_qp._core.build import BuildError, Built, build, built
from robo47_qp.errors import CoreError, UnknownNameError

Backend = Literal["compiled", "numpy"]
"""What computes: the compiled core, or the reference in numpy."""
BACKENDS: tuple[Backend, ...] = ("compiled", "numpy")
VARIABLE = "ROBO47_BACKEND"
"""Environment variable that chooses the backend."""
_chosen: list[Backend] = []
_TYPES = {
    np.dtype(np.float64): "double[]",
    np.dtype(np.float32): "float[]",
    np.dtype(np.int64): "long long[]",
    np.dtype(np.int32): "int[]",
    np.dtype(np.uint8): "unsigned char[]",
}


def backend() -> Backend:
    """Return the chosen backend: `ROBO47_BACKEND` as it was at the first call, else "compiled".

    Nothing falls back from one to the other.

    Raises:
        UnknownNameError: The variable names no backend.
    """
    if not _chosen:
        _chosen.append(_known(os.environ.get(VARIABLE, "") or "compiled"))
    return _chosen[-1]


@contextmanager
def using(name: str) -> Iterator[None]:
    """Choose a backend for a while; what was built with the other one keeps it.

    Raises:
        UnknownNameError: There is no backend of that name.
    """
    _chosen.append(_known(name))
    try:
        yield
    finally:
        _chosen.pop()


def _known(name: str) -> Backend:
    for known in BACKENDS:
        if name == known:
            return known
    raise UnknownNameError("backend", name, BACKENDS)


class _Core(NamedTuple):
    functions: Any
    ffi: Any


def functions() -> Any:
    """Return the functions of the compiled core, as the headers in this folder declare them.

    Arguments are checked by type; a call releases Python's lock. Where the library of the
    present sources is missing, it is built if the compiler is installed.

    Raises:
        CoreError: There is none and it cannot be built, or it cannot be loaded.
    """
    return _core().functions


def pointer(array: NDArray[Any]) -> Any:
    """Return what a function of the core takes for an array; it keeps the array alive.

    Make it once where time matters, as arrays keep their place.

    Raises:
        TypeError: The array is not contiguous, or its numbers are no C type of the core.
    """
    # By the type itself: numpy takes microseconds to spell its name.
    c_type = _TYPES.get(array.dtype)
    if c_type is None or not array.flags.c_contiguous:
        known = "/".join(map(str, _TYPES))
        raise TypeError(f"the core takes contiguous {known}, not {array.dtype}")
    return _core().ffi.from_buffer(c_type, array)


def address(of: int) -> Any:
    """Return what a field `void *` of a structure takes for an address in this process."""
    return _core().ffi.cast("void *", of)


class Structure:
    """A C structure together with the arrays that it points to."""

    def __init__(self, c_type: str, **fields: Any) -> None:
        """Fill a structure; arrays become pointers to them and are kept alive.

        Args:
            c_type: Its name, such as "r47_chain".
            fields: Numbers, arrays and other structures.
        """
        self._kept = {name: _as_c(value) for name, value in fields.items()}
        self.pointer = _core().ffi.new(f"{c_type} *", self._kept)
        """What functions take for it."""
        self._structures = [value for value in fields.values() if isinstance(value, Structure)]


def _as_c(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return pointer(value)
    return value.pointer if isinstance(value, Structure) else value


_loading = Lock()


@cache
def _core() -> _Core:
    # Threads that come at once would each load it, and mix types that are not the same.
    with _loading:
        return _loaded()


@cache
def _loaded() -> _Core:
    try:
        made = built()
        if not made.there:
            made = _built_now()
    except BuildError as error:
        raise CoreError(str(error)) from None
    name, path = made.declarations.stem, str(made.declarations)
    module = ModuleType(name)
    SourceFileLoader(name, path).exec_module(module)
    try:
        return _Core(module.ffi.dlopen(str(made.library)), module.ffi)
    except OSError as error:
        raise CoreError(f"{made.library} cannot be loaded: {error}") from error


def _built_now() -> Built:
    if importlib.util.find_spec("ziglang") is None:
        raise BuildError(f"there is none of the present C sources in {built().library.parent}")
    print("Building the compiled core (once per change of its C sources)", file=sys.stderr)
    return build()
