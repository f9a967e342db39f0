"""Planner: from waypoints to the trajectories that lead there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, pairwise
from math import inf

import numpy as np
from mink import SE3

from robo47_qp.arrays import Matrix, Range, Vector
from robo47_qp.errors import NO_PATH, PlanError, RefusalReason, Rejection
from robo47_qp.ik.solver import IkResult
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import ToolPoses
from robo47_qp.motion.blending import least_with_stops, quickest
from robo47_qp.motion.branch_choice import BranchChoice
from robo47_qp.motion.motion_type import PlannerSettings
from robo47_qp.motion.paths.segments import PathProfile, Segment
from robo47_qp.motion.paths.together import ToolsPath
from robo47_qp.motion.request import Planned, Request
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.motion.waypoint import Waypoint, goal_pose

_ROOM = 1.02
"""Bounds are lowered by so much more than is needed."""
_NEAR = 0.85
"""Share of what the motors may do at which a motion counts as using it [-]."""
_ROUNDS = 8
"""Attempts with lower bounds, of which the second or third usually does."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """A planned motion to a waypoint."""

    waypoint: Waypoint
    ik: IkResult
    trajectory: Trajectory
    T_world_start: SE3
    """Pose of the main tool at the start."""
    T_world_goal: SE3
    """Pose asked for of the main tool, or where it stays."""
    tools: ToolPoses | None = None
    """Poses asked for of several tools; None where the main tool alone is asked for."""
    together: ToolsPath | None = None
    """What several tools are to stay on, as `path` for the main one alone."""
    speed: float = inf
    """Speed limit of the tool that a step gave it, besides that of the planner [m/s]."""
    path: Segment | None = None
    """What the tool is to stay on; None for PTP motions and where corners are blended."""
    lower_bound: float = 0.0
    """Time that no motion along the same path can beat [s]; 0 where parts of one motion follow
    each other without a stop."""

    @property
    def stops(self) -> bool:
        """True where it ends at rest; with a blend asked for, because a stop is faster."""
        return not self.trajectory.v[-1].any()

    def tool_paths(self, arm: Arm) -> dict[str, Matrix]:
        """Return the positions (N, 3) of the tools that it moves, by their names [m]."""
        names = [arm.robot.tools[0].name] if self.tools is None else [*self.tools]
        tools = {name: arm.robot.tool_index(name) for name in names}
        return {
            name: np.array([arm.pose(q, tool).translation() for q in self.trajectory.q])
            for name, tool in tools.items()
        }


def split_at(count: int, stops: frozenset[int]) -> list[slice]:
    """Return which waypoints belong to each motion when a run stops at some of them."""
    ends = [-1, *sorted(stops), count - 1]
    return [slice(first + 1, last + 1) for first, last in pairwise(ends)]


def duration(legs: Sequence[Leg]) -> float:
    """Return how long motions take one after the other [s]."""
    return sum(leg.trajectory.duration for leg in legs)


@dataclass(frozen=True, kw_only=True)
class Planner(PlannerSettings):
    """Plans motions whole, before they run. Its fields are settings."""

    branch_choice: BranchChoice = BranchChoice()
    """How configurations are chosen."""

    def plan(self, arm: Arm, waypoint: Waypoint, q_start: Vector, dt: float) -> Leg:
        """Plan from rest at q_start to rest at a waypoint.

        The goal of a PTP motion is sought near home, so that it does not depend on where the
        arm comes from (among obstacles, the one with most clearance that is soon reached is
        taken), and such that the tool paths that are to follow can be. Where the motion to it is
        refused, others are tried. Other motions follow their path from where the arm is.

        Raises:
            InvalidValueError: `q_start` is not finite, dt not positive, or the profile is of other
                joints.
            PlanError: The waypoint is not reached by IK, the motion to it is not possible, or
                what follows it is not; the waypoint in question is named.
        """
        q_start = self._checked(arm, q_start, dt)
        if not waypoint.rests:
            explanation = "it is not to be stopped at and nothing is known to follow"
            raise PlanError(waypoint.name, explanation, NO_PATH)
        if waypoint.prescribes_path:
            return self._leg(arm, waypoint, None, q_start, dt)
        if not arm.obstacles:
            return self._to_any(arm, waypoint, q_start, dt)
        led, v_max = (waypoint, *waypoint.onward), self.profile.v_max
        result = self.branch_choice.choose(arm, self.ik, self.lin, led, q_start, v_max)[0]
        return self._leg(arm, waypoint, result, q_start, dt)

    def plan_chain(
        self, arm: Arm, waypoints: Sequence[Waypoint], q_start: Vector, dt: float
    ) -> list[Leg]:
        """Plan through waypoints that are all known, their configurations chosen together.

        Waypoints that are blended or passed are run through without a stop; the legs of such a
        motion join with the same velocity. Where waypoints name other tools than those before
        them, the choice begins anew, as the joints of tools that are not named stand still.

        Raises:
            InvalidValueError: `q_start` is not finite, dt not positive, or the profile is of other
                joints.
            PlanError: No choice leads through, or the motion is refused; the waypoint in
                question is named.
        """
        q, legs = self._checked(arm, q_start, dt), list[Leg]()
        for _, members in groupby(waypoints, key=lambda one: _tools_of(arm, one)):
            legs += self._chain(arm, list(members), q, dt)
            q = legs[-1].trajectory.end.q
        return legs

    def _checked(self, arm: Arm, q_start: Vector, dt: float) -> Vector:
        Range(above=0.0, single=True).check("dt", dt)
        self.profile.check_joints(arm.n)
        return arm.checked_q("q_start", q_start)

    def _chain(self, arm: Arm, waypoints: Sequence[Waypoint], q: Vector, dt: float) -> list[Leg]:
        """Plan through waypoints of the same tools."""
        if not waypoints[-1].rests:
            raise PlanError(waypoints[-1].name, "it is the last and not to be stopped at", NO_PATH)
        v_max = self.profile.v_max
        chosen = self.branch_choice.choose(arm, self.ik, self.lin, waypoints, q, v_max)
        legs, first = list[Leg](), 0
        for i, waypoint in enumerate(waypoints):
            if not waypoint.rests:
                continue
            run, results = waypoints[first : i + 1], chosen[first : i + 1]
            legs += self._blended(arm, run, results, q, dt)
            first, q = i + 1, legs[-1].trajectory.end.q
        return legs

    def _to_any(self, arm: Arm, waypoint: Waypoint, q_start: Vector, dt: float) -> Leg:
        """Plan to the first configuration that can be reached and from which the rest follows."""
        refusals: list[PlanError] = []
        for result in self.branch_choice.candidates_for(arm, self.ik, self.lin, waypoint, q_start):
            try:
                return self._leg(arm, waypoint, result, q_start, dt)
            except PlanError as error:
                refusals.append(error)
        raise refusals[0]

    def _leg(
        self, arm: Arm, waypoint: Waypoint, reached: IkResult | None, q_start: Vector, dt: float
    ) -> Leg:
        request = waypoint.request(arm, self.ik, self.pace, reached)
        plan = partial(_between, arm, [waypoint], [request], q_start, dt)
        return self._within_motors(arm, plan, dt)[0]

    def _within_motors(
        self, arm: Arm, plan: Callable[["Planner"], list[Leg]], dt: float
    ) -> list[Leg]:
        """Plan with less acceleration and jerk until the motors have to spend no more than said."""
        legs, best, most = plan(self), None, [0.0]
        if self.motors is None:
            return legs
        less = [1.0, 1.0]
        for _ in range(_ROUNDS):
            asked = [self.motors.excess(arm, leg.trajectory, dt) for leg in legs]
            most = [max(each) for each in zip(*asked, strict=True)]
            if max(most) <= 1.0 and (best is None or duration(legs) < duration(best)):
                best = legs
            if best is not None and (max(most) > _NEAR or max(less) == 1.0):
                return best
            # What follows a path does not change in proportion: it may have been slowed too much.
            pairs = zip(less, most, strict=True)
            less = [max(1.0, factor * _ROOM * share) for factor, share in pairs]
            legs = plan(self.gentler(*less))
        if best is not None:
            return best
        name = legs[-1].waypoint.name
        told = f"its motors would have to do {max(most):.2g} times what they may"
        raise PlanError(name, told, Rejection(reason=RefusalReason.PACE))

    def slower(self, speed: float) -> "Planner":
        """Return it with a speed limit of the tool [m/s] and the same accelerations."""

        def bounded(profile: PathProfile) -> PathProfile:
            v, a, j = profile.linear
            return replace(profile, linear=(min(speed, v), a, j))

        lin, continuous = self.lin, self.continuous
        return replace(
            self,
            lin=replace(lin, profile=bounded(lin.profile)),
            continuous=replace(continuous, profile=bounded(continuous.profile)),
        )

    def gentler(self, torque: float, rate: float) -> "Planner":
        """Return the planner with accelerations and jerks that are smaller by these factors."""
        lin, continuous, joints = self.lin, self.continuous, self.profile
        return replace(
            self,
            profile=replace(joints, a_max=joints.a_max / torque, j_max=joints.j_max / rate),
            lin=replace(lin, profile=lin.profile.gentler(torque, rate)),
            continuous=replace(continuous, profile=continuous.profile.gentler(torque, rate)),
        )

    def _blended(
        self,
        arm: Arm,
        run: Sequence[Waypoint],
        results: Sequence[IkResult],
        q_start: Vector,
        dt: float,
    ) -> list[Leg]:
        """Plan a run to rest at its last waypoint, with stops before where they save time."""
        requests = [
            waypoint.request(arm, self.ik, self.pace, result)
            for waypoint, result in zip(run, results, strict=True)
        ]
        corners = [i for i, waypoint in enumerate(run[:-1]) if waypoint.blend]

        def plan(stops: frozenset[int]) -> list[Leg]:
            legs, q = list[Leg](), q_start
            for part in split_at(len(run), stops):
                mine, asked = run[part], requests[part]

                legs += self._within_motors(arm, partial(_between, arm, mine, asked, q, dt), dt)
                q = legs[-1].trajectory.end.q
            return legs

        floor = 0.0
        if corners:
            floor = least_with_stops(arm, q_start, requests, self.profile, self.lin.profile)
        return quickest(corners, plan, duration, floor)


def _between(
    arm: Arm,
    run: Sequence[Waypoint],
    requests: Sequence[Request],
    q: Vector,
    dt: float,
    planner: Planner,
) -> list[Leg]:
    """Return the legs of one motion from rest through waypoints to rest at the last."""
    if len(run) == 1:
        found = [run[0].motion.type.plan(planner, arm, requests[0], q, dt)]
    else:
        found = planner.without_stops(arm, requests, q, dt)
    return [_leg(arm, *one) for one in zip(run, requests, found, strict=True)]


def _tools_of(arm: Arm, waypoint: Waypoint) -> tuple[str, ...]:
    """Return the names of the tools that a waypoint is for; none where it is the main tool's."""
    goal = goal_pose(arm, waypoint)
    return tuple(goal) if isinstance(goal, ToolPoses) else ()


def _leg(arm: Arm, waypoint: Waypoint, request: Request, planned: Planned) -> Leg:
    start, goal = arm.pose(planned.trajectory.q[0]), request.T_world_goal
    whole = planned._asdict()
    path = whole.pop("path")
    if isinstance(goal, SE3):
        return Leg(waypoint=waypoint, T_world_start=start, T_world_goal=goal, path=path, **whole)
    return Leg(
        waypoint=waypoint,
        T_world_start=start,
        T_world_goal=goal.get(arm.robot.tool_name, start),
        tools=goal,
        together=path,
        **whole,
    )
