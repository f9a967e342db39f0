"""Collisions: where on a trajectory the arm comes too close to itself or to its surroundings."""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from robo47_qp.arrays import Matrix, Range, Vector, contiguous
from robo47_qp.collision.motion_bounds import approach_speed_bounds
from robo47_qp.collision.pair_distances import PairDistances
from robo47_qp.collision.pairs import colliding_pairs
from robo47_qp.errors import InvalidValueError, PlanError, RefusalReason, Rejection
from robo47_qp.model.mjcf import robot_spec
from robo47_qp.model.robot import Robot
from robo47_qp.motion.refusals import Refusal
from robo47_qp.motion.trajectory import Trajectory

Surroundings = Callable[[mujoco.MjSpec], None]
"""Adds obstacles to a spec that holds the robot."""
_SEEN = 0.1
"""Largest distance that is measured, or twice the clearance; larger ones count as this [m]."""
_OWN = "of the robot"
_UNSEEN = 0.5
"""Share of the clearance that is also guaranteed between two checks."""
_LEAST = 5e-4
"""Shortest step between two checks, for clearances near zero [m]."""


class Collisions:
    """Collision checks of the robot, fingers fully open, with itself and its surroundings.

    Pairs of the robot itself, its mount and what it holds that are too close at home belong to
    how it is built and are left out, and so are bodies that move freely or that a program moves:
    what is to be grasped is no obstacle.

    A motion is checked as often as its distances require: no pair comes closer by more than
    L |Δq|, with the bounds L of `collision.motion_bounds`. After a check with the least distance
    d, the next one is at L |Δq| = d - half the clearance (conservative advancement: Mirtich,
    "Impulse-based dynamic simulation of rigid body systems", 1996). So no obstacle is missed
    between two checks, however thin: half of any clearance from 1 mm on is kept there too. Where
    more than that may be missing, the samples between two checks are looked at, too: the whole
    clearance is kept at every sample.
    """

    def __init__(
        self,
        robot: Robot,
        surroundings: Surroundings,
        clearance: float = 0.005,
        *,
        touched_at_home: bool = False,
    ) -> None:
        """Compile the robot with its surroundings.

        Args:
            robot: The description.
            surroundings: Adds the obstacles.
            clearance: Distance to keep [m].
            touched_at_home: Leave out what stands too close to a body of the robot at home, for
                that body alone; else no motion from there is free.

        Raises:
            InvalidValueError: The clearance is negative or no number.
        """
        Range(at_least=0.0, single=True).check("clearance", clearance)
        self.robot = robot
        self.clearance = clearance
        self._seen = max(_SEEN, 2.0 * clearance)
        spec = robot_spec(robot, drawn=False)
        for geom in spec.geoms:
            geom.info = _OWN
        surroundings(spec)
        for body in list(spec.bodies):
            free = any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in body.joints)
            if free or body.mocap:
                spec.delete(body)
        m = self._model = spec.compile()
        joints = [m.joint(name).id for name in robot.joints]
        self._joint_bodies: list[int] = m.jnt_bodyid[joints].tolist()
        pairs = colliding_pairs(m)
        reach = approach_speed_bounds(m, tuple(pairs))[:, joints]
        self._levers = reach.max(axis=0, initial=0.0)
        """A bound on how fast each joint brings any pair of geoms closer (n,) [m per rad]."""
        at_home = self._open(PairDistances(m, joints, pairs, reach)).at(np.array(robot.home))
        geoms = np.array(pairs, dtype=int).reshape(-1, 2)
        # What stands in the world has no body of its own: each of its geoms is one.
        bodies = np.sort(np.where(m.geom_bodyid[geoms], m.geom_bodyid[geoms], -geoms), axis=1)
        near = at_home < clearance
        if not touched_at_home:
            around = np.zeros(m.ngeom, dtype=bool)
            around[[geom.id for geom in spec.geoms if geom.info != _OWN]] = True
            around &= m.body_weldid[m.geom_bodyid] == 0
            near &= ~around[geoms].any(axis=1)
        close = {tuple(pair) for pair in bodies[near].tolist()}
        apart = [tuple(pair) not in close for pair in bodies.tolist()]
        pairs = [pair for pair, kept in zip(pairs, apart, strict=True) if kept]
        self._distances = self._open(PairDistances(m, joints, pairs, reach[apart]))

    def at(self, q: Vector) -> tuple[str, str, str, float] | None:
        """Return the closest pair within the clearance: two bodies, their joint and distance.

        Args:
            q: Configuration (n,) [rad].

        Returns:
            None where everything is further apart; what belongs to the world goes by the name of
            its geom. The joint is the last that moves one of the two bodies and not the other, the
            distance is negative where they overlap [m].

        Raises:
            InvalidValueError: A number of q is not finite.
        """
        return self._found(self._distances.at(self._finite(q), self.clearance))

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

        Raises:
            InvalidValueError: There is no configuration, or a number is not finite.
        """
        q = self._finite(q, None)
        # Largest change of any distance since the start, at each sample.
        way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q, axis=0)) @ self._levers)])
        last, free, near = float(way[-1]), 0.0, self._seen
        ahead = [0.0]
        while ahead:
            x = ahead[-1]
            k = int(np.searchsorted(way, x, side="right")) - 1
            share = (x - way[k]) / (way[k + 1] - way[k]) if x < last else 0.0
            now = q[k] + share * (q[k + 1] - q[k]) if share else q[k]
            apart = self._distances.at(now, self._seen)
            found = self._found(apart)
            if found is not None:
                return self._refusal(found, now, (k + share) * dt, (len(q) - 1) * dt)
            least = float(apart.min(initial=self._seen))
            # The samples between two looks at which it could have been too close.
            first, end = np.searchsorted(way, free, "right"), np.searchsorted(way, x)
            if first < end and near + least - (x - free) < 2.0 * self.clearance:
                ahead.append(float(way[(first + end) // 2]))
                continue
            free, near = ahead.pop(), least
            if not ahead and x < last:
                ahead.append(min(last, x + max(_LEAST, least - _UNSEEN * self.clearance)))
        return None

    def _finite(self, q: Matrix, *rows: None) -> Matrix:
        found = contiguous("q", q, *rows, len(self.robot.joints))
        if not found.size or not np.isfinite(found).all():
            raise InvalidValueError("q", f"{found!r:.60}", "finite numbers, of one row at least")
        return found

    def _refusal(
        self, found: tuple[str, str, str, float], q: Vector, time: float, whole: float
    ) -> Refusal:
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
            q=tuple(q.tolist()),
        )
        return Refusal(explanation, rejection)

    def _found(self, apart: Vector) -> tuple[str, str, str, float] | None:
        distance = float(apart.min(initial=np.inf))
        if distance >= self.clearance:
            return None
        geoms = self._distances.pairs[int(apart.argmin())]
        bodies = [int(self._model.geom_bodyid[geom]) for geom in geoms]
        named = sorted(zip(bodies, geoms, strict=True))
        one, other = (self._name(body, geom) for body, geom in named)
        return one, other, self._mover(bodies), distance

    def _name(self, body: int, geom: int) -> str:
        """Return the name of a body; of the world, that of its geom, if it has one."""
        if body:
            return self._model.body(body).name or f"body {body}"
        return self._model.geom(geom).name or "world"

    def _open(self, distances: PairDistances) -> PairDistances:
        """Open the fingers of its state."""
        for gripper in self.robot.grippers:
            for name in gripper.joints:
                address = self._model.joint(name).qposadr[0]
                distances.data.qpos[address] = gripper.width_max / 2
        return distances

    def _mover(self, bodies: Sequence[int]) -> str:
        moving = []
        for body in bodies:
            chain = set()
            at = body
            while at:
                chain.add(at)
                at = int(self._model.body_parentid[at])
            moving.append([i for i, b in enumerate(self._joint_bodies) if b in chain])
        only = set(moving[0]) ^ set(moving[1])
        return self.robot.joints[max(only)] if only else "no joint"
