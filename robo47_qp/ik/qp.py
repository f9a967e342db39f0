"""Inverse kinematics as a constrained quadratic program, by mink."""

from dataclasses import dataclass, replace
from functools import lru_cache
from time import process_time
from typing import Any
from warnings import catch_warnings, simplefilter

import mink
import numpy as np
import qpsolvers
from mink import SE3
from scipy.sparse import csc_matrix

from robo47_qp.arm import Arm
from robo47_qp.arrays import Vector
from robo47_qp.errors import UnknownNameError
from robo47_qp.ik.solver import IkResult, Tolerance, is_pose, judged, rejected

BACKENDS: dict[str, dict[str, Any]] = {
    "daqp": {},
    # OSQP's default accuracy of 1e-3 leaves steps that are wrong by as much.
    "osqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 20000},
}
"""QP solvers that can be chosen, with the settings that make their answers right."""


@dataclass(frozen=True, kw_only=True)
class QpIk:
    """Gauss-Newton steps on the tool pose, each a QP inside the joint limits.

    min over dq of ½ ‖J dq - e‖² + ½ ε² ‖dq - (q_seed - q)‖² + ½ μ ‖dq‖²
    subject to g (q_min - q) <= dq <= g (q_max - q), g in (0, 1],
    with e the pose error as a twist in the tool frame, J its Jacobian, ε the posture cost
    and μ = `lm_damping` ‖e‖²: mink's FrameTask, PostureTask and ConfigurationLimit
    (Zakka, mink, https://github.com/kevinzakka/mink). The posture decides among the answers
    of a redundant arm: the one close to the seed.
    """

    backend: str = "daqp"
    """QP solver, one of BACKENDS."""
    max_iterations: int = 100
    """QPs before giving up."""
    lm_damping: float = 0.01
    """Damping per squared error; none at all loses a quarter of the targets."""
    posture_cost: float = 1e-6
    """ε, small beside the pose error's weight of 1."""
    limit_gain: float = 0.5
    """g: part of the way to a joint limit that one step may go."""
    tolerance: Tolerance = Tolerance()

    def __post_init__(self) -> None:
        """Check the name of the QP solver.

        Raises:
            UnknownNameError: The QP solver is not one of BACKENDS, or is not installed.
        """
        known = [name for name in BACKENDS if name in qpsolvers.available_solvers]
        if self.backend not in known:
            raise UnknownNameError("QP solver", self.backend, known)

    def solve(self, arm: Arm, T_world_target: SE3, q_seed: Vector) -> IkResult:
        """See `IkSolver.solve`."""
        started = process_time()
        q = arm.checked_q("q_seed", q_seed)
        if not is_pose(T_world_target):
            return rejected(arm, q)
        problem = _problem(arm, self.lm_damping, self.posture_cost, self.limit_gain)
        problem.start(T_world_target, np.clip(q, arm.q_min, arm.q_max), q)
        iteration = 0
        while not problem.reached(self.tolerance) and iteration < self.max_iterations:
            if not problem.advance(self.backend):
                break
            iteration += 1
        result = judged(arm, T_world_target, problem.q, self.tolerance, iteration)
        return replace(result, seconds=process_time() - started)


class _Problem:
    """mink's objects for one arm, built once: they cost more than an iteration."""

    def __init__(self, arm: Arm, lm_damping: float, posture_cost: float, gain: float) -> None:
        self._q_min, self._q_max = arm.q_min, arm.q_max
        self._configuration = mink.Configuration(arm.model)
        self._pose = mink.FrameTask(arm.robot.tcp, "site", 1.0, 1.0, lm_damping=lm_damping)
        self._posture = mink.PostureTask(arm.model, posture_cost)
        self._limits = [mink.ConfigurationLimit(arm.model, gain=gain)]

    @property
    def q(self) -> Vector:
        return self._configuration.q

    def start(self, T_world_target: SE3, q: Vector, q_posture: Vector) -> None:
        self._pose.set_target(T_world_target)
        self._posture.set_target(q_posture)
        self._configuration.update(q)

    def reached(self, tolerance: Tolerance) -> bool:
        e = self._pose.compute_error(self._configuration)
        close = np.sqrt(e[:3] @ e[:3]) <= tolerance.position
        return bool(close and np.sqrt(e[3:] @ e[3:]) <= tolerance.orientation)

    def advance(self, backend: str) -> bool:
        """One step; False where the QP solver gave no answer."""
        qp = mink.build_ik(
            self._configuration, [self._pose, self._posture], dt=1.0, limits=self._limits
        )
        if backend in qpsolvers.sparse_solvers:
            qp.P, qp.G = csc_matrix(qp.P), csc_matrix(qp.G)
        with catch_warnings():
            # OSQP may stop short of its accuracy, with a warning. It is a step all the same,
            # and the judge sees where the steps lead.
            simplefilter("ignore", UserWarning)
            solution = qpsolvers.solve_problem(qp, solver=backend, **BACKENDS[backend])
        if solution.x is None or not np.isfinite(solution.x).all():
            return False
        # QP solvers meet bounds but for rounding; answers meet them exactly.
        q = self._configuration.q + solution.x
        self._configuration.update(np.clip(q, self._q_min, self._q_max))
        return True


@lru_cache(maxsize=16)
def _problem(arm: Arm, lm_damping: float, posture_cost: float, gain: float) -> _Problem:
    return _Problem(arm, lm_damping, posture_cost, gain)
