"""Evaluation of IK results among obstacles by MuJoCo's contacts."""

from collections.abc import Sequence

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.evaluation.benchmarks.ik.judge import joint_limits
from robo47_qp.ik.solver import IkResult
from robo47_qp.model.obstacle import Obstacle
from robo47_qp.model.robot import Robot

SEEN = 0.2
"""Contacts are reported up to this distance [m]."""
REACHED = 1e-6
"""Accepted position [m] and orientation [rad] errors, with room for rounding."""


class ContactJudge:
    """Contacts of the robot's own file among obstacles, in a model compiled apart from the package.

    Capsules are modelled as a cylinder and two spheres, so that MuJoCo uses other distance
    routines. Neighbouring links are left out only where the robot's file excludes them.
    """

    def __init__(self, robot: Robot, obstacles: Sequence[Obstacle]) -> None:
        """Compile the robot's file with the obstacles."""
        self._tcp = robot.tcp
        spec = mujoco.MjSpec.from_file(str(robot.mjcf))
        for obstacle in obstacles:
            pose = obstacle.T_world_obstacle
            spec.worldbody.add_geom(
                name=obstacle.name,
                type=getattr(mujoco.mjtGeom, f"mjGEOM_{obstacle.shape.name}"),
                size=[*obstacle.size, *(3 - len(obstacle.size)) * [1.0]],
                pos=pose.translation(),
                quat=pose.rotation().wxyz,
            )
        compiled = spec.compile()
        # Numbers of geoms change as soon as one is added.
        numbered = [(geom, int(geom.id)) for geom in spec.geoms if geom.contype]
        for geom, number in numbered:
            if compiled.geom_type[number] == mujoco.mjtGeom.mjGEOM_CAPSULE:
                _take_apart(geom, number, compiled)
        for geom in spec.geoms:
            geom.margin = SEEN / 2
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.q = [int(self.model.joint(name).qposadr[0]) for name in robot.joints]
        self._limits = joint_limits(self.model, robot.joints)

    def clearance(self, q: Vector) -> float:
        """Return the smallest distance of any contact [m]; SEEN where there is none."""
        self.data.qpos[:] = 0.0
        self.data.qpos[self.q] = q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        return float(np.min(self.data.contact.dist, initial=SEEN))

    def accepts(self, result: IkResult, target: SE3) -> bool:
        """Return True if the pose is reached within the joint limits, by own measurement."""
        self.clearance(result.q)
        site = self.data.site(self._tcp)
        away = np.linalg.norm(site.xpos - target.translation())
        R = site.xmat.reshape(3, 3)
        turn = SO3.from_matrix(R.T @ target.rotation().as_matrix()).log()
        low, high = self._limits
        inside = (result.q >= low).all() and (result.q <= high).all()
        return bool(inside and max(away, np.linalg.norm(turn)) < 1.01 * REACHED)


def _take_apart(geom: mujoco.MjsGeom, number: int, compiled: mujoco.MjModel) -> None:
    pos, quat = compiled.geom_pos[number], compiled.geom_quat[number]
    radius, half, _ = compiled.geom_size[number]
    axis = SO3(quat).as_matrix()[:, 2] * half
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    geom.parent.add_geom(type=cylinder, size=[radius, half, 0], pos=pos, quat=quat, mass=0)
    for end in (pos + axis, pos - axis):
        geom.parent.add_geom(size=[radius, 0, 0], pos=end, mass=0)
    geom.contype = geom.conaffinity = 0
