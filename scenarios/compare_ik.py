"""Inverse kinematics compared: damped least squares, QP, restarts, on paired targets."""

import sys
from dataclasses import replace

from rich.console import Console

from robo47_qp.arm import Arm
from robo47_qp.command import main
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import IkSolver, Tolerance
from robo47_qp.ik_benchmark.compare import compare
from robo47_qp.ik_benchmark.comparison import Comparison, Field
from robo47_qp.ik_benchmark.judge import Judge
from robo47_qp.ik_benchmark.options import CompareOptions, chosen
from robo47_qp.ik_benchmark.targets import near_limits, near_singular, tabletop, uniform
from robo47_qp.ik_benchmark.unreachable import hostile, unreachable
from robo47_qp.robots.panda import PANDA
from tasks.table import add_table

ROBOT = PANDA
TOLERANCE = Tolerance()
"""Where every solver may stop."""
SINGLE, RESTARTS, EACH = 200, 50, 30
"""Budgets, the same for all: steps of a single start; restarts, and steps of each start."""
QUESTIONS = (
    ("dls", "dls-clip"),
    ("dls-clip", "qp-daqp"),
    ("qp-daqp", "qp-osqp"),
    ("dls-clip", "dls-clip-multi"),
    ("qp-daqp", "qp-daqp-multi"),
    ("dls-clip-multi", "qp-daqp-multi"),
    ("qp-daqp-multi", "qp-osqp-multi"),
)
"""Do limits help, does the QP, does its solver matter, do restarts, and does it all matter
once there are restarts?"""


def solvers() -> dict[str, IkSolver]:
    """All solvers by name: each alone, then with restarts."""

    def each(steps: int) -> dict[str, IkSolver]:
        dls = DlsIk(max_iterations=steps, tolerance=TOLERANCE)
        qp = QpIk(max_iterations=steps, tolerance=TOLERANCE)
        return {
            "dls-position": replace(dls, position_only=True, clip=False),
            "dls": replace(dls, clip=False),
            "dls-clip": dls,
            "qp-daqp": replace(qp, backend="daqp"),
            "qp-osqp": replace(qp, backend="osqp"),
        }

    again = {
        f"{name}-multi": MultiStart(solver=solver, max_restarts=RESTARTS)
        for name, solver in each(EACH).items()
    }
    return each(SINGLE) | again


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
    comparison = Comparison(
        arm=Arm(ROBOT),
        solvers=chosen("solver", solvers(), options.solvers),
        fields=chosen("target set", fields(), options.targets),
        n=options.n,
        seed=options.seed,
        start=options.start_at,
    )
    return compare(comparison, options, console, left_out={}, questions=QUESTIONS)


if __name__ == "__main__":
    sys.exit(main(CompareOptions, run, __doc__))
