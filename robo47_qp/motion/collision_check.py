"""Collisions: where on a trajectory the arm comes too close to itself or to its surroundings."""

from collections.abc import Callable, Sequence
from itertools import combinations

import mujoco
import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.collision.motion_bounds import approach_speed_bounds, moved_by
from robo47_qp.errors import PlanError, RefusalReason, Rejection
from robo47_qp.model.mjcf import robot_spec
from robo47_qp.model.robot import Robot
from robo47_qp.motion.refusals import Refusal
from robo47_qp.motion.trajectory import Trajectory

Surroundings = Callable[[mujoco.MjSpec], None]
"""Adds obstacles to a spec that holds the robot."""
_SEEN = 0.1
"""Largest distance that is measured; larger ones count as this [m]."""
_UNSEEN = 0.5
"""Share of the clearance that is also guaranteed between two checks."""
_LEAST = 5e-4
"""Shortest step between two checks, for clearances near zero [m]."""


class Collisions:
    """Collision checks of the robot, fingers fully open, with itself and its surroundings.

    Pairs that are too close at home belong to how the robot is built and are left out, and
    so are bodies that move freely or that a program moves: what is to be grasped is no obstacle.

    A motion is checked as often as its distances require: no pair comes closer by more than
    L |Δq|, with the bounds L of `collision.motion_bounds`. After a check with the least distance
    d, the next one is at L |Δq| = d - half the clearance (conservative advancement: Mirtich,
    "Impulse-based dynamic simulation of rigid body systems", 1996). So no obstacle is missed
    between two checks, however thin: half of any clearance from 1 mm on is kept there too.
    """

    def __init__(self, robot: Robot, surroundings: Surroundings, clearance: float = 0.005) -> None:
        """Compile the robot with its surroundings.

        Args:
            robot: The description.
            surroundings: Adds the obstacles.
            clearance: Distance to keep [m].
        """
        self.robot = robot
        self.clearance = clearance
        spec = robot_spec(robot, drawn=False)
        surroundings(spec)
        for body in list(spec.bodies):
            free = any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in body.joints)
            if free or body.mocap:
                spec.delete(body)
        for geom in spec.geoms:
            # MuJoCo sums the margins of the two geoms of a pair.
            geom.margin = 0.5 * max(_SEEN, clearance)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        for gripper in robot.grippers:
            for name in gripper.joints:
                self._data.qpos[self._model.joint(name).qposadr[0]] = gripper.width_max / 2
        joints = [self._model.joint(name) for name in robot.joints]
        self._addresses = [int(joint.qposadr[0]) for joint in joints]
        self._joint_bodies = [int(joint.bodyid[0]) for joint in joints]
        self._body: list[int] = self._model.geom_bodyid.tolist()
        self._levers = _levers(self._model, [int(joint.id) for joint in joints])
        self._allowed: set[tuple[int, int]] = set()
        close = self._close(np.array(robot.home))
        self._allowed = {pair for pair, distance in close.items() if distance < clearance}

    def at(self, q: Vector) -> tuple[str, str, str, float] | None:
        """Return the closest pair within the clearance: two bodies, their joint and distance.

        Args:
            q: Configuration (n,) [rad].

        Returns:
            None where everything is further apart; what belongs to the world goes by the name of
            its geom. The joint is the last that moves one of the two bodies and not the other, the
            distance is negative where they overlap [m].
        """
        return self._found(self._close(q))

    def check(self, waypoint: str, trajectory: Trajectory) -> None:
        """Check that a trajectory to a waypoint keeps the clearance.

        Raises:
            PlanError: It does not; bodies, joint and time are named.
        """
        hit = self.first_hit(trajectory.q, trajectory.dt)
        if hit is not None:
            raise PlanError(waypoint, *hit)

    def first_hit(self, q: Matrix, dt: float) -> Refusal | None:
        """Return where a joint path first comes too close to something; None if it does not.

        Args:
            q: Configurations on it, straight between each and the next (N, n) [rad].
            dt: Time from each to the next [s].
        """
        # Largest change of any distance since the start, at each sample.
        way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q, axis=0)) @ self._levers)])
        x, last = 0.0, float(way[-1])
        while True:
            k = int(np.searchsorted(way, x, side="right")) - 1
            share = (x - way[k]) / (way[k + 1] - way[k]) if x < last else 0.0
            now = q[k] + share * (q[k + 1] - q[k]) if share else q[k]
            close = self._close(now)
            found = self._found(close)
            if found is not None:
                time, whole = (k + share) * dt, (len(q) - 1) * dt
                one, other, joint, distance = found
                explanation = (
                    f"{one} and {other} come within {1e3 * distance:.1f} mm at {time:.3f} s, where "
                    f"{1e3 * self.clearance:.1f} mm are to be kept; {joint} moves them"
                )
                rejection = Rejection(
                    reason=RefusalReason.COLLISION,
                    fraction=time / whole if whole else 0.0,
                    time=time,
                    joint=joint,
                    q=tuple(now.tolist()),
                )
                return Refusal(explanation, rejection)
            if x >= last:
                return None
            least = min(close.values(), default=np.inf)
            x += max(_LEAST, min(least, _SEEN) - _UNSEEN * self.clearance)
            x = min(x, last)

    def _found(self, close: dict[tuple[int, int], float]) -> tuple[str, str, str, float] | None:
        pair, distance = min(close.items(), key=lambda item: item[1], default=((0, 0), np.inf))
        if distance >= self.clearance:
            return None
        one, other = (self._name(body, pair, distance) for body in pair)
        return one, other, self._mover(pair), distance

    def _name(self, body: int, pair: tuple[int, int], distance: float) -> str:
        """Return the name of a body; of the world, that of its geom, if it has one."""
        if body:
            return self._model.body(body).name or f"body {body}"
        contact = self._data.contact
        bodies = np.sort(self._model.geom_bodyid[contact.geom], axis=1)
        row = np.flatnonzero((bodies == pair).all(axis=1) & (contact.dist == distance))[0]
        geoms = contact.geom[row]
        [geom] = geoms[self._model.geom_bodyid[geoms] == 0]
        return self._model.geom(geom).name or "world"

    def _close(self, q: Vector) -> dict[tuple[int, int], float]:
        """Return the distances of the pairs of bodies that are near and not allowed to be [m]."""
        d = self._data
        d.qpos[self._addresses] = q
        mujoco.mj_kinematics(self._model, d)
        mujoco.mj_collision(self._model, d)
        close: dict[tuple[int, int], float] = {}
        body, allowed, contact = self._body, self._allowed, d.contact
        for (first, second), distance in zip(
            contact.geom.tolist(), contact.dist.tolist(), strict=True
        ):
            a, b = body[first], body[second]
            pair = (a, b) if a < b else (b, a)
            if pair not in allowed and distance < close.get(pair, np.inf):
                close[pair] = distance
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


def _levers(model: mujoco.MjModel, joints: Sequence[int]) -> Vector:
    """Return a bound on how fast each joint brings any pair of geoms closer (n,) [m per rad]."""
    moves, bodies = moved_by(model), model.geom_bodyid
    solid = [g for g in range(model.ngeom) if model.geom_contype[g] or model.geom_conaffinity[g]]
    pairs = tuple(
        (a, b) for a, b in combinations(solid, 2) if (moves[bodies[a]] != moves[bodies[b]]).any()
    )
    if not pairs:
        return np.zeros(len(joints))
    longest: Vector = approach_speed_bounds(model, pairs)[:, joints].max(axis=0)
    return longest
