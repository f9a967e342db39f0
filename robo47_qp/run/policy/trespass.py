"""Trespass: what a policy's code does that only looks for, or changes, what is not its own."""

import inspect
import os
import sys
import sysconfig
from collections.abc import Iterator
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
_FOLDERS = [_PACKAGE, _PACKAGE / "tasks"]
_FOLDERS += [Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib")]
_LIBRARIES = tuple({f"{path}{os.sep}" for it in _FOLDERS for path in (it, it.resolve())})


class Trespass:
    """Tells by name what a policy does beyond its own, in the process that runs it.

    There it is in vain: no world and no verdict are in that process. Python's audit events tell the
    searches (PEP 578); libraries may make them, and code that they run. It does not stop one who
    hides what he does.
    """

    def __init__(self) -> None:
        """Listen from now on, as long as the process lives."""
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
            changed = next(_changes(), None)
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
        if caller is not None and _is_foreign(caller.f_code):
            self._heard = _SEARCHES[event]
        self._listening = True


def _changes() -> Iterator[str]:
    """Yield the names of what foreign code has put in the package's modules and classes."""
    modules = [it for name, it in list(sys.modules.items()) if name.startswith("robo47_qp.")]
    for module in modules:
        kinds = [it for it in vars(module).values() if isinstance(it, type)]
        own = [kind for kind in kinds if kind.__module__ == module.__name__]
        holders: list[ModuleType | type] = [module, *own]
        for holder in holders:
            for name, value in vars(holder).items():
                code = getattr(
                    inspect.unwrap(value) if callable(value) else value, "__code__", None
                )
                if isinstance(code, CodeType) and _is_foreign(code):
                    yield f"{_name(holder)}.{name}"


def _is_foreign(code: CodeType) -> bool:
    file = code.co_filename
    return not file.startswith("<") and not file.startswith(_LIBRARIES)


def _name(holder: ModuleType | type) -> str:
    return holder.__name__ if isinstance(holder, ModuleType) else holder.__qualname__
