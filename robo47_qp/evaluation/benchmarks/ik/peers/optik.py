"""OptIK: nonlinear optimisation with restarts, written in Rust."""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.evaluation.benchmarks.ik.peers.kinematic_chain import BASE, TIP, kinematic_chain
from robo47_qp.evaluation.benchmarks.ik.peers.presence import require
from robo47_qp.ik.solver import IkResult, Tolerance, is_pose, judged, rejected
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target

_UNLIMITED = 1e3
"""Time limit that is never reached, as the budget is counted in starts [s]."""


@dataclass(frozen=True, kw_only=True)
class OptikIk:
    """`optik.Robot.ik` on one thread, with its own restarts."""

    max_restarts: int = 140
    """Starts after the first."""
    tolerance: Tolerance = Tolerance()

    def __post_init__(self) -> None:
        """Check that OptIK is installed.

        Raises:
            MissingExtraError: OptIK is not installed.
        """
        require("OptikIk", "optik", "optik-py")

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        """See `IkSolver.solve`; `seconds` are those of `Robot.ik`, which tells no iterations."""
        q = arm.checked_q("q_seed", q_seed)
        if not is_pose(T_world_target):
            return rejected(arm, q)
        error = min(self.tolerance.position, self.tolerance.orientation)
        robot, config = arm.derived(_optik, self.max_restarts, 0.5 * error**2)
        inside = np.clip(q, arm.q_min, arm.q_max).tolist()
        T = T_world_target.as_matrix()
        started = process_time()
        answer = robot.ik(config, T, inside)
        seconds = process_time() - started
        found = inside if answer is None else answer[0]
        result = judged(arm, T_world_target, found, self.tolerance, 0)
        return result.with_effort(iterations=0, restarts=0, seconds=seconds)


def _optik(arm: Arm, max_restarts: int, objective: float) -> tuple[Any, Any]:
    optik: Any = import_module("optik")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "chain.urdf"
        path.write_text(kinematic_chain(arm).urdf(), encoding="utf-8")
        robot = optik.Robot.from_urdf_file(str(path), BASE, TIP)
    robot.set_parallelism(1)
    config = optik.SolverConfig(
        solution_mode="speed", max_time=_UNLIMITED, max_restarts=max_restarts, tol_f=objective
    )
    return robot, config


def tool_pose(arm: Arm, q: Vector) -> Matrix:
    """Return T_world_tcp (4, 4) by OptIK, to check that the models agree."""
    return np.array(arm.derived(_optik, 1, 1.0)[0].fk(q.tolist()), dtype=np.float64)
