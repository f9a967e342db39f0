"""Trespass: what a policy's code does that looks for, or changes, what is not its own."""

import functools
import gc
import inspect
import os
import site
import sys
import sysconfig
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

_PACKAGE = __name__.partition(".")[0] + "."
_FUNCTIONS = (FunctionType, property, classmethod, staticmethod)
_LIBRARIES = [site.getusersitepackages()]
_LIBRARIES += [sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")]


class Trespass:
    """Tells by name what a policy does beyond its own, in the process that runs it.

    There, that is in vain: no world and no verdict are in that process. Searches are heard where
    code of the policy calls for them; libraries call for such, too, and are not meant. Who hides
    what he does is not named.
    """

    def __init__(self) -> None:
        """Listen from now on, as long as the process lives."""
        self._heard: dict[tuple[str, str], None] = {}
        """Files that called for searches, and for which, in order."""
        self._own, self._others = "", tuple[str, ...]()
        self._found = list[str]()
        self._told = set[str]()
        self._before: dict[ModuleType | type, dict[str, object]] = {}
        self._frame = sys._getframe
        sys._getframe = self._getframe
        for function in (gc.get_objects, gc.get_referrers):
            setattr(gc, function.__name__, self._overheard(function))
        self.look()

    def mind(self, file: str) -> None:
        """Tell what the code of a file does, and of those in its folder that are no library."""
        folder = _start(str(Path(file).parent))
        libraries = [_start(path) for path in (*_LIBRARIES, *sys.path)]
        alone = folder in map(_start, _LIBRARIES)
        self._own = os.path.realpath(file) if alone else folder
        self._others = tuple(it for it in libraries if it != folder and it.startswith(folder))

    def told(self) -> list[str]:
        """Return what it has done and was not told before."""
        heard = [f"calls {what}" for file, what in self._heard if self._is_own(file)]
        new = [it for it in dict.fromkeys((*heard, *self._found)) if it not in self._told]
        self._heard, self._found = {}, []
        self._told.update(new)
        return new

    def look(self) -> None:
        """Look for functions of the package that were replaced, which takes some 10 ms."""
        modules = [it for name, it in list(sys.modules.items()) if f"{name}.".startswith(_PACKAGE)]
        files = {getattr(module, "__file__", None) for module in modules}
        for module in modules:
            kinds = [it for it in list(vars(module).values()) if isinstance(it, type)]
            holders: list[ModuleType | type] = [module]
            holders += [it for it in kinds if it.__module__ == module.__name__]
            for holder in holders:
                name = holder.__name__.rpartition(".")[2]
                self._found += [f"replaces {name}.{one}" for one in self._changed(holder, files)]

    def _changed(self, holder: ModuleType | type, files: set[str | None]) -> Iterator[str]:
        now, before = dict(vars(holder)), self._before.get(holder)
        if before is None:
            before = {name: it for name, it in now.items() if isinstance(it, _FUNCTIONS)}
            self._before[holder] = before
            # It was loaded after the last look, and may have been changed since.
            for name, it in before.items():
                file = it.__code__.co_filename if isinstance(it, FunctionType) else None
                if file is not None and file not in files and self._is_own(file):
                    yield name
        yield from (name for name, it in before.items() if now.get(name) is not it)

    def _overheard(self, function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def asked(*args: Any, **options: Any) -> Any:
            self._hear(f"gc.{function.__name__}")
            return function(*args, **options)

        return asked

    def _getframe(self, depth: int = 0, /) -> Any:
        self._hear("sys._getframe")
        return self._frame(depth + 1)

    def _hear(self, function: str) -> None:
        caller: Any = self._frame(2)
        while caller is not None and caller.f_code.co_filename == inspect.__file__:
            caller = caller.f_back
        if caller is not None:
            self._heard[caller.f_code.co_filename, function] = None

    def _is_own(self, file: str) -> bool:
        path = os.path.realpath(file)
        known = bool(self._own) and not file.startswith("<")
        return known and path.startswith(self._own) and not path.startswith(self._others)


def _start(folder: str) -> str:
    return os.path.realpath(folder).rstrip(os.sep) + os.sep
