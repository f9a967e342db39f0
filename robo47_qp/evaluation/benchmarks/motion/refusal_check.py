"""Refusal check: is the reason that a planner names for a refusal the true one?"""

from collections.abc import Sequence

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.errors import PlanError, RefusalReason, Rejection
from robo47_qp.evaluation.benchmarks.motion.commanded_path import CommandedPath
from robo47_qp.evaluation.benchmarks.motion.reference_kinematics import ReferenceKinematics
from robo47_qp.model.tool_poses import one_pose
from robo47_qp.motion.waypoint import Place, Waypoint

_ON_PATH = 2e-5
"""The configuration before an obstacle has its tool on the path as closely as this [m]."""
_STEP = 0.02
"""The pose that is not reached is no further away than this [m and rad]."""
_REACHED = 3e-7
"""A pose counts as reached [m and rad]: a third of the tolerance of the solvers that failed."""
_NEARBY = 0.1
"""Joints that move less are on the same branch [rad or m]."""
_AT_LIMIT = 1e-3
"""A joint that slides along its limit is this close to it [rad or m]."""
_SINGULAR = 0.05
"""A refusal for a singularity must show a singular value below [m and rad]."""
_RATE = 5000.0
"""Joints that would have to move more than this on the way to a pose take some 600 times as long
as the tool alone [rad per m or rad]: what a singularity asks for."""
_STARTS = 40
_LOCAL_STARTS = 4
_SEED = 7


class RefusalCheck:
    """Confirms refusals by MuJoCo's kinematics and scipy's bounded searches.

    - out of reach: bounded searches from many random configurations do not reach the pose;
    - joint limit: within the limits no configuration near the last one reaches the pose; the
      search without limits does, and the joint named is then outside;
    - singularity: the Jacobian of the file has next to no gain, and no configuration reaches
      the pose without joints that run some 600 times too fast for the tool;
    - branch change: a search elsewhere reaches the pose, none nearby does;
    - shape: the blends do not fit on the lines, or the points make no circle.

    Where a configuration is told, it must be inside the limits with its tool on the path that
    was asked for, and the pose that is not reached must be on that path and next to it.
    Collisions, paces and precision are confirmed by nothing here.
    """

    def __init__(self, look: ReferenceKinematics) -> None:
        """Of one robot."""
        self._look = look

    def doubt(self, q_start: Vector, waypoints: Sequence[Waypoint], error: PlanError) -> str | None:
        """What speaks against a refusal; None where its reason holds.

        Args:
            q_start: Where the motion was to start (n,) [rad].
            waypoints: What was asked for.
            error: The refusal.
        """
        look, found = self._look, error.rejection
        named = next((w for w in waypoints if w.name == error.waypoint), None)
        if named is None:
            return f"no waypoint is called {error.waypoint!r}"
        if found is None:
            return self._unreached(named)
        path = CommandedPath(look.pose(q_start), waypoints, look.pose(look.home))
        if found.reason is RefusalReason.SHAPE:
            return None if path.shape_error() else "the shape seems to be one"
        if found.q is None:
            return "no configuration is told"
        q = np.array(found.q)
        if found.pose is None:
            return self._sliding(found, q)
        return self._misplaced(path, found, q) or self._unfounded(found, q)

    def _unreached(self, waypoint: Waypoint) -> str | None:
        if isinstance(waypoint.target, Place):
            return "home is always reached"
        rng = np.random.default_rng(_SEED)
        there = self._look.reaches(one_pose(waypoint.target).wxyz_xyz, _STARTS, rng, _REACHED)
        return None if there is None else "the pose is reached"

    def _misplaced(self, path: CommandedPath, found: Rejection, q: Vector) -> str | None:
        look, pose = self._look, np.array(found.pose)
        if not look.inside(q):
            return "the configuration before is outside the limits"
        apart = float(np.abs(look.away(q, pose)).max())
        if apart > _STEP:
            return f"the pose is {apart:.4f} from the configuration before it"
        if path.specified:
            off = path.distance(np.array([look.position(q), pose[4:]]))
            if off.max() > _ON_PATH:
                return f"the obstacle is {off.max():.6f} m off the path"
        return None

    def _unfounded(self, found: Rejection, q: Vector) -> str | None:
        look, pose = self._look, np.array(found.pose)
        rng = np.random.default_rng(_SEED)
        room = _NEARBY
        if found.reason is RefusalReason.SINGULARITY:
            room = min(room, _RATE * float(np.abs(look.away(q, pose)).max()))
        if self._nearby(pose, q, room, rng):
            return "it is reached nearby"
        if found.reason is RefusalReason.JOINT_LIMIT:
            return self._within(found, pose, q)
        if found.reason is RefusalReason.SINGULARITY:
            least = look.least_gain(q)
            return None if least < _SINGULAR else f"the least gain is {least:.3f}"
        if found.reason in (RefusalReason.REACH, RefusalReason.BRANCH):
            there = look.reaches(pose, _STARTS, rng, _REACHED)
            if (there is None) == (found.reason is RefusalReason.REACH):
                return None
            return "the pose is not reached" if there is None else "the pose is reached"
        return f"nothing here can confirm {found.reason.value}"

    def _nearby(self, pose: Vector, q: Vector, room: float, rng: np.random.Generator) -> bool:
        """True where a configuration close by, inside the limits, reaches the pose."""
        low, high = np.maximum(self._look.q_min, q - room), q + room
        high = np.minimum(self._look.q_max, high)
        starts = [q, *rng.uniform(low, high, (_LOCAL_STARTS, len(q)))]
        return any(self._look.nearest(pose, start, (low, high))[1] <= _REACHED for start in starts)

    def _within(self, found: Rejection, pose: Vector, q: Vector) -> str | None:
        """The search without limits must lead the named joint out of them."""
        if found.joint not in self._look.joints:
            return f"no joint is called {found.joint}"
        i = self._look.joints.index(found.joint)
        free, off = self._look.unlimited(pose, q)
        if off > _REACHED:
            return f"without limits it is not reached either: {off:.7f}"
        margin = min(free[i] - self._look.q_min[i], self._look.q_max[i] - free[i])
        return None if margin < 0.0 else f"{found.joint} stays {margin:.5f} inside its limits"

    def _sliding(self, found: Rejection, q: Vector) -> str | None:
        """Without a pose: the joint named is at its limit, or the arm is singular there."""
        if found.reason is RefusalReason.JOINT_LIMIT and found.joint in self._look.joints:
            i = self._look.joints.index(found.joint)
            margin = min(q[i] - self._look.q_min[i], self._look.q_max[i] - q[i])
            return None if margin < _AT_LIMIT else f"{found.joint} is {margin:.4f} from its limit"
        if found.reason is RefusalReason.SINGULARITY:
            least = self._look.least_gain(q)
            return None if least < _SINGULAR else f"the least gain is {least:.3f}"
        return f"nothing here can confirm {found.reason.value}"
