"""Robotics Toolbox: its Levenberg-Marquardt solver in C++, with restarts."""

from dataclasses import dataclass
from importlib import import_module
from time import process_time
from typing import Any

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.evaluation.benchmarks.ik.peers.kinematic_chain import kinematic_chain
from robo47_qp.evaluation.benchmarks.ik.peers.presence import require
from robo47_qp.ik.solver import IkResult, Tolerance, is_pose, judged, rejected
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target


@dataclass(frozen=True, kw_only=True)
class ToolboxIk:
    """Robotics Toolbox's `ETS.ik_LM` with its default method and its own random restarts."""

    max_iterations: int = 30
    """Iterations of each start."""
    starts: int = 141
    """Number of starts, with the seed."""
    tolerance: Tolerance = Tolerance()

    def __post_init__(self) -> None:
        """Check that Robotics Toolbox is installed.

        Raises:
            MissingExtraError: Robotics Toolbox is not installed.
        """
        require("ToolboxIk", "roboticstoolbox", "roboticstoolbox-python")

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        """See `IkSolver.solve`; `seconds` are those of `ik_LM` alone."""
        q = arm.checked_q("q_seed", q_seed)
        if not is_pose(T_world_target):
            return rejected(arm, q)
        error = min(self.tolerance.position, self.tolerance.orientation)
        ets, T = arm.derived(_ets), T_world_target.as_matrix()
        started = process_time()
        answer = ets.ik_LM(
            T,
            q0=q,
            ilimit=self.max_iterations,
            slimit=self.starts,
            tol=0.5 * error**2,
            joint_limits=True,
        )
        seconds, steps = process_time() - started, int(answer.iterations)
        found = judged(arm, T_world_target, answer.q, self.tolerance, steps)
        return found.with_effort(iterations=steps, restarts=0, seconds=seconds)


def _ets(arm: Arm) -> Any:
    """Return the chain as constant transforms and joints with local z axes, alternating."""
    toolbox: Any = import_module("roboticstoolbox")
    chain, elements, T_before = kinematic_chain(arm), [], np.eye(4)
    for i, (anchor, axis) in enumerate(zip(chain.anchors, chain.axes, strict=True)):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = _with_z(axis), anchor
        elements.append(toolbox.ET.SE3(np.linalg.inv(T_before) @ T))
        joint = toolbox.ET.tz if chain.slides[i] else toolbox.ET.Rz
        elements.append(joint(qlim=[chain.q_min[i], chain.q_max[i]]))
        T_before = T
    elements.append(toolbox.ET.SE3(np.linalg.inv(T_before) @ chain.T_world_tcp.as_matrix()))
    return toolbox.ETS(elements)


def _with_z(axis: Vector) -> Matrix:
    """Return a rotation matrix with a given third column."""
    other = np.eye(3)[np.abs(axis).argmin()]
    x = np.cross(other, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def tool_pose(arm: Arm, q: Vector) -> Matrix:
    """Return T_world_tcp (4, 4) by Robotics Toolbox, to check that the models agree."""
    return np.array(arm.derived(_ets).eval(q), dtype=np.float64)
