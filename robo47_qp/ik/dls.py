"""Damped least squares, the baseline of the textbooks."""

from dataclasses import dataclass, replace
from time import process_time

import numpy as np

from robo47_qp.arrays import Checked, CountOrZero, NotNegative, Vector
from robo47_qp.ik.solver import IkResult, Tolerance, is_target, judged, only_full, rejected
from robo47_qp.ik.tool_error import tools_of
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target


@dataclass(frozen=True, kw_only=True)
class DlsIk(Checked):
    """Damped least squares on the tool pose.

    dq = Jᵀ (J Jᵀ + λ² I)⁻¹ e, with e the way to the target in the tool frame, a displacement
    and a rotation vector; with `position_only` the rows of the rotation are left out. It
    knows nothing of joint limits: with `clip`, each step ends inside them by clamping. Nor does
    it know of obstacles: with `clearance`, an answer that is too close to something is refused
    once it is there, and other starts may find another (see `MultiStart`).
    (Nakamura and Hanafusa, 1986; Buss, "Introduction to inverse kinematics with Jacobian
    transpose, pseudoinverse and damped least squares methods", 2004.)
    """

    position_only: bool = False
    """Ask for the tool's position alone."""
    clip: bool = True
    """Clamp every step to the joint limits."""
    damping: NotNegative = 0.05
    """λ: the larger, the slower and the calmer near singularities [m or rad per rad]."""
    max_iterations: CountOrZero = 200
    """Steps before giving up."""
    clearance: NotNegative | None = None
    """Distance that an answer must keep from itself and from obstacles [m]; looked at in the end
    only, no step avoids anything. None looks at none."""
    tolerance: Tolerance = Tolerance()

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            InvalidValueError: A number is out of its range, or the demand is not the whole pose.
        """
        super().__post_init__()
        only_full(self.tolerance, "DlsIk")

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        """See `IkSolver.solve`."""
        started = process_time()
        q = arm.checked_q("q_seed", q_seed)
        if not is_target(T_world_target):
            return rejected(arm, q)
        rows = 3 if self.position_only else 6
        tools = len(tools_of(arm, T_world_target))
        regular = self.damping**2 * np.eye(rows * tools)
        tolerance = self.tolerance
        if self.position_only:
            tolerance = Tolerance(position=tolerance.position, orientation=np.inf)
        for iteration in range(self.max_iterations + 1):
            parts = arm.pose_error(T_world_target, q).reshape(tools, 6)
            if all(_close(part, tolerance) for part in parts):
                break
            if iteration == self.max_iterations:
                break
            J = arm.error_jacobian(T_world_target, q).reshape(tools, 6, arm.n)[:, :rows]
            e, J = parts[:, :rows].reshape(-1), J.reshape(-1, arm.n)
            q = q + J.T @ np.linalg.solve(J @ J.T + regular, e)
            if self.clip:
                q = np.clip(q, arm.q_min, arm.q_max)
        result = judged(arm, T_world_target, q, tolerance, iteration, None, self.clearance)
        return replace(result, seconds=process_time() - started)


def _close(e: Vector, tolerance: Tolerance) -> bool:
    near = np.sqrt(e[:3] @ e[:3]) <= tolerance.position
    return bool(near and np.sqrt(e[3:] @ e[3:]) <= tolerance.orientation)
