"""Collisions: where on a trajectory the arm comes too close to itself or to its surroundings."""

from collections.abc import Callable

import mujoco
import numpy as np

from robo47_qp.errors import Obstacle, PlanError, Rejection
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.robot import Robot
from robo47_qp.robot_model import robot_spec

Surroundings = Callable[[mujoco.MjSpec], None]
"""Adds what stands around to a spec that holds the robot."""
STEP = 0.005
"""Change of a joint between two looks, at most [rad or m]."""


class Collisions:
    """The robot among its surroundings, for distances alone; fingers as in its home.

    Pairs that are too close at home belong to how the robot is built and are left out, and
    so are bodies that move freely: what is to be grasped is no obstacle.
    """

    def __init__(self, robot: Robot, surroundings: Surroundings, clearance: float = 0.005) -> None:
        """Compile them.

        Args:
            robot: The description.
            surroundings: Adds the obstacles.
            clearance: Distance to keep [m].
        """
        self.robot = robot
        self.clearance = clearance
        spec = robot_spec(robot)
        surroundings(spec)
        for body in list(spec.bodies):
            if any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in body.joints):
                spec.delete(body)
        for geom in spec.geoms:
            # MuJoCo sums the margins of the two geoms of a pair.
            geom.margin = 0.5 * clearance
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        joints = [self._model.joint(name) for name in robot.joints]
        self._addresses = [int(joint.qposadr[0]) for joint in joints]
        self._joint_bodies = [int(joint.bodyid[0]) for joint in joints]
        self._allowed: set[tuple[int, int]] = set()
        self._allowed = set(self._close(np.array(robot.home)))

    def at(self, q: np.ndarray) -> tuple[str, str, str, float] | None:
        """The closest pair within the clearance: two bodies, the joint that moves them, distance.

        Args:
            q: Configuration (n,) [rad].

        Returns:
            None where everything is further apart; the joint is the last that moves one of the
            two bodies and not the other, the distance negative where they overlap [m].
        """
        close = self._close(q)
        if not close:
            return None
        pair, distance = min(close.items(), key=lambda item: item[1])
        names = [self._model.body(body).name or "world" for body in pair]
        return names[0], names[1], self._mover(pair), distance

    def check(self, segment: str, trajectory: Trajectory) -> None:
        """Refuse a trajectory that comes too close.

        Raises:
            PlanError: It does; bodies, joint and time are named.
        """
        q, last = trajectory.q, None
        for k, row in enumerate(q):
            looked = last is not None and np.abs(row - last).max() < STEP and k < len(q) - 1
            if looked:
                continue
            last = row
            found = self.at(row)
            if found is not None:
                one, other, joint, distance = found
                time = k * trajectory.dt
                raise PlanError(
                    segment,
                    f"{one} and {other} come within {1e3 * distance:.1f} mm at {time:.3f} s, where "
                    f"{1e3 * self.clearance:.1f} mm are to be kept; {joint} moves them",
                    Rejection(
                        obstacle=Obstacle.COLLISION,
                        segment=segment,
                        fraction=k / max(1, len(q) - 1),
                        time=time,
                        joint=joint,
                        q=tuple(row.tolist()),
                    ),
                )

    def _close(self, q: np.ndarray) -> dict[tuple[int, int], float]:
        d = self._data
        d.qpos[self._addresses] = q
        mujoco.mj_kinematics(self._model, d)
        mujoco.mj_comPos(self._model, d)
        mujoco.mj_collision(self._model, d)
        close: dict[tuple[int, int], float] = {}
        bodies = np.sort(self._model.geom_bodyid[d.contact.geom], axis=1)
        for (one, other), distance in zip(bodies.tolist(), d.contact.dist.tolist(), strict=True):
            if (one, other) not in self._allowed and distance < self.clearance:
                close[one, other] = min(close.get((one, other), np.inf), distance)
        return close

    def _mover(self, pair: tuple[int, int]) -> str:
        moving = []
        for body in pair:
            chain = set()
            at = body
            while at:
                chain.add(at)
                at = int(self._model.body_parentid[at])
            moving.append([i for i, b in enumerate(self._joint_bodies) if b in chain])
        only = set(moving[0]) ^ set(moving[1])
        return self.robot.joints[max(only)] if only else "no joint"
