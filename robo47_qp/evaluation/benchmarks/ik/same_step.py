"""Steps of the fused solvers beside those of mink, and beside the step without rounding."""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import mink
import numpy as np
from mink import SE3
from mink.tasks import BaseTask

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.evaluation.benchmarks.ik.exact_step import exact_step
from robo47_qp.ik.gauss_newton import FLOOR, GaussNewtonIk
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.mended import FrameTask
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.refinement import refined_by_residuals
from robo47_qp.model.arm import Arm


class State(NamedTuple):
    """Where a step is asked for."""

    q: Vector
    """Configuration (n,) [rad]."""
    q_seed: Vector
    """Where the search began (n,) [rad]."""
    target: SE3


class RotationVector(mink.Task):
    """Displacement and rotation vector of the tool, in its own frame: what `LmIk` steps on."""

    def __init__(self, arm: Arm, target: SE3, rows: int, damping: float) -> None:
        """Make the task; with 3 rows the position alone counts."""
        super().__init__(np.ones(rows), lm_damping=damping)
        self.arm, self.target, self.rows = arm, target, rows

    def compute_error(self, configuration: mink.Configuration) -> Vector:
        """Return the error, which falls to zero (rows,) [m, rad]."""
        error: Vector = -self.arm.pose_error(self.target, configuration.q)[: self.rows]
        return error

    def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
        """Return how the error changes per joint (rows, n), as LmIk has it: that of the pose."""
        return self.arm.jacobian(configuration.q)[: self.rows]


def states(arm: Arm, count: int, seed: int = 4) -> Iterator[State]:
    """Yield configurations inside the limits and on them, with targets near and far."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        q, q_seed = rng.uniform(arm.q_low, arm.q_high, (2, arm.n))
        if i % 2:
            on = (rng.random(arm.n) < 0.3) & ~arm.free
            q[on] = np.where(rng.random(arm.n) < 0.5, arm.q_min, arm.q_max)[on]
        way = rng.uniform(-1.0, 1.0, arm.n) * 10.0 ** -rng.uniform(0.0, 4.0)
        yield State(q, q_seed, arm.pose(q + way))


def step_of(solver: GaussNewtonIk, arm: Arm, state: State) -> Vector:
    """Return the step of one of this package's solvers (n,) [rad]; NaN where there is none."""
    stepper = solver._search(arm).stepper
    stepper.aim(state.target, state.q_seed)
    distance2, angle2, _ = stepper.move(state.q)
    turns = not getattr(solver, "position_only", False)
    step: Vector | None = stepper.step(state.q, distance2 + (angle2 if turns else 0.0), None)
    return np.full(arm.n, np.nan) if step is None else step


def _twist_and_posture(arm: Arm, state: State) -> list[BaseTask]:
    solver = QpIk()
    tool = FrameTask(arm.robot.tcp, "site", 1.0, 1.0, lm_damping=solver.lm_damping)
    tool.set_target(state.target)
    error = tool.compute_error(mink.Configuration(arm.model, q=state.q))
    posture = mink.PostureTask(arm.model, cost=solver.posture_cost * float(np.linalg.norm(error)))
    posture.set_target(state.q_seed)
    return [tool, posture]


def _rotation_vector(rows: int) -> Callable[[Arm, State], list[BaseTask]]:
    return lambda arm, state: [RotationVector(arm, state.target, rows, 0.03)]


OBJECTIVES: Mapping[str, tuple[GaussNewtonIk, Callable[[Arm, State], list[BaseTask]]]] = {
    "qp": (QpIk(), _twist_and_posture),
    "mink": (MinkIk(), _twist_and_posture),
    "lm": (LmIk(), _rotation_vector(6)),
    "lm, position": (LmIk(position_only=True), _rotation_vector(3)),
}
"""Solvers, each with its objective as tasks of mink."""


class Differences(NamedTuple):
    """Largest differences of a joint between steps from one state [rad]."""

    solver_exact: float
    """The solver's from the one without rounding."""
    mink_exact: float
    """That of `mink.solve_ik` from the one without rounding."""
    solver_mink: float
    """The solver's from that of `mink.solve_ik`."""
    solver_refined: float
    """The solver's from that of `mink.solve_ik` refined, which is what `MinkIk` steps by."""
    held: int
    """Joints that the solver's step leads to a limit."""


def differences(name: str, arm: Arm, state: State) -> Differences:
    """Compare one step of a solver of `OBJECTIVES`."""
    solver, make = OBJECTIVES[name]
    configuration, tasks = mink.Configuration(arm.model, q=state.q), make(arm, state)
    limits = [mink.ConfigurationLimit(arm.model, gain=1.0)]
    # mink reads no tolerance of its own; DAQP's default of 1e-6 is not what is compared.
    plain = mink.solve_ik(
        configuration, tasks, 1.0, "daqp", damping=FLOOR, limits=limits, primal_tol=1e-9
    )
    step = step_of(solver, arm, state)
    low, high = arm.q_min - state.q, arm.q_max - state.q
    found = [task.compute_qp_residual(configuration) for task in tasks]
    residuals = [residual for residual in found if residual is not None]
    own = refined_by_residuals(residuals, FLOOR, (low, high), plain)
    exact = exact_step(configuration, tasks, FLOOR, low, high, step)
    return Differences(
        float(np.abs(step - exact).max()),
        float(np.abs(plain - exact).max()),
        float(np.abs(step - plain).max()),
        float(np.abs(step - own).max()),
        int((np.minimum(step - low, high - step) < 1e-9).sum()),
    )
