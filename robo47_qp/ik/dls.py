"""Damped least squares, the baseline of the textbooks."""

from dataclasses import dataclass, replace
from time import process_time

import numpy as np
from mink import SE3

from robo47_qp.arrays import Checked, CountOrZero, NotNegative, Vector
from robo47_qp.ik.solver import IkResult, Tolerance, is_pose, judged, rejected
from robo47_qp.model.arm import Arm


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

    def solve(self, arm: Arm, T_world_target: SE3, q_seed: Vector) -> IkResult:
        """See `IkSolver.solve`."""
        started = process_time()
        q = arm.checked_q("q_seed", q_seed)
        if not is_pose(T_world_target):
            return rejected(arm, q)
        rows = 3 if self.position_only else 6
        regular = self.damping**2 * np.eye(rows)
        tolerance = self.tolerance
        if self.position_only:
            tolerance = Tolerance(position=tolerance.position, orientation=np.inf)
        for iteration in range(self.max_iterations + 1):
            e = arm.pose_error(T_world_target, q)[:rows]
            close = np.sqrt(e[:3] @ e[:3]) <= tolerance.position
            if close and (self.position_only or np.sqrt(e[3:] @ e[3:]) <= tolerance.orientation):
                break
            if iteration == self.max_iterations:
                break
            J = arm.jacobian(q)[:rows]
            q = q + J.T @ np.linalg.solve(J @ J.T + regular, e)
            if self.clip:
                q = np.clip(q, arm.q_min, arm.q_max)
        result = judged(arm, T_world_target, q, tolerance, iteration, None, self.clearance)
        return replace(result, seconds=process_time() - started)
