"""The joint velocity towards a target that moves, jumps or cannot be reached."""

from collections.abc import Mapping
from math import nan, sqrt
from typing import NamedTuple

import mujoco
import numpy as np
from mink import SE3
from numpy.typing import NDArray
from scipy.linalg import lapack

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.stream.settings import Event, StreamSettings
from robo47_qp.ik.tool_demand import FULL
from robo47_qp.ik.tool_error import error_to
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile


def approach_rate(way: Vector, v_max: Vector, a_max: Vector, gain: float) -> float:
    """Part of the way to go per second, so that every joint can stop at its end [1/s].

    A joint with the way d ahead may go K d while that is gentle, and further away
    sqrt(2 a_max (d - a_max / (2 K²))), never above v_max: both laws and their slopes meet at
    d = a_max / K², and following them takes no more than a_max. The slowest joint sets the pace
    of all, so the joints arrive together.

    Args:
        way: Joint displacement to the target (n,) [rad].
        v_max: Largest joint speeds to use (n,) [rad/s].
        a_max: Largest decelerations to use (n,) [rad/s²].
        gain: K [1/s].
    """
    # For a few joints floats are faster than arrays.
    pace = gain
    for d, v, a in zip(np.abs(way).tolist(), v_max.tolist(), a_max.tolist(), strict=True):
        soft = a / gain**2
        if d > soft:
            pace = min(pace, sqrt(a * (2.0 * d - soft)) / d)
        if pace * d > v:
            pace = v / d
    return pace


def shortened(displacement: Vector, longest: float) -> Vector:
    """The displacement, scaled to a length of at most `longest` [m]; any finite input."""
    largest = max(map(abs, displacement.tolist()))
    if largest > longest:
        displacement = displacement * (longest / largest)
    length = sqrt(displacement.dot(displacement))
    return displacement * (longest / length) if length > longest else displacement


class TargetMotion:
    """The target's own velocity, by the difference of two ticks."""

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self._last: Vector | None = None
        self._turn = np.empty(3)

    def reset(self) -> None:
        """Start anew: the next target counts as being at rest."""
        self._last = None

    def twist(self, target: Vector, fastest: Vector) -> tuple[Vector, bool]:
        """Twist of the target in the world frame, linear part first (6,) [m/s, rad/s].

        A target that moved farther in one tick than the tool could have is taken to have
        jumped. One that jumped is at rest until the next tick.

        Args:
            target: Quaternion wxyz and position (7,).
            fastest: Largest component-wise twist of the tool at any joint velocity allowed (6,).

        Returns:
            The twist, and whether the target jumped.
        """
        twist, last = np.zeros(6), self._last
        self._last = target.copy()
        if last is None:
            return twist, False
        np.subtract(target[4:], last[4:], out=twist[:3])
        mujoco.mju_subQuat(self._turn, target[:4], last[:4])
        mujoco.mju_rotVecQuat(twist[3:], self._turn, last[:4])
        twist /= self._dt
        if np.count_nonzero(np.abs(twist) > fastest):
            return np.zeros(6), True
        return twist, False


TINY = 1e-100
"""Squares of singular values below this are those of a tool that cannot move at all."""
LOST = 1e-12
"""Squares of singular values below this part of the largest count as zero."""


class DampedInverse:
    """J⁺ = Jᵀ U diag(1 / (σ² + λ²(σ))) Uᵀ, with U and σ² of J Jᵀ by eigenvalues.

    Where no direction is damped that is Jᵀ (J Jᵀ)⁻¹, which takes a Cholesky factor only.

    Directions with σ above σ0 are inverted exactly. Below, λ grows from 0 to σ0 / 2:
    λ²(σ) = (σ0² - σ²)² / (4 σ0²), which bounds the gain by 2 / σ0 or less. Only the directions
    that are nearly lost are damped (Chiaverini, "Singularity-robust task-priority redundancy
    resolution for real-time kinematic control of robot manipulators", 1997; Maciejewski and
    Klein, "Numerical filtering for the operation of robotic manipulators through kinematically
    singular configurations", 1988).
    """

    def __init__(self, J: Matrix, threshold: float) -> None:
        """Factor a Jacobian.

        Args:
            J: Rows in comparable units, shape (rows, n); kept, not copied.
            threshold: σ0 as a part of the largest singular value [-].
        """
        self._J = J
        # The trace of J Jᵀ is no less than its largest eigenvalue: where even that much taken
        # off leaves it positive definite, nothing is damped and no eigenvalue is needed.
        squares = J @ J.T
        entries = J.ravel()
        reserve = max(threshold**2, LOST) * float(entries.dot(entries))
        lessened = squares.copy()
        lessened.reshape(-1)[:: len(J) + 1] -= reserve
        _, lost = lapack.dpotrf(lessened)
        if lost:
            self._damped, self._exact = _by_eigenvalues(squares, J, threshold)
        else:
            _, self._damped, _ = lapack.dposv(squares, J)
            self._exact = self._damped

    def velocities(self, twist: Vector) -> Vector:
        """Joint velocities (n,) for a twist in the units of the rows of J."""
        out: Vector = twist.dot(self._damped)
        return out

    def null(self, v: Vector) -> Vector:
        """The part of joint velocities that leaves the tool at rest (n,): not damped."""
        out: Vector = v - self._J.dot(v).dot(self._exact)
        return out


