"""Planner: from waypoints to the trajectories that lead there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.errors import PlanError
from robo47_qp.ik.solver import IkResult, IkSolver, judged
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.blending import (
    blends_joints,
    cut_ptp,
    least_with_stops,
    parted,
    quickest,
)
from robo47_qp.motion.branch_choice import BranchChoice, tool_target
from robo47_qp.motion.collision_check import Collisions
from robo47_qp.motion.continuous import Continuous, PacedProfile, Passage
from robo47_qp.motion.detour import Detour
from robo47_qp.motion.following.limits import LinError
from robo47_qp.motion.following.lin import Lin
from robo47_qp.motion.following.tracking import Effort
from robo47_qp.motion.paths.segments import Arc, Line
from robo47_qp.motion.ptp import plan_ptp
from robo47_qp.motion.route import misshapen, refused, segment
from robo47_qp.motion.timing.lower_bound import paced_bound
from robo47_qp.motion.timing.time_law import S_CURVE, TimeLaw
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.motion.waypoint import Motion, Waypoint


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """A planned way to a waypoint."""

    waypoint: Waypoint
    ik: IkResult
    trajectory: Trajectory
    T_world_start: SE3
    """Tool pose at the start."""
    T_world_goal: SE3
    """Tool pose asked for."""
    way: Line | Arc | None = None
    """What the tool is to stay on; None for PTP motions and where corners are blended."""
    lower_bound: float = 0.0
    """Time that no motion along the same path can beat [s]; 0 where parts of one motion follow
    each other without a stop."""

    @property
    def stops(self) -> bool:
        """True where it ends at rest; with a blend asked for, because a stop is faster."""
        return not self.trajectory.v[-1].any()


def duration(legs: Sequence[Leg]) -> float:
    """Of motions one after the other [s]."""
    return sum(leg.trajectory.duration for leg in legs)


__all__ = ["Leg", "Planner"]


@dataclass(frozen=True, kw_only=True)
class Planner:
    """Plans motions whole, before they run. Its fields are settings."""

    ik: IkSolver
    profile: MotionProfile
    """Bounds of the joints at full pace."""
    pace: float = 1.0
    """Pace of every motion, in (0, 1]."""
    lin: Lin = Lin()
    branch_choice: BranchChoice = BranchChoice()
    """How configurations are chosen."""
    continuous: Continuous = Continuous()
    """How arcs and motions without stops are planned."""
    law: TimeLaw = S_CURVE
    """How PTP and LIN motions run from rest to rest."""
    collisions: Collisions | None = None
    """What is not to be hit; None checks nothing."""
    surroundings: Collisions | None = None
    """Not to be hit by PTP motions, but to get away from; the tool may be meant to touch it."""
    detour: Detour | None = None
    """How PTP motions go around what `collisions` finds in their way; None refuses them."""

    def __post_init__(self) -> None:
        """Check the pace.

        Raises:
            InvalidValueError: `pace` is outside (0, 1].
        """
        self.profile.slowed(self.pace)

    def plan(self, arm: Arm, waypoint: Waypoint, q_start: Vector, dt: float) -> Leg:
        """Plan from rest at q_start to rest at a waypoint.

        The goal of a PTP motion is sought near home, so that it does not depend on where the
        arm comes from (among obstacles, the roomy one that is soon reached is taken), and such
        that the straight motions that are to follow can be. Where the way to it is refused, others
        are tried. A LIN motion follows the arm.

        Raises:
            InvalidValueError: `q_start` is not finite.
            PlanError: The waypoint is not reached by IK, the way there is not possible, or
                it does not lead on; the waypoint that is in the way is named.
        """
        q_start = arm.checked_q("q_start", q_start)
        if not waypoint.rests:
            raise misshapen(waypoint, "it is not to be stopped at and nothing is known to follow")
        if waypoint.motion is Motion.PTP:
            if not arm.obstacles:
                return self._to_any(arm, waypoint, q_start, dt)
            led, v_max = (waypoint, *waypoint.onward), self.profile.v_max
            result = self.branch_choice.choose(arm, self.ik, self.lin, led, q_start, v_max)[0]
            return self._ptp(arm, waypoint, result, q_start, dt)
        return self._tool(arm, waypoint, q_start, dt)

    def plan_chain(
        self, arm: Arm, waypoints: Sequence[Waypoint], q_start: Vector, dt: float
    ) -> list[Leg]:
        """Plan through waypoints that are all known, their configurations chosen together.

        Those that are blended or passed are run through without a stop; the legs of such a
        motion follow each other at speed.

        Raises:
            InvalidValueError: `q_start` is not finite.
            PlanError: No choice leads through, or the motion is refused; the waypoint that is
                in the way is named.
        """
        q = arm.checked_q("q_start", q_start)
        if waypoints and not waypoints[-1].rests:
            raise misshapen(waypoints[-1], "it is the last and not to be stopped at")
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
        """To the first configuration that leads on and that there is a way to."""
        refusals: list[PlanError] = []
        for result in self.branch_choice.leading_on(arm, self.ik, self.lin, waypoint):
            try:
                return self._ptp(arm, waypoint, result, q_start, dt)
            except PlanError as error:
                refusals.append(error)
        raise refusals[0]

    def _blended(
        self,
        arm: Arm,
        run: Sequence[Waypoint],
        results: Sequence[IkResult],
        q_start: Vector,
        dt: float,
    ) -> list[Leg]:
        """To a waypoint that is rested at, stopping before where that is faster than to blend."""
        corners = [i for i, waypoint in enumerate(run[:-1]) if waypoint.blend]

        def plan(stops: frozenset[int]) -> list[Leg]:
            legs, q = list[Leg](), q_start
            for part in parted(run, stops):
                there = [results[i] for i in part]
                legs += self._moved(arm, [run[i] for i in part], there, q, dt)
                q = legs[-1].trajectory.end.q
            return legs

        ends = [q_start, *(result.q for result in results)]
        poses = [arm.pose(q_start), *(tool_target(arm, waypoint) for waypoint in run)]
        pace = PacedProfile(self.profile, self.pace)
        floor = least_with_stops(poses, ends, run, pace, self.lin.profile) if corners else 0.0
        return quickest(corners, plan, duration, floor)

    def _moved(
        self,
        arm: Arm,
        run: Sequence[Waypoint],
        results: Sequence[IkResult],
        q_start: Vector,
        dt: float,
    ) -> list[Leg]:
        """To the last of some waypoints, blending or passing those before it."""
        if len(run) > 1:
            return self._without_stops(arm, run, results, q_start, dt)
        if run[0].motion is Motion.PTP:
            return [self._ptp(arm, run[0], results[0], q_start, dt)]
        return [self._tool(arm, run[0], q_start, dt)]

    def _ptp(
        self, arm: Arm, waypoint: Waypoint, result: IkResult, q_start: Vector, dt: float
    ) -> Leg:
        profile = self.profile.slowed(self.pace * waypoint.pace)
        if self.continuous.free is not None and (result.q != q_start).any():
            return self._without_stops(arm, [waypoint], [result], q_start, dt)[0]
        trajectory = plan_ptp(q_start, result.q, profile, dt, self.law)
        around = self.surroundings
        if around is not None and around.at(q_start) is None:
            around.check(waypoint.name, trajectory)
        try:
            leg = self._leg(arm, waypoint, result, trajectory, q_start)
        except PlanError:
            if self.detour is None or self.collisions is None:
                raise
            detour = self.detour.plan(arm, self.collisions, (q_start, result.q), profile, dt)
            if detour is None:
                raise
            trajectory = detour
            leg = self._leg(arm, waypoint, result, trajectory, q_start)
        bound = paced_bound(arm, self.profile, trajectory, self.pace * waypoint.pace, None, True)
        return replace(leg, lower_bound=bound)

    def _tool(self, arm: Arm, waypoint: Waypoint, q_start: Vector, dt: float) -> Leg:
        pace = self.pace * waypoint.pace
        profile, target = self.profile.slowed(pace), tool_target(arm, waypoint)
        way = segment(waypoint, arm.pose(q_start), target)
        if isinstance(way, Arc):
            end = judged(arm, target, q_start, self.ik.tolerance, 0)
            leg = self._without_stops(arm, [waypoint], [end], q_start, dt)[0]
            return replace(leg, way=way)
        lin = replace(self.lin, law=self.law)
        try:
            trajectory, result = lin.plan(arm, self.ik, q_start, target, profile, dt, pace)
        except LinError as error:
            time = error.fraction * self.lin.profile.least_time(way.length, way.angle)
            raise refused(waypoint, error, time) from error
        leg = self._leg(arm, waypoint, result, trajectory, q_start)
        bound = paced_bound(arm, self.profile, trajectory, pace, self.lin.profile, True)
        return replace(leg, way=way, lower_bound=bound)

    def _without_stops(
        self,
        arm: Arm,
        run: Sequence[Waypoint],
        results: Sequence[IkResult],
        q_start: Vector,
        dt: float,
    ) -> list[Leg]:
        goals, paced = [result.q for result in results], PacedProfile(self.profile, self.pace)
        if len(run) > 1 and self.continuous.free is None and blends_joints(run):
            cut = cut_ptp(arm, run, [q_start, *goals], paced, self.law, dt)
            planned = Passage(*cut, [], Effort(0, 0.0))
        else:
            planned = self.continuous.plan(arm, self.ik, q_start, run, goals, paced, dt)
        whole, ends = planned.trajectory, [*planned.passes, planned.trajectory.steps]
        legs: list[Leg] = []
        for waypoint, first, last in zip(run, [0, *ends], ends, strict=False):
            part = whole.part(first, last)
            target = tool_target(arm, waypoint)
            there = judged(arm, target, part.end.q, self.ik.tolerance, 0)
            result = replace(
                there, iterations=planned.effort.iterations, seconds=planned.effort.seconds
            )
            legs.append(self._leg(arm, waypoint, result, part, part.q[0]))
        pace = self.pace * max(waypoint.pace for waypoint in run)
        tool = None if any(w.motion is Motion.PTP for w in run) else self.continuous.profile
        bound = paced_bound(arm, self.profile, whole, pace, tool, False)
        return [replace(legs[0], lower_bound=bound), *legs[1:]]

    def _leg(
        self,
        arm: Arm,
        waypoint: Waypoint,
        result: IkResult,
        trajectory: Trajectory,
        q_start: Vector,
    ) -> Leg:
        if self.collisions is not None:
            self.collisions.check(waypoint.name, trajectory)
        return Leg(
            waypoint=waypoint,
            ik=result,
            trajectory=trajectory,
            T_world_start=arm.pose(q_start),
            T_world_goal=tool_target(arm, waypoint),
        )
