"""Trespass: what a policy's code does that only looks for, or changes, what is not its own."""

import contextlib
import importlib.util
import inspect
import os
import site
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any

_SEARCHES = {
    "gc.get_objects": "it went through all objects (gc.get_objects)",
    "gc.get_referrers": "it went through who holds an object (gc.get_referrers)",
    "sys._getframe": "it went through the frames of its callers (sys._getframe)",
    "sys._current_frames": "it went through the frames of all threads (sys._current_frames)",
}
_PACKAGE = Path(__file__).parents[2]
# To the tasks, a link in the package leads.
_LIBRARIES = [_PACKAGE, _PACKAGE / "tasks", *map(Path, site.getsitepackages())]
_LIBRARIES += [Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib")]


class Trespass:
    """Tells by name what a policy does beyond its own, in the process that runs it.

    There it is in vain: no world and no verdict are in that process. Python's audit events tell the
    searches (PEP 578). Only code in the policy's folder is meant, as libraries make them, too. It
    does not stop one who hides what he does.
    """

    def __init__(self, place: str) -> None:
        """Listen from now on, as long as the process lives.

        Args:
            place: File of the policy, or name of its module.
        """
        self._own = _starts(_folders(place))
        # Libraries are often installed beside it.
        self._others = tuple(it for it in _starts(_LIBRARIES) if it.startswith(self._own))
        self._heard: str | None = None
        self._listening = True
        sys.addaudithook(self._hear)

    def told(self, *, thoroughly: bool) -> str | None:
        """Return what it has done since the last call; None if nothing.

        Args:
            thoroughly: Whether to look for changes of the package, too, which takes some time.
        """
        heard, self._heard = self._heard, None
        if heard is None and thoroughly:
            changed = next(self._changes(), None)
            return None if changed is None else f"it replaced {changed} of the package"
        return heard

    def _hear(self, event: str, _: tuple[Any, ...]) -> None:
        if event not in _SEARCHES or not self._listening:
            return
        # Looking for who asks is such an event as well.
        self._listening = False
        caller: FrameType | None = sys._getframe(1)
        while caller is not None and caller.f_code.co_filename == inspect.__file__:
            caller = caller.f_back
        if caller is not None and self._is_own(caller.f_code):
            self._heard = _SEARCHES[event]
        self._listening = True

    def _changes(self) -> Iterator[str]:
        """Yield the names of what the policy has put in the package's modules and classes."""
        modules = [it for name, it in list(sys.modules.items()) if name.startswith("robo47_qp.")]
        for module in modules:
            kinds = [it for it in vars(module).values() if isinstance(it, type)]
            holders: list[ModuleType | type] = [module]
            holders += [kind for kind in kinds if kind.__module__ == module.__name__]
            for holder in holders:
                for name, value in vars(holder).items():
                    function = inspect.unwrap(value) if callable(value) else value
                    code = getattr(function, "__code__", None)
                    if isinstance(code, CodeType) and self._is_own(code):
                        yield f"{holder.__name__.rpartition('.')[2]}.{name}"

    def _is_own(self, code: CodeType) -> bool:
        file = code.co_filename
        return file.startswith(self._own) and not file.startswith(self._others)


def _folders(place: str) -> list[Path]:
    """Return where the files of a policy are."""
    if place.endswith(".py"):
        return [Path(place).parent]
    top, spec = place.partition(".")[0], None
    with contextlib.suppress(ValueError):  # of a name that is none: it is refused when it is loaded
        spec = importlib.util.find_spec(top)
    if spec is None or top == _PACKAGE.name:
        return []
    if spec.submodule_search_locations is not None:
        return [Path(folder) for folder in spec.submodule_search_locations]
    return [] if spec.origin is None else [Path(spec.origin).parent]


def _starts(folders: Iterable[Path]) -> tuple[str, ...]:
    return tuple({f"{path}{os.sep}" for folder in folders for path in (folder, folder.resolve())})
