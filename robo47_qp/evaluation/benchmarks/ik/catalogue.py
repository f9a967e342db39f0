"""Catalogue of the solvers and target sets that can be compared."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from mink import SE3

from robo47_qp.errors import MissingExtraError
from robo47_qp.evaluation.benchmarks.ik.comparison import Field
from robo47_qp.evaluation.benchmarks.ik.judge import Judge
from robo47_qp.evaluation.benchmarks.ik.peers.drake import DrakeIk
from robo47_qp.evaluation.benchmarks.ik.peers.optik import OptikIk
from robo47_qp.evaluation.benchmarks.ik.peers.pink import PinkIk
from robo47_qp.evaluation.benchmarks.ik.peers.toolbox import ToolboxIk
from robo47_qp.evaluation.benchmarks.ik.targets import near_limits, near_singular, tabletop, uniform
from robo47_qp.evaluation.benchmarks.ik.unreachable import hostile, unreachable
from robo47_qp.ik.dls import TUNED, DlsIk
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import IkSolver, Tolerance
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robot import Robot

TOLERANCE = Tolerance()
"""Tolerance at which every solver may stop."""
SINGLE, STARTS, EACH = 200, 201, 30
"""Budgets of all solvers: iterations of a single start; starts, and iterations of each."""
CLEARANCE = 0.005
"""Distance between links that the solver "clear" keeps [m]."""
TABLE = Obstacle(
    name="table",
    shape=Shape.BOX,
    size=(0.60, 0.60, 0.02),
    T_world_obstacle=SE3.from_translation(np.array([0.30, 0.0, -0.02])),
)
"""Table in front of the robot, its top at the height of the base."""
_DLS_OR_QP = ("dls", "dls-clip", "dls-tuned", "mink", "qp-daqp")
FIRST_SOLVERS = (*_DLS_OR_QP, *(f"{name}-multi" for name in _DLS_OR_QP))
"""What answers "DLS or QP?": both from one start, then with restarts."""
FIRST_SETS = ("uniform", "near_limits")
"""Target sets of that answer."""
QUESTIONS = (
    ("dls", "dls-clip"),
    ("dls-clip", "dls-tuned"),
    ("dls-tuned-free", "dls-tuned"),
    ("dls-tuned", "qp-daqp"),
    ("qp-daqp", "mink"),
    ("qp-daqp", "qp-osqp"),
    ("qp-daqp", "lm"),
    ("dls-tuned", "dls-tuned-multi"),
    ("qp-daqp", "qp-daqp-multi"),
    ("dls-tuned-multi", "qp-daqp-multi"),
    ("mink", "mink-multi"),
    ("qp-daqp-multi", "mink-multi"),
    ("qp-daqp-multi", "default"),
    ("qp-daqp-multi", "fast"),
)
"""Planned comparisons: the effect of limits, of tuning DLS, of the QP, of mink instead of the fused
QP, of its backend, of restarts, of the QP when there are restarts, and of stopping stalled starts
early."""


def solvers() -> dict[str, IkSolver]:
    """Return all solvers by name: each alone, each with restarts, and the package's defaults.

    The last four have the same number of starts; they stop a start that stalls and continue the
    closest ones. "default" is by mink itself, "fused" the same problem without mink. "clear" also
    keeps a clearance between the links.
    """

    def each(steps: int) -> dict[str, IkSolver]:
        dls = DlsIk(max_iterations=steps, tolerance=TOLERANCE)
        tuned = replace(TUNED, max_iterations=steps, tolerance=TOLERANCE)
        qp = QpIk(max_iterations=steps, tolerance=TOLERANCE)
        return {
            "dls-position": replace(dls, position_only=True, clip=False, wrap=True),
            "dls": replace(dls, clip=False, wrap=True),
            "dls-clip": dls,
            "dls-tuned-free": replace(tuned, clip=False, wrap=True),
            "dls-tuned": tuned,
            "mink": MinkIk(max_iterations=steps, tolerance=TOLERANCE),
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
        "default": MultiStart(
            solver=MinkIk(max_iterations=EACH, stall=Stall(), tolerance=TOLERANCE),
            max_restarts=STARTS - 1,
        ),
        "fused": MultiStart(solver=qp, max_restarts=STARTS - 1),
        "fast": MultiStart(solver=lm, max_restarts=STARTS - 1, seed_first=False),
        "clear": MultiStart(solver=replace(qp, clearance=CLEARANCE), max_restarts=STARTS - 1),
    }
    return each(SINGLE) | again | own


def peers() -> tuple[dict[str, IkSolver], dict[str, str]]:
    """Return the solvers of other packages by name, and why missing ones are left out.

    Drake and Pink get the same starts as all others; OptIK and Robotics Toolbox draw as many
    restarts themselves.
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
    installed: dict[str, IkSolver] = {}
    left_out: dict[str, str] = {}
    for name, make in makers.items():
        try:
            installed[name] = make()
        except MissingExtraError as error:
            left_out[name] = str(error)
    return installed, left_out


def target_sets(robot: Robot) -> dict[str, Field]:
    """Return all target sets by name; only "tabletop" has a table in its scene."""
    alone, at_table = Judge(robot), Judge(robot, [TABLE])
    makers = {
        "uniform": uniform,
        "tabletop": tabletop,
        "near_limits": near_limits,
        "near_singular": near_singular,
        "unreachable": unreachable,
        "hostile": hostile,
    }
    return {
        name: Field(make=make, judge=at_table if make is tabletop else alone)
        for name, make in makers.items()
    }
