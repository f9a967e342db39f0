"""Trespass: what a policy's code does that looks for, or changes, what is not its own."""

import inspect
import os
import site
import sys
import sysconfig
from importlib.machinery import ModuleSpec
from operator import is_
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

_PACKAGE = __name__.partition(".")[0] + "."
_SEARCHES = frozenset(
    [f"gc.get_{what}" for what in ("objects", "referrers", "referents")]
    + [f"sys.{what}" for what in ("_getframe", "_current_frames", "_current_exceptions")]
    + [f"sys.set{what}" for what in ("trace", "profile")]
)
_FRAMES = frozenset(["tb_frame", "gi_frame", "cr_frame", "ag_frame"])
"""Attributes by which an error, a generator or a coroutine gives its frame away."""
_WORLDS = frozenset(f"{_PACKAGE}evaluation.{name}" for name in ("task_episode", "perturbation"))
"""Modules that draw the worlds of an evaluation from its seeds."""
_FUNCTIONS = (FunctionType, property, classmethod, staticmethod)
_CONSTANTS = (bool, int, float, str, bytes, tuple, frozenset, type(None))
_LIBRARIES = [site.getusersitepackages()]
_LIBRARIES += [sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")]


class Trespass:
    """Tells by name what a policy does beyond its own, in the process that runs it.

    There, that is in vain: no world and no verdict are in that process. Searches are heard, as
    Python's audit events, where code of the policy calls for them; libraries call for such, too,
    and are not meant. Who hides what he does is not named.
    """

    def __init__(self) -> None:
        """Listen from now on, as long as the process lives."""
        self._heard: dict[tuple[str, str], None] = {}
        """Files of which the code searched, and how, in order."""
        self._own, self._others = "", tuple[str, ...]()
        self._found = list[str]()
        self._told = set[str]()
        self._before: dict[ModuleType | type, dict[str, list[object]]] = {}
        self._busy = False
        for name, module in list(sys.modules.items()):
            if f"{name}.".startswith(_PACKAGE):
                self._remember(module)
        sys.meta_path.insert(0, self)
        sys.addaudithook(self._listen)

    def mind(self, file: str) -> None:
        """Tell what the code of a file does, and of those in its folder that are no library."""
        folder = _start(str(Path(file).parent))
        libraries = [_start(path) for path in (*_LIBRARIES, *sys.path)]
        alone = folder in map(_start, _LIBRARIES)
        self._own = os.path.realpath(file) if alone else folder
        self._others = tuple(it for it in libraries if it != folder and it.startswith(folder))

    def told(self) -> list[str]:
        """Return what it has done and was not told before."""
        heard = [what for file, what in self._heard if self._is_own(file)]
        new = [it for it in dict.fromkeys((*heard, *self._found)) if it not in self._told]
        self._heard, self._found = {}, []
        self._told.update(new)
        return new

    def look(self) -> None:
        """Look for what was replaced in the package, functions and numbers, which takes 10 ms."""
        self._busy = True
        for holder, before in self._before.items():
            place, now = holder.__name__.rpartition(".")[2], dict(vars(holder))
            for name, parts in before.items():
                found = _parts(now.get(name))
                if len(found) != len(parts) or not all(map(is_, found, parts)):
                    self._found.append(f"replaces {place}.{name}")
        self._busy = False

    def find_spec(self, name: str, path: Any, target: Any = None) -> ModuleSpec | None:
        """Have a module of the package remembered as it is loaded; a finder of `sys.meta_path`."""
        if not name.startswith(_PACKAGE):
            return None
        if name in _WORLDS:
            self._hear(f"imports {name}")
        others = [finder for finder in sys.meta_path if finder is not self]
        found = (it.find_spec(name, path, target) for it in others if hasattr(it, "find_spec"))
        spec = next(filter(None, found), None)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def remembered(module: ModuleType) -> None:
                execute(module)
                self._remember(module)

            spec.loader.exec_module = remembered  # type: ignore[method-assign]
        return spec

    def _remember(self, module: ModuleType) -> None:
        self._busy = True
        kinds = [it for it in vars(module).values() if isinstance(it, type)]
        holders: list[ModuleType | type] = [module]
        holders += [it for it in kinds if it.__module__ == module.__name__]
        for holder in holders:
            stay = {name: it for name, it in vars(holder).items() if _stays(holder, name, it)}
            self._before[holder] = {name: _parts(it) for name, it in stay.items()}
        self._busy = False

    def _listen(self, event: str, given: tuple[Any, ...]) -> None:
        """Take in one of the events of Python, which come often."""
        if event in _SEARCHES:
            self._hear(f"calls {event}")
        elif event == "object.__getattr__" and given[1] in _FRAMES:
            self._hear(f"reads {given[1]}")

    def _hear(self, what: str) -> None:
        if self._busy:
            return
        self._busy = True
        caller: Any = sys._getframe(2)
        self._busy = False
        while caller is not None and _speaks_for_another(caller.f_code.co_filename):
            caller = caller.f_back
        if caller is not None:
            self._heard[caller.f_code.co_filename, what] = None

    def _is_own(self, file: str) -> bool:
        path = os.path.realpath(file)
        known = bool(self._own) and not file.startswith("<")
        return known and path.startswith(self._own) and not path.startswith(self._others)


def _stays(holder: ModuleType | type, name: str, it: object) -> bool:
    """Return whether something in a module or class is not to change: a function or a constant."""
    if isinstance(it, _FUNCTIONS):
        return True
    constant = name.isupper() if isinstance(holder, ModuleType) else not name.startswith("__")
    return constant and isinstance(it, _CONSTANTS)


def _parts(it: object) -> list[object]:
    """Return an object with all that makes a function do what it does."""
    if isinstance(it, property):
        return [it, *_parts(it.fget)]
    if isinstance(it, classmethod | staticmethod):
        return [it, *_parts(it.__func__)]
    if not isinstance(it, FunctionType):
        return [it]
    options = it.__kwdefaults__ or {}
    return [it, it.__code__, it.__defaults__, *options, *options.values()]


def _speaks_for_another(file: str) -> bool:
    """Return whether code of a file is run for its caller: executed text, imports, `inspect`."""
    return file == inspect.__file__ or file.startswith("<")


def _start(folder: str) -> str:
    return os.path.realpath(folder).rstrip(os.sep) + os.sep
