"""A task's world as a libfranka robot: unmodified clients of libfranka find an FR3 with a hand.

Robot and hand answer at the ports 1337 and 1338 of an address of this machine. Every client finds
the start of the task anew; when it leaves, the task judges the world.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from rich.console import Console
from rich.markup import escape

from robo47_qp.arrays import CheckedOptions, CountOrZero
from robo47_qp.cli import FAILED, OK, TaskOption, main, one_of, unset
from robo47_qp.model.robots import load_robot
from robo47_qp.run.registry import load_task
from robo47_qp.run.start import checked_start
from robo47_qp.sim.franka.server import FrankaServer

_ROBOTS = ("fr3", "panda")
"""Robots that can be served."""


@dataclass(frozen=True, kw_only=True)
class ServeOptions(CheckedOptions, TaskOption):
    """Options of the server."""

    robot: Annotated[str, one_of(_ROBOTS)] = "fr3"
    """Robot that is served. What commands are checked against are the limits of the FR3."""
    seed: Annotated[CountOrZero | None, unset("INT")] = None
    """Seed of the task's random start; without it, the default one."""
    host: str = "127.0.0.1"
    """Address to bind: by default only this machine can connect."""
    lock_step: bool = False
    """Let a period of a motion pass when its command has come, however long that takes, and none
    while nothing moves: two runs of a client are equal, on a loaded machine, too. Without it, a
    period takes a millisecond, and a command that has not come is lost."""
    once: bool = False
    """End when the first client has left: with 0 if the task counts as done, else with 1."""


def serve_command(args: Sequence[str] | None = None, prog: str | None = None) -> int:
    """Serve from the command line, and return the exit code; see `robo47_qp.cli.main`."""
    return main(ServeOptions, serve_chosen, __doc__, args=args, prog=prog)


def serve_chosen(options: ServeOptions, console: Console) -> int:
    """Serve what was chosen until Ctrl-C or SIGTERM, or until the first client has left.

    Raises:
        InvalidValueError: The address cannot be bound, or the task does not suit the robot.
    """
    task = load_task(options.task)()
    simulation = checked_start(task, load_robot(options.robot), options.seed)
    seed, code = options.seed, OK

    def reset() -> None:
        simulation.reset()
        task.reset(simulation, None if seed is None else np.random.default_rng(seed))

    def left() -> bool:
        nonlocal code
        failure = task.verdict(simulation)
        code = OK if failure is None else FAILED
        told = "done" if failure is None else f"not done: {failure.evidence}"
        console.print(f"the client has left after {simulation.time:.3f} s; {escape(told)}")
        return options.once

    pace = "in lock-step" if options.lock_step else "at 1 kHz"
    server = FrankaServer(
        simulation,
        reset,
        options.host,
        lock_step=options.lock_step,
        left=left,
        monitor=lambda: task.monitor(simulation),
    )
    with server:
        console.print(
            f"{task.name} with {options.robot} at {options.host}, ports 1337 and 1338, {pace}; "
            "Ctrl-C ends it",
            soft_wrap=True,
        )
        sys.stdout.flush()
        try:
            server.serve()
        except KeyboardInterrupt:
            console.print("ended")
    return code
