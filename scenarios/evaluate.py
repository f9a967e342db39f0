"""A task evaluated: many episodes under one policy or several, on paired seeds."""

import pkgutil
import sys
from dataclasses import is_dataclass
from functools import partial
from typing import cast

from rich.console import Console

from robo47_qp import tasks
from robo47_qp.errors import UnknownNameError
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.policy.drivers import PolicyDriver, check_judged
from robo47_qp.run.task import Task
from robo47_qp.sim.simulation import Simulation


def known_tasks() -> dict[str, type[Task]]:
    """Every task in the folder of tasks, by name."""
    found: dict[str, type[Task]] = {}
    for module in pkgutil.walk_packages(tasks.__path__, f"{tasks.__name__}."):
        for member in vars(pkgutil.resolve_name(module.name)).values():
            if isinstance(member, type) and member.__module__ == module.name:
                name = getattr(member, "name", None)
                if is_dataclass(member) and hasattr(member, "program") and isinstance(name, str):
                    found[name] = cast("type[Task]", member)
    return found


def run(options: EvaluateOptions, console: Console) -> int:
    """Run the scenario; returns the exit code."""
    # Every worker imports this file: plots and recordings are for the main process alone.
    from robo47_qp.evaluation.evaluate import evaluate

    known = known_tasks()
    if options.task not in known:
        raise UnknownNameError("task", options.task, known)
    task = known[options.task]()
    if any(contender.ik is None for contender in options.contenders):
        check_judged(task, Simulation(PANDA, task.build_scene))
    return evaluate(task, PANDA, options, console, partial(PolicyDriver, timing=options.timing))


if __name__ == "__main__":
    from robo47_qp.cli import main

    sys.exit(main(EvaluateOptions, run, __doc__, repeated=True))
