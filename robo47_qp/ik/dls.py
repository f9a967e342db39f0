"""Damped least squares, the baseline of the textbooks."""

from dataclasses import dataclass, replace
from time import process_time
from typing import Self

import mujoco
import numpy as np

from robo47_qp.arrays import Checked, CountOrZero, Longest, NotNegative, Vector
from robo47_qp.ik.damping import Damping, clamped
from robo47_qp.ik.solver import IkResult, Tolerance, is_target, judged, rejected
from robo47_qp.ik.tool_error import tools_of
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target

_NULL = 1e-3
"""Singular values of J below this part of the largest count as none for the null space."""


@dataclass(frozen=True, kw_only=True)
class DlsIk(Checked):
    """Damped least squares on the tool pose.

    dq = Jᵀ (J Jᵀ + λ² I)⁻¹ e, with e the way to the target in the tool frame, a displacement
    and a rotation vector; with `position_only` the rows of the rotation are left out. It
    knows nothing of joint limits: with `clip`, each step ends inside them by clamping. Nor does
    it know of obstacles: with `clearance`, an answer that is too close to something is refused
    once it is there, and other starts may find another (see `MultiStart`).
    The defaults are the textbook's; the other fields are what is usually added to it.
    (Nakamura and Hanafusa, 1986; Buss, "Introduction to inverse kinematics with Jacobian
    transpose, pseudoinverse and damped least squares methods", 2004.)
    """

    position_only: bool = False
    """Ask for the tool's position alone."""
    clip: bool = True
    """Clamp every step to the joint limits."""
    damping: NotNegative | Damping = 0.05
    """λ: the larger, the slower and the calmer near singularities [m or rad per rad]; or a law of
    λ²."""
    longest: Longest = np.inf
    """Displacement that a step goes for at most; shorter, far targets do not throw the arm [m]."""
    widest: Longest = np.inf
    """Rotation that a step goes for at most [rad]."""
    centring: NotNegative = 0.0
    """Part of the way to the middle of the joint ranges that each step goes in the null space of
    the tool (Liegeois, 1977)."""
    wrap: bool = False
    """Without `clip`: turn joints by whole turns into their ranges, at the end, where that is
    possible."""
    max_iterations: CountOrZero = 200
    """Steps before giving up."""
    clearance: NotNegative | None = None
    """Distance that an answer must keep from itself and from obstacles [m]; looked at in the end
    only, no step avoids anything. None looks at none."""
    tolerance: Tolerance = Tolerance()

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        """See `IkSolver.solve`."""
        started = process_time()
        q = arm.checked_q("q_seed", q_seed)
        if not is_target(T_world_target):
            return rejected(arm, q)
        rows = 3 if self.position_only else 6
        tolerance, demand = self.tolerance, self.tolerance.demand
        tools = len(tools_of(arm, T_world_target))
        asked = tools * (rows - demand.free)
        law = self.damping if isinstance(self.damping, Damping) else Damping(constant=self.damping)
        one, middle = np.eye(rows * tools), 0.5 * (arm.q_low + arm.q_high)
        bounded = np.isfinite([self.longest, self.widest]).any()
        if self.position_only:
            tolerance = replace(tolerance, orientation=np.inf)
        q_seed = q
        for iteration in range(self.max_iterations + 1):
            parts = demand.error(arm, T_world_target, q).reshape(tools, 6)
            if all(_close(part, tolerance) for part in parts):
                break
            if iteration == self.max_iterations:
                break
            J = demand.jacobian(arm, T_world_target, q).reshape(tools, 6, arm.n)[:, :rows]
            e, J = parts[:, :rows].reshape(-1), J.reshape(-1, arm.n)
            if bounded:
                own = e.reshape(tools, rows)
                e = np.concatenate([clamped(part, self.longest, self.widest) for part in own])
            damped = law.squared(J, float(e @ e), asked)
            if damped > 0.0:
                step = J.T @ np.linalg.solve(J @ J.T + damped * one, e)
            else:
                step = np.linalg.lstsq(J, e, rcond=None)[0]
            if self.centring:
                lean = self.centring * np.where(arm.free, 0.0, middle - q)
                step += lean - np.linalg.pinv(J, rcond=_NULL) @ (J @ lean)
            q = q + step
            if self.clip:
                q = np.clip(q, arm.q_min, arm.q_max)
        if self.wrap and not self.clip:
            q = _wrapped(arm, q)
        q = arm.unwound(q, q_seed)
        result = judged(arm, T_world_target, q, tolerance, iteration, None, self.clearance)
        return replace(result, seconds=process_time() - started)

    def thorough(self) -> Self:
        """See `EarlyStopping.thorough`."""
        return replace(self, max_iterations=max(self.max_iterations, 100))


def _wrapped(arm: Arm, q: Vector) -> Vector:
    """Return q with hinges turned by whole turns into their ranges, where that can be."""
    hinges = arm.model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
    turns = np.rint((q - 0.5 * (arm.q_low + arm.q_high)) / (2.0 * np.pi))
    return np.where(hinges, q - 2.0 * np.pi * turns, q)


def _close(e: Vector, tolerance: Tolerance) -> bool:
    near = np.sqrt(e[:3] @ e[:3]) <= tolerance.position
    return bool(near and np.sqrt(e[3:] @ e[3:]) <= tolerance.orientation)


TUNED = DlsIk(damping=Damping(per_error=0.1), longest=0.1, widest=0.4)
"""The best clipped one of a sweep over dampings, clamped errors and centring, from one start; on
other targets, and with restarts, it is among the best (`scenarios/ablate_ik.py`)."""
