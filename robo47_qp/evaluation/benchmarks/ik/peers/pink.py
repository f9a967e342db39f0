"""Pink: weighted tasks and limits as a QP, based on Pinocchio."""

from dataclasses import dataclass
from importlib import import_module
from time import process_time
from typing import Any

import numpy as np
from mink import SE3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.evaluation.benchmarks.ik.peers.kinematic_chain import TIP, kinematic_chain
from robo47_qp.evaluation.benchmarks.ik.peers.presence import require
from robo47_qp.ik.solver import IkResult, Tolerance, is_pose, judged, rejected
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target


@dataclass(frozen=True, kw_only=True)
class PinkIk:
    """Iterations of `pink.solve_ik` with a frame task and a weak posture task, dt = 1 s."""

    backend: str = "daqp"
    """Backend of the QP."""
    max_iterations: int = 100
    """Largest number of QPs."""
    lm_damping: float = 0.01
    """Damping per squared error, as in the QP of this package."""
    posture_cost: float = 1e-6
    """Weight of the posture task; that of the frame task is 1."""
    tolerance: Tolerance = Tolerance()

    def __post_init__(self) -> None:
        """Check that Pink is installed.

        Raises:
            MissingExtraError: Pink is not installed.
        """
        require("PinkIk", "pink", "pin-pink")

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        """See `IkSolver.solve`; `seconds` are those of Pink's steps."""
        q = arm.checked_q("q_seed", q_seed)
        if not is_pose(T_world_target):
            return rejected(arm, q)
        problem = arm.derived(_Pink, self.lm_damping, self.posture_cost)
        problem.start(T_world_target, np.clip(q, arm.q_min, arm.q_max))
        started, iterations = process_time(), 0
        while iterations < self.max_iterations and not problem.reached(self.tolerance):
            if not problem.advance(self.backend):
                break
            iterations += 1
        seconds = process_time() - started
        result = judged(arm, T_world_target, problem.q, self.tolerance, iterations)
        return result.with_effort(iterations=iterations, restarts=0, seconds=seconds)


class _Pink:
    """Pink's model, configuration and tasks, built once."""

    def __init__(self, arm: Arm, lm_damping: float, posture_cost: float) -> None:
        self._pink: Any = import_module("pink")
        tasks: Any = import_module("pink.tasks")
        self._limits: Any = import_module("pink.limits")
        self._no_solution: Any = import_module("pink.exceptions").NoSolutionFound
        self._pin: Any = import_module("pinocchio")
        model = self._pin.buildModelFromXML(kinematic_chain(arm).urdf())
        self._model, self._data = model, model.createData()
        self._q_min, self._q_max = arm.q_min, arm.q_max
        self._pose = tasks.FrameTask(TIP, 1.0, 1.0, lm_damping=lm_damping)
        self._posture = tasks.PostureTask(cost=posture_cost)
        self._only = [self._limits.ConfigurationLimit(model)]
        self._configuration = self._pink.Configuration(model, self._data, arm.home)

    @property
    def q(self) -> Vector:
        return np.array(self._configuration.q, dtype=np.float64)

    def pose(self, q: Vector) -> Matrix:
        """Return T_world_tcp (4, 4) by Pinocchio."""
        self._configuration.update(q)
        T = self._configuration.get_transform_frame_to_world(TIP).homogeneous
        return np.array(T, dtype=np.float64)

    def start(self, T_world_target: SE3, q: Vector) -> None:
        T = T_world_target.as_matrix()
        self._pose.set_target(self._pin.SE3(T[:3, :3], T[:3, 3]))
        self._posture.set_target(q)
        self._configuration.update(q)

    def reached(self, tolerance: Tolerance) -> bool:
        e = self._pose.compute_error(self._configuration)
        close = np.sqrt(e[:3] @ e[:3]) <= tolerance.position
        return bool(close and np.sqrt(e[3:] @ e[3:]) <= tolerance.orientation)

    def advance(self, backend: str) -> bool:
        """Do one iteration; return False if the QP has no solution."""
        try:
            v = self._pink.solve_ik(
                self._configuration,
                [self._pose, self._posture],
                1.0,
                solver=backend,
                limits=self._only,
                safety_break=False,
            )
        except self._no_solution:
            return False
        q = np.clip(self._configuration.integrate(v, 1.0), self._q_min, self._q_max)
        self._configuration.update(q)
        return True


def tool_pose(arm: Arm, q: Vector) -> Matrix:
    """Return T_world_tcp (4, 4) by Pinocchio, to check that the models agree."""
    return arm.derived(_Pink, 0.0, 1.0).pose(q)