def _by_eigenvalues(squares: Matrix, J: Matrix, threshold: float) -> tuple[Matrix, Matrix]:
    """The transposes of J⁺, damped and not damped (rows, n)."""
    eigenvalues, U, _ = lapack.dsyev(squares)
    np.maximum(eigenvalues, 0.0, out=eigenvalues)
    largest = max(float(eigenvalues[-1]), TINY)
    zero = threshold**2 * largest
    damping = np.maximum(zero - eigenvalues, 0.0)
    damping *= damping
    damping /= 4.0 * zero
    damping += eigenvalues
    kept = eigenvalues > LOST * largest
    exact = np.where(kept, 1.0 / np.maximum(eigenvalues, TINY), 0.0)
    along = U.T @ J
    return (U / damping) @ along, (U * exact) @ along


_ANY, _ROUNDING = np.full(6, np.inf), 1e-12
"""No bound on a twist, and what counts as none [m/s, rad/s]."""
_HOMING_SPEED = 0.1
"""Part of v_max that the return home may take."""


class VelocityObjective(NamedTuple):
    """The joint velocity that a target asks for, and the weight of deviations from it."""

    H: Matrix
    """Weight of a deviation from v_ref (n, n)."""
    v_ref: Vector
    """Joint velocity to come close to (n,) [rad/s]."""
    position_error: float
    """Distance of the tool from the target now, of several the largest; NaN without one [m]."""
    orientation_error: float
    """Angle between them now, likewise [rad]."""
    events: tuple[Event, ...]
    """Conditions of the targets."""
    way: "Way"
    """What `v_ref` is made of."""


class Way(NamedTuple):
    """The way of the tools to their targets."""

    whole: Vector
    """Joint displacement (n,) [rad]."""
    paced: Vector
    """The part of v_ref that goes along it (n,) [rad/s]."""
    rows: Matrix
    """What must not move for the tools to go as they are asked to (k, n)."""


class _Followed:
    """A tool with the memory of its target, and its rows of the stack."""

    def __init__(self, arm: Arm, tool: int, data: mujoco.MjData, settings: StreamSettings) -> None:
        self.error = error_to(arm, (tool,), data, settings.demand)
        self.motion = TargetMotion(settings.dt)
        self._demand, self._rotation = (
            settings.demand,
            data.site_xmat[arm.tool_sites[tool]].reshape(3, 3),
        )

    def twist(self, target: Vector, v_max: Vector) -> tuple[Vector, bool]:
        """Return `TargetMotion.twist` of what is asked for."""
        fastest = np.abs(self.error.J).dot(v_max)
        if self._demand == FULL:
            return self.motion.twist(target, fastest)
        twist, _ = self.motion.twist(target, _ANY)
        twist[:3] *= self._demand.position
        twist[3:] = self._demand.turning(twist[3:, None], self._rotation)[:, 0]
        jumped = bool((np.abs(twist) > fastest + _ROUNDING).any())
        return (np.zeros(6) if jumped else twist), jumped


class _Stack:
    """Memory for a set of tools that are followed together."""

    def __init__(self, arm: Arm, tools: tuple[int, ...], units: Vector) -> None:
        n, rows = arm.n, 6 * len(tools)
        self.units = np.tile(units, len(tools))
        self.columns = np.repeat(self.units[:, None], n, axis=1)
        self.J, self.scaled = np.zeros((rows, n)), np.zeros((rows, n))
        self.way, self.twist = np.zeros(rows), np.zeros(rows)
        self.groups = joint_groups([arm.tool_joints(tool) for tool in tools])
        """Joints that move together, where tools share none of them; empty for a single group."""


def joint_groups(joints: list[NDArray[np.bool_]]) -> list[NDArray[np.intp]]:
    """Join tools that share joints; return the joints of each group, none for a single one."""
    groups: list[NDArray[np.bool_]] = []
    for mine in joints:
        joined = mine.copy()
        for other in [group for group in groups if (group & mine).any()]:
            joined |= other
        groups = [group for group in groups if not (group & mine).any()] + [joined]
    return [np.flatnonzero(group) for group in groups] if len(groups) > 1 else []


