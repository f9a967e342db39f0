"""Poses of all bodies of a scene, from recorded joint positions and object poses."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix
from robo47_qp.model.robot import Robot
from robo47_qp.run.recording import Rows
from robo47_qp.sim.scene import free_bodies


class BodyPoses:
    """Forward kinematics of a scene for the rows of a recording."""

    def __init__(self, model: mujoco.MjModel, robot: Robot) -> None:
        """Look up the addresses of the recorded signals in the `qpos` of a scene."""
        self._model, self._data = model, mujoco.MjData(model)
        self._sources: list[tuple[str, list[int]]] = [
            ("joints/q", [_address(model, name) for name in robot.joints])
        ]
        for label, tool in robot.tool_labels():
            if tool.gripper is not None:
                fingers = [_address(model, name) for name in tool.gripper.joints]
                self._sources.append((f"gripper/{label}fingers", fingers))
        for name in free_bodies(model):
            first = int(model.jnt_qposadr[model.body(name).jntadr[0]])
            self._sources.append((f"objects/{name}", list(range(first, first + 7))))
        self.fixed = tuple(np.flatnonzero(model.body_weldid == 0).tolist())
        """Ids of the bodies that never move."""
        free = (model.body_weldid != 0) & (model.body_mocapid[model.body_rootid] < 0)
        self.moving = tuple(np.flatnonzero(free).tolist())
        """Ids of the bodies that move with the robot's and the objects' joints."""

    def of_fixed(self) -> tuple[Matrix, Matrix]:
        """Return positions (fixed, 3) [m] and quaternions wxyz (fixed, 4) of fixed bodies."""
        d, bodies = self._data, list(self.fixed)
        mujoco.mj_kinematics(self._model, d)
        return d.xpos[bodies], d.xquat[bodies]

    def of_moving(self, rows: Rows, picked: NDArray[np.intp]) -> tuple[Matrix, Matrix]:
        """Return the poses of the moving bodies in the rows with the indices `picked` (N,).

        Returns:
            Positions (N, moving, 3) [m] and quaternions wxyz (N, moving, 4).
        """
        m, d, bodies = self._model, self._data, list(self.moving)
        qpos = np.tile(m.qpos0, (len(picked), 1))
        for signal, addresses in self._sources:
            qpos[:, addresses] = rows[signal][picked]
        positions = np.empty((len(picked), m.nbody, 3))
        quaternions = np.empty((len(picked), m.nbody, 4))
        for k, q in enumerate(qpos):
            d.qpos[:] = q
            mujoco.mj_kinematics(m, d)
            positions[k] = d.xpos
            quaternions[k] = d.xquat
        return positions[:, bodies], quaternions[:, bodies]


def _address(model: mujoco.MjModel, joint: str) -> int:
    return int(model.joint(joint).qposadr[0])
