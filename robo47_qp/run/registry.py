"""Registry of tasks: those of installed packages by name, others by module:Class."""

from importlib.metadata import EntryPoint, entry_points
from typing import cast

from robo47_qp.constants import TASKS
from robo47_qp.errors import UnknownNameError
from robo47_qp.run.foreign_code import load_class
from robo47_qp.run.task import Task


def task_names() -> tuple[str, ...]:
    """Return the names of the tasks of all installed packages, sorted."""
    return tuple(sorted(_offered()))


def load_task(name: str) -> type[Task]:
    """Return the class of a task named as in `task_names`, or module:Class, or file.py:Class.

    Raises:
        UnknownNameError: No task has this name.
        ClassLoadError: The class cannot be loaded, or it is not a task.
    """
    offered = _offered()
    if ":" not in name and name not in offered:
        raise UnknownNameError("task", name, (*sorted(offered), "module:Class", "file.py:Class"))
    reference = name if ":" in name else f"{offered[name].module}:{offered[name].attr}"
    found = load_class("task", reference, ("build_scene", "program", "verdict"), sorted(offered))
    return cast("type[Task]", found)


def _offered() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=TASKS)}
