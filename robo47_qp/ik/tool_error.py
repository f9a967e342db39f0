"""The tool's way to a target and its slope, recomputed in place on the hot path."""

from functools import partial

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.arm import Arm


class ToolError:
    """Memory for one arm. What `e` and `J` show belongs to the last `move`.

    Both have the axes of the world and the tool point as their origin: norms are those of
    the tool frame, and no Jacobian needs to be turned.
    """

    def __init__(self, arm: Arm) -> None:
        """Make the memory for an arm."""
        m, d = arm.model, mujoco.MjData(arm.model)
        tcp = m.site(arm.robot.tcp).id
        self._data, self._q, self._position = d, d.qpos, d.site_xpos[tcp]
        self._target_position, self._target_quaternion = np.zeros(3), np.zeros(4)
        turn, quaternion = np.zeros(3), d.site_xquat[tcp]
        self.e: Vector = np.zeros(6)
        """To the target: displacement [m], rotation vector [rad]."""
        self._p, self._w = self.e[:3], self.e[3:]
        self.J: Matrix = np.zeros((6, arm.n))
        """Twist of the tool per joint, linear part first."""
        # Every array keeps its place: what is called on the hot path is bound to them once.
        self._kinematics = partial(mujoco.mj_kinematics, m, d)
        self._turn_left = partial(mujoco.mju_subQuat, turn, self._target_quaternion, quaternion)
        self._to_world = partial(mujoco.mju_rotVecQuat, self._w, turn, quaternion)
        self._com_position = partial(mujoco.mj_comPos, m, d)
        self._jacobian = partial(mujoco.mj_jacSite, m, d, self.J[:3], self.J[3:], tcp)

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's state with the kinematics of the last `move`; not to be written to."""
        return self._data

    def set_target(self, T_world_target: SE3) -> None:
        """Measure to this pose from now on."""
        pose = T_world_target.wxyz_xyz
        self._target_quaternion[:], self._target_position[:] = pose[:4], pose[4:]

    def move(self, q: Vector) -> tuple[float, float]:
        """Put the arm at q; the squared distance [m²] and the squared angle [rad²] that remain."""
        self._q[:] = q
        self._kinematics()
        p, w = self._p, self._w
        np.subtract(self._target_position, self._position, p)
        self._turn_left()
        self._to_world()
        return float(p.dot(p)), float(w.dot(w))

    def update_jacobian(self) -> None:
        """Bring `J` up to date with the last `move`."""
        self._com_position()
        self._jacobian()