class TargetVelocity:
    """v_ref and H of `StreamIk`, with the memory of where the targets were."""

    def __init__(self, settings: StreamSettings, arm: Arm, profile: MotionProfile) -> None:
        """Make the memory for an arm and the limits that count for it."""
        n, self._settings, self._arm = arm.n, settings, arm
        self._data = mujoco.MjData(arm.model)
        self._tools = [
            _Followed(arm, tool, self._data, settings) for tool in range(len(arm.robot.tools))
        ]
        self._frozen: list[int] = []
        self._stacks: dict[tuple[int, ...], _Stack] = {}
        self._units = np.array([1.0, 1.0, 1.0, *[settings.radian_length] * 3])
        self._regular = settings.joint_weight * np.eye(n)
        self._v_max = profile.v_max
        self._v_use, self._a_use = (
            settings.reserve * profile.v_max,
            settings.reserve * profile.a_max,
        )
        self._home, self._v_home = arm.home.copy(), _HOMING_SPEED * profile.v_max
        self._v_home_back = -self._v_home
        self._rest = VelocityObjective(
            *(np.eye(n), np.zeros(n), nan, nan, (Event.TARGET_REFUSED,)),
            Way(np.zeros(n), np.zeros(n), np.eye(n)),
        )

    def freeze(self, joints: list[int]) -> None:
        """Ask for no motion of some joints from now on."""
        self._frozen = joints

    def reset(self) -> None:
        """Start anew: the next target counts as being at rest."""
        for tool in self._tools:
            tool.motion.reset()

    def update(self, q: Vector) -> None:
        """Bring `data` up to date with the arm at q; `objective` does so, too."""
        self._place(q)
        mujoco.mj_comPos(self._arm.model, self._data)

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's state with kinematics and centres of mass; not to be written to."""
        return self._data

    def objective(self, targets: Mapping[int, SE3 | None], q: Vector) -> VelocityObjective:
        """Return the objective for targets with the arm at q; without any, rest.

        Args:
            targets: Wanted pose by the number of the tool; None holds that tool still.
            q: Position of the joints (n,) [rad].
        """
        if all(pose is None for pose in targets.values()):
            self.reset()
            self.update(q)
            return self._rest
        settings, tools = self._settings, tuple(targets)
        if tools not in self._stacks:
            self._stacks[tools] = _Stack(self._arm, tools, self._units)
        stack = self._stacks[tools]
        self._place(q)
        away, turn, events = self._measure(stack, targets)
        np.multiply(stack.J, stack.columns, out=stack.scaled)
        inverse = DampedInverse(stack.scaled, settings.singular_threshold)
        joint_way = inverse.velocities(stack.way)
        paced = self._paced(joint_way, stack.groups)
        stack.twist *= stack.units
        v_ref = paced + inverse.velocities(stack.twist)
        if settings.home_gain > 0.0:
            home = self._arm.way(q, self._home)
            home *= settings.home_gain
            np.minimum(home, self._v_home, out=home)
            np.maximum(home, self._v_home_back, out=home)
            if self._frozen:
                home[self._frozen] = 0.0
            v_ref += inverse.null(home)
        H = stack.scaled.T @ stack.scaled
        H += self._regular
        way = Way(joint_way, paced, stack.scaled)
        return VelocityObjective(H, v_ref, sqrt(away), sqrt(turn), events, way)

    def _place(self, q: Vector) -> None:
        self._data.qpos[:] = q
        mujoco.mj_kinematics(self._arm.model, self._data)

    def _measure(
        self, stack: _Stack, targets: Mapping[int, SE3 | None]
    ) -> tuple[float, float, tuple[Event, ...]]:
        """Fill the stack; return the largest squared errors, and conditions of the targets."""
        away = turn = 0.0
        events: dict[Event, None] = {}
        for i, (tool, pose) in enumerate(targets.items()):
            rows, followed = slice(6 * i, 6 * i + 6), self._tools[tool]
            error = followed.error
            if pose is not None:
                error.set_target(pose)
            p2, w2 = error.measure()
            error.update_jacobian()
            stack.J[rows] = error.J
            if self._frozen:
                stack.J[rows, self._frozen] = 0.0
            if pose is None:
                followed.motion.reset()
                stack.way[rows] = stack.twist[rows] = 0.0
                events[Event.TARGET_REFUSED] = None
                continue
            away, turn = max(away, p2), max(turn, w2)
            np.multiply(self._units, error.e, out=stack.way[rows])
            stack.way[rows][:3] = shortened(stack.way[rows][:3], self._settings.max_distance)
            stack.twist[rows], jumped = followed.twist(pose.wxyz_xyz, self._v_max)
            if jumped:
                events[Event.TARGET_JUMPED] = None
        for other, followed in enumerate(self._tools):
            if other not in targets:
                followed.motion.reset()
        return away, turn, tuple(events)

    def _paced(self, way: Vector, groups: list[NDArray[np.intp]]) -> Vector:
        """Return the way per second, each group of joints at its own pace."""
        v_use, a_use, gain = self._v_use, self._a_use, self._settings.gain
        if not groups:
            return approach_rate(way, v_use, a_use, gain) * way
        paced = np.zeros_like(way)
        for group in groups:
            rate = approach_rate(way[group], v_use[group], a_use[group], gain)
            paced[group] = rate * way[group]
        return paced
