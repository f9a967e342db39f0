"""The tool's way to a target and its slope, recomputed in place on the hot path."""

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arm import Arm
from robo47_qp.arrays import Matrix, Vector


class ToolError:
    """Memory for one arm. What `e` and `J` show belongs to the last `move`.

    Both have the axes of the world and the tool point as their origin: norms are those of
    the tool frame, and no Jacobian needs to be turned.
    """

    def __init__(self, arm: Arm) -> None:
        """Make the memory for an arm."""
        self._model, self._data = arm.model, mujoco.MjData(arm.model)
        d, tcp = self._data, arm.model.site(arm.robot.tcp).id
        self._tcp, self._q = tcp, d.qpos
        self._position, self._quaternion = d.site_xpos[tcp], d.site_xquat[tcp]
        self._target_position, self._target_quaternion = np.zeros(3), np.zeros(4)
        self._turn = np.zeros(3)
        self.e: Vector = np.zeros(6)
        """To the target: displacement [m], rotation vector [rad]."""
        self._p, self._w = self.e[:3], self.e[3:]
        self.J: Matrix = np.zeros((6, arm.n))
        """Twist of the tool per joint, linear part first."""
        self._Jp, self._Jr = self.J[:3], self.J[3:]

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's state with the kinematics of the last `move`; not to be written to."""
        return self._data

    def aim(self, T_world_target: SE3) -> None:
        """Measure to this pose from now on."""
        pose = T_world_target.wxyz_xyz
        self._target_quaternion[:], self._target_position[:] = pose[:4], pose[4:]

    def move(self, q: Vector) -> tuple[float, float]:
        """Put the arm at q; the squared distance [m²] and the squared angle [rad²] that remain."""
        self._q[:] = q
        mujoco.mj_kinematics(self._model, self._data)
        p, w = self._p, self._w
        np.subtract(self._target_position, self._position, out=p)
        mujoco.mju_subQuat(self._turn, self._target_quaternion, self._quaternion)
        mujoco.mju_rotVecQuat(w, self._turn, self._quaternion)
        return float(p.dot(p)), float(w.dot(w))

    def differentiate(self) -> None:
        """Bring `J` up to date with the last `move`."""
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_jacSite(self._model, self._data, self._Jp, self._Jr, self._tcp)
