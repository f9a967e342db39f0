"""Code from outside the package: classes loaded by reference, and a guard around their errors."""

import importlib.util
import pkgutil
import sys
import traceback
from collections.abc import Callable, Sequence
from hashlib import sha256
from inspect import signature
from pathlib import Path
from types import ModuleType
from typing import Any

from robo47_qp.errors import Robo47Error


class Guard:
    """Catches exceptions of code from outside the package in a `with` block.

    `SystemExit` is caught, too; KeyboardInterrupt passes through.
    """

    def __init__(self) -> None:
        self.error: Exception | SystemExit | None = None
        """The exception; None without one."""

    def __enter__(self) -> "Guard":
        """Return the guard."""
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        """Keep the exception."""
        if isinstance(error, Exception | SystemExit):
            self.error = error
        return self.error is not None

    @property
    def words(self) -> str:
        """The traceback."""
        error = self.error
        return "" if error is None else "".join(traceback.format_exception(error)).rstrip()


class TaskError(Robo47Error):
    """Code of a task that raised an error: the robot has not failed, and nothing is judged."""


class Blamed:
    """Turns what the code of a task raises in a `with` block into a `TaskError` with its place.

    What is raised with no part of that code under way passes through.
    """

    def __init__(self, kind: type, passed: tuple[type[Exception], ...] = (Robo47Error,)) -> None:
        """Take the class of a task, and the errors that pass through all the same."""
        self._kind, self._passed = kind, passed

    def __enter__(self) -> None:
        """Begin."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """Raise the `TaskError`.

        Raises:
            TaskError: There was an error in code of the task.
        """
        if not isinstance(error, Exception) or isinstance(error, (TaskError, *self._passed)):
            return
        own = {getattr(sys.modules[m], "__file__", None) for m in _modules(self._kind)}
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename in own]
        if frames:
            name = getattr(self._kind, "name", None)
            name = name if isinstance(name, str) else self._kind.__name__
            part = frames[0].name if frames[0].name.isidentifier() else "code"
            where = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}"
            words = str(error).removesuffix(".") or "no reason given"
            raise TaskError(
                f"The {part} of {name} raised {type(error).__name__}: {words}, at {where}."
            ) from error


def _modules(kind: type) -> list[str]:
    """Return the modules that define a task, without those of what all tasks derive from."""
    common = ("robo47_qp.run.task", "robo47_qp.arrays")
    return [c.__module__ for c in kind.__mro__ if c.__module__ not in common]


class ClassLoadError(Robo47Error):
    """A class that cannot be loaded from its module or file."""

    def __init__(self, kind: str, reference: str, why: str, known: Sequence[str] = ()) -> None:
        """Name the reference, why it cannot be loaded, and what else is known."""
        names = f", or {', '.join(known)}" if known else ""
        super().__init__(
            f"The {kind} {reference!r} cannot be loaded: {why}. Name it module:Class or "
            f"file.py:Class, a class that can be made without arguments{names}."
        )
        self.reference = reference


def load_class(
    kind: str, reference: str, methods: Sequence[str], known: Sequence[str] = ()
) -> Callable[[], Any]:
    """Load a class of a module or of a file.

    Args:
        kind: For messages, such as "policy".
        reference: module:Class, or path/to/file.py:Class.
        methods: Methods that the class must have.
        known: Other names that would work, for messages.

    Raises:
        ClassLoadError: There is no such module, file or class, or it lacks a method, or it
            cannot be made without arguments.
    """
    place, _, name = reference.rpartition(":")
    if not place or not name.isidentifier():
        raise ClassLoadError(kind, reference, "it names no place and class", known)
    with Guard() as guard:
        of_file = place.endswith(".py")
        module = file_module(Path(place)) if of_file else pkgutil.resolve_name(place)
        found = getattr(module, name, None)
    if guard.error is not None:
        why = f"{type(guard.error).__name__}: {guard.error}"
        raise ClassLoadError(kind, reference, why, known) from guard.error
    if found is None:
        raise ClassLoadError(kind, reference, f"{place} has no {name}", known)
    missing = [method for method in methods if not hasattr(found, method)]
    if missing or not isinstance(found, type):
        why = f"it has no {' and no '.join(missing)}" if missing else "it is no class"
        raise ClassLoadError(kind, reference, why, known)
    with Guard() as guard:
        signature(found).bind()
    if guard.error is not None:
        why = f"it cannot be made without arguments: {guard.error}"
        raise ClassLoadError(kind, reference, why, known)
    return found


def absolute(reference: str) -> str:
    """Return a reference that holds in any working directory."""
    place, _, name = reference.rpartition(":")
    return f"{Path(place).resolve()}:{name}" if place.endswith(".py") else reference


def loaded_files() -> tuple[Path, ...]:
    """Return the files of which `file_module` has loaded a module in this process."""
    return tuple(_FILES)


def files_beside(file: str) -> list[str]:
    """Return a module's file and those of all loaded modules in its folder, sorted."""
    folder = Path(file).parent
    loaded = [(name, getattr(module, "__file__", None)) for name, module in sys.modules.items()]
    beside = {one for name, one in loaded if one and name != "__main__"}
    return sorted({file, *(one for one in beside if Path(one).parent == folder)})


def file_module(path: Path) -> ModuleType:
    """Return the module of a file, the same one every time in a process.

    Its name is the same in every process: what it defines can be unpickled once it is loaded.
    """
    path = path.resolve(strict=True)
    name = f"file_{sha256(str(path).encode()).hexdigest()[:16]}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        if spec is None or spec.loader is None:
            raise ImportError(f"{path} is no Python file")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        try:
            spec.loader.exec_module(module)
            _FILES.append(path)
        finally:
            # Half of a module is none.
            if path not in _FILES:
                del sys.modules[name]
    return sys.modules[name]


_FILES: list[Path] = []
