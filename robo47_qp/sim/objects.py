"""SimulatedObjects: the free and mocap bodies of a MuJoCo model."""

from typing import NamedTuple

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import UnknownNameError
from robo47_qp.sim.scene import free_bodies, mocap_bodies
from robo47_qp.sim.signal import POSE, POSE_UNIT, Signal

_TWIST = ("x", "y", "z", "wx", "wy", "wz")
_PER_S, _PER_S2 = "m/s, rad/s", "m/s², rad/s²"
"""Labels and units of an object's motion: linear in the world, angular in the body."""


class Inertia(NamedTuple):
    """Where the mass of a body is, in its frame."""

    centre: Vector
    """Its centre (3,) [m]."""
    moments: Matrix
    """Moments about it (3, 3) [kg·m²]."""

    @classmethod
    def of(cls, model: mujoco.MjModel, name: str) -> "Inertia":
        """Return that of a body of a model."""
        body = model.body(name)
        R = SO3(np.array(body.iquat)).as_matrix()
        return cls(np.array(body.ipos), R @ np.diag(body.inertia) @ R.T)


class SimulatedObjects:
    """Reads and places free bodies (objects) and mocap bodies (markers); part of `Simulation`."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Take views of the bodies' state in `data`."""
        self._model, self._data = model, data
        self.objects = free_bodies(model)
        self.markers = mocap_bodies(model)
        joints = {name: model.joint(model.body(name).jntadr[0]) for name in self.objects}
        self._poses = {name: data.qpos[joint.qposadr[0] :][:7] for name, joint in joints.items()}
        self._twists = {name: data.qvel[joint.dofadr[0] :][:6] for name, joint in joints.items()}
        self.signals_now = {
            Signal(name=f"objects/{name}", labels=POSE, unit=POSE_UNIT): (pose,)
            for name, pose in self._poses.items()
        }
        self.signals_now |= {
            Signal(name=f"motion/{name} velocity", labels=_TWIST, unit=_PER_S, shown=False): (v,)
            for name, v in self._twists.items()
        }
        changes = {name: data.qacc[joint.dofadr[0] :][:6] for name, joint in joints.items()}
        self.signals_last = {
            Signal(name=f"motion/{name} acceleration", labels=_TWIST, unit=_PER_S2, shown=False): (
                a,
            )
            for name, a in changes.items()
        }
        self._changes = changes
        self._frictions: Matrix | None = None
        """Of all geoms, before that of an object was set first."""

    def reset(self) -> None:
        """Give the objects the friction that the scene describes."""
        if self._frictions is not None:
            self._model.geom_friction[:] = self._frictions

    def pose(self, name: str) -> SE3:
        """See `Simulation.object_pose`."""
        pose = self._poses[self._known(name)]
        return SE3(np.concatenate([pose[3:], pose[:3]]))

    def twist(self, name: str) -> Vector:
        """See `Simulation.object_twist`."""
        return self._twists[self._known(name)].copy()

    def place(self, name: str, T_world_object: SE3) -> None:
        """See `Simulation.place_object`."""
        pose = self._poses[self._known(name)]
        pose[:3] = T_world_object.translation()
        pose[3:] = T_world_object.rotation().wxyz
        self._twists[name][:] = 0.0
        mujoco.mj_step1(self._model, self._data)

    def carry(self, name: str, T_world_object: SE3) -> None:
        """Put a free body at its pose a period later, with the motion that leads there."""
        pose, twist = self._poses[self._known(name)], self._twists[name]
        rotation, turn = T_world_object.rotation().wxyz, np.zeros(3)
        linear = (T_world_object.translation() - pose[:3]) / TIMESTEP
        mujoco.mju_subQuat(turn, rotation, pose[3:])
        motion = np.concatenate([linear, turn / TIMESTEP])
        self._changes[name][:] = (motion - twist) / TIMESTEP
        twist[:] = motion
        pose[:3], pose[3:] = T_world_object.translation(), rotation

    def rest(self, name: str) -> None:
        """Let a free body be where it is a period later, and at rest."""
        twist = self._twists[self._known(name)]
        self._changes[name][:] = -twist / TIMESTEP
        twist[:] = 0.0

    def set_friction(self, name: str, friction: float) -> None:
        """See `Simulation.set_friction`."""
        body = self._model.body(self._known(name)).id
        m = self._model
        if self._frictions is None:
            self._frictions = m.geom_friction.copy()
        # What has its own friction on anything, as foam has, has a priority.
        m.geom_friction[(m.geom_bodyid == body) & (m.geom_priority == 0), 0] = friction

    def marker_pose(self, name: str) -> SE3:
        """See `Simulation.marker_pose`."""
        i = self._marker(name)
        return SE3(np.concatenate([self._data.mocap_quat[i], self._data.mocap_pos[i]]))

    def place_marker(self, name: str, T_world_marker: SE3) -> None:
        """See `Simulation.place_marker`."""
        i = self._marker(name)
        self._data.mocap_pos[i] = T_world_marker.translation()
        self._data.mocap_quat[i] = T_world_marker.rotation().wxyz
        mujoco.mj_step1(self._model, self._data)

    def _marker(self, name: str) -> int:
        if name not in self.markers:
            raise UnknownNameError("marker", name, self.markers)
        return self.markers.index(name)

    def _known(self, name: str) -> str:
        if name not in self._poses:
            raise UnknownNameError("object", name, self.objects)
        return name
