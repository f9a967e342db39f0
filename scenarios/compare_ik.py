"""Inverse kinematics compared: damped least squares, QP, restarts, on paired targets."""

import sys
from collections.abc import Callable
from dataclasses import replace

from rich.console import Console

from robo47_qp.cli import main
from robo47_qp.errors import MissingExtraError
from robo47_qp.evaluation.benchmarks.ik.compare import compare
from robo47_qp.evaluation.benchmarks.ik.comparison import Comparison, Field
from robo47_qp.evaluation.benchmarks.ik.judge import Judge
from robo47_qp.evaluation.benchmarks.ik.options import CompareOptions, chosen
from robo47_qp.evaluation.benchmarks.ik.peers.drake import DrakeIk
from robo47_qp.evaluation.benchmarks.ik.peers.optik import OptikIk
from robo47_qp.evaluation.benchmarks.ik.peers.pink import PinkIk
from robo47_qp.evaluation.benchmarks.ik.peers.toolbox import ToolboxIk
from robo47_qp.evaluation.benchmarks.ik.targets import (
    near_limits,
    near_singular,
    tabletop,
    uniform,
)
from robo47_qp.evaluation.benchmarks.ik.unreachable import hostile, unreachable
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.settings import Stall
from robo47_qp.ik.solver import IkSolver, Tolerance
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.tasks.table import add_table

ROBOT = PANDA
TOLERANCE = Tolerance()
"""Where every solver may stop."""
SINGLE, STARTS, EACH = 200, 101, 30
"""Budgets, the same for all: steps of a single start; starts, and steps of each of them."""
CLEARANCE = 0.005
"""What one of the solvers keeps between the links [m]."""
QUESTIONS = (
    ("dls", "dls-clip"),
    ("dls-clip", "qp-daqp"),
    ("qp-daqp", "qp-osqp"),
    ("qp-daqp", "lm"),
    ("dls-clip", "dls-clip-multi"),
    ("qp-daqp", "qp-daqp-multi"),
    ("dls-clip-multi", "qp-daqp-multi"),
    ("qp-daqp-multi", "default"),
    ("qp-daqp-multi", "fast"),
)
"""Do limits help, does the QP, does its solver matter, do restarts, does the QP once there are
restarts, and what does giving up early cost?"""


def solvers() -> dict[str, IkSolver]:
    """All solvers by name: each alone, each with restarts, and the package's own choices.

    The last three have as many starts; they give a start up once it is stuck, and take the
    closest ends up again. The very last keeps the links 5 mm apart from one another.
    """

    def each(steps: int) -> dict[str, IkSolver]:
        dls = DlsIk(max_iterations=steps, tolerance=TOLERANCE)
        qp = QpIk(max_iterations=steps, tolerance=TOLERANCE)
        return {
            "dls-position": replace(dls, position_only=True, clip=False),
            "dls": replace(dls, clip=False),
            "dls-clip": dls,
            "qp-daqp": replace(qp, backend="daqp"),
            "qp-osqp": replace(qp, backend="osqp"),
            "lm": LmIk(max_iterations=steps, tolerance=TOLERANCE),
        }

    again: dict[str, IkSolver] = {
        f"{name}-multi": MultiStart(solver=solver, max_restarts=STARTS - 1)
        for name, solver in each(EACH).items()
    }
    qp = QpIk(max_iterations=EACH, stall=Stall(), tolerance=TOLERANCE)
    lm = LmIk(max_iterations=EACH, stall=Stall(), tolerance=TOLERANCE)
    own: dict[str, IkSolver] = {
        "default": MultiStart(solver=qp, max_restarts=STARTS - 1),
        "fast": MultiStart(solver=lm, max_restarts=STARTS - 1, seed_first=False),
        "clear": MultiStart(solver=replace(qp, clearance=CLEARANCE), max_restarts=STARTS - 1),
    }
    return each(SINGLE) | again | own


def peers() -> tuple[dict[str, IkSolver], dict[str, str]]:
    """Solvers of other packages by name, and why which are left out.

    Drake and Pink get the same starts as all others; OptIK and Robotics Toolbox have restarts
    of their own, as many.
    """
    makers: dict[str, Callable[[], IkSolver]] = {
        "drake": lambda: DrakeIk(max_iterations=SINGLE),
        "pink": lambda: PinkIk(max_iterations=SINGLE, tolerance=TOLERANCE),
        "drake-multi": lambda: MultiStart(
            solver=DrakeIk(max_iterations=EACH), max_restarts=STARTS - 1
        ),
        "pink-multi": lambda: MultiStart(
            solver=PinkIk(max_iterations=EACH, tolerance=TOLERANCE), max_restarts=STARTS - 1
        ),
        "optik": lambda: OptikIk(max_restarts=STARTS - 1, tolerance=TOLERANCE),
        "toolbox": lambda: ToolboxIk(max_iterations=EACH, starts=STARTS, tolerance=TOLERANCE),
    }
    there: dict[str, IkSolver] = {}
    left_out: dict[str, str] = {}
    for name, make in makers.items():
        try:
            there[name] = make()
        except MissingExtraError as error:
            left_out[name] = str(error)
    return there, left_out


def fields() -> dict[str, Field]:
    """All target sets by name; the table is there where work is done on it."""
    alone, at_table = Judge(ROBOT), Judge(ROBOT, add_table)
    return {
        "uniform": Field(make=uniform, judge=alone),
        "tabletop": Field(make=tabletop, judge=at_table),
        "near_limits": Field(make=near_limits, judge=alone),
        "near_singular": Field(make=near_singular, judge=alone),
        "unreachable": Field(make=unreachable, judge=alone),
        "hostile": Field(make=hostile, judge=alone),
    }


def run(options: CompareOptions, console: Console) -> int:
    """Run the scenario; returns the exit code."""
    others, left_out = peers() if options.peers else ({}, {})
    comparison = Comparison(
        arm=Arm(ROBOT),
        solvers=chosen("solver", solvers() | others, options.solvers),
        fields=chosen("target set", fields(), options.targets),
        n=options.n,
        seed=options.seed,
        start=options.start_at,
    )
    return compare(comparison, options, console, left_out=left_out, questions=QUESTIONS)


if __name__ == "__main__":
    sys.exit(main(CompareOptions, run, __doc__))
