"""The joint velocity that a target asks for, before any limit."""

from math import nan, sqrt
from typing import NamedTuple

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arm import Arm
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.approach import TargetMotion, approach_rate, shortened
from robo47_qp.ik.damped_inverse import DampedInverse
from robo47_qp.ik.stream_settings import StreamSettings
from robo47_qp.ik.stream_tick import Event
from robo47_qp.ik.tool_error import ToolError
from robo47_qp.robot import MotionProfile

_HOMING_SPEED = 0.1
"""Part of v_max that the return home may take."""


class Wish(NamedTuple):
    """What a target asks for."""

    H: Matrix
    """Weight of a deviation from v_ref (n, n)."""
    v_ref: Vector
    """Joint velocity to come close to (n,) [rad/s]."""
    position_error: float
    """Distance of the tool from the target now; NaN without a target [m]."""
    orientation_error: float
    """Angle between them now [rad]."""
    events: tuple[Event, ...]
    """What was wrong with the target."""


class Pursuit:
    """v_ref and H of `StreamIk`, with the memory of where the target was."""

    def __init__(self, settings: StreamSettings, arm: Arm, profile: MotionProfile) -> None:
        """Make the memory for an arm and the limits that count for it."""
        n, self._settings = arm.n, settings
        self._tool = ToolError(arm)
        self._target = TargetMotion(settings.dt)
        self._units = np.array([1.0, 1.0, 1.0, *[settings.lever] * 3])
        self._columns = np.repeat(self._units[:, None], n, axis=1)
        self._J = np.zeros((6, n))
        self._regular = settings.joint_weight * np.eye(n)
        self._v_max = profile.v_max
        self._v_use, self._a_use = (
            settings.reserve * profile.v_max,
            settings.reserve * profile.a_max,
        )
        self._home, self._v_home = arm.home.copy(), _HOMING_SPEED * profile.v_max
        self._v_home_back = -self._v_home
        self._rest = Wish(np.eye(n), np.zeros(n), nan, nan, (Event.TARGET_REFUSED,))

    def forget(self) -> None:
        """Start anew: the next target counts as being at rest."""
        self._target.forget()

    def show(self, q: Vector) -> None:
        """Bring `data` up to date with the arm at q; `wish` does so, too."""
        self._tool.move(q)
        self._tool.differentiate()

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's state with kinematics and centres of mass; not to be written to."""
        return self._tool.data

    def wish(self, T_world_target: SE3 | None, q: Vector) -> Wish:
        """What a target asks of the arm at q; to come to rest, where there is none."""
        tool, units, settings = self._tool, self._units, self._settings
        if T_world_target is None:
            self._target.forget()
            self.show(q)
            return self._rest
        tool.aim(T_world_target)
        away, turn = tool.move(q)
        tool.differentiate()
        np.multiply(tool.J, self._columns, out=self._J)
        way = units * tool.e
        way[:3] = shortened(way[:3], settings.longest_way)
        inverse = DampedInverse(self._J, settings.singular)
        fastest = np.abs(tool.J).dot(self._v_max)
        twist, jumped = self._target.twist(T_world_target.wxyz_xyz, fastest)
        joint_way = inverse.velocities(way)
        v_ref = approach_rate(joint_way, self._v_use, self._a_use, settings.gain) * joint_way
        twist *= units
        v_ref += inverse.velocities(twist)
        if settings.homing > 0.0:
            home = self._home - q
            home *= settings.homing
            np.minimum(home, self._v_home, out=home)
            np.maximum(home, self._v_home_back, out=home)
            v_ref += inverse.null(home)
        H = self._J.T @ self._J
        H += self._regular
        events = (Event.TARGET_JUMPED,) if jumped else ()
        return Wish(H, v_ref, sqrt(away), sqrt(turn), events)
