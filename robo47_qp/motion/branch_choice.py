"""Choice of configurations for a sequence of waypoints, such that its tool paths are feasible."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice, pairwise

import numpy as np

from robo47_qp.arrays import Checked, Count, CountOrZero, NotNegative, Vector
from robo47_qp.errors import PlanError
from robo47_qp.ik.composing import start_of
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import IkResult, IkSolver, judged
from robo47_qp.model.arm import Arm
from robo47_qp.motion.collision_check import Collisions
from robo47_qp.motion.following.lin import Lin
from robo47_qp.motion.refusals import PathError
from robo47_qp.motion.waypoint import Place, Waypoint, goal_pose

_TOLD = 3
"""Number of failed branches that a message describes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Branch:
    """Configurations for a PTP waypoint and for the tool paths that follow it."""

    results: tuple[IkResult, ...]
    """IK results of the waypoints, in their order."""
    room: float
    """Least distance to a joint limit at the waypoints, as a share of half the joint's range."""


def groups(waypoints: Sequence[Waypoint]) -> list[Sequence[Waypoint]]:
    """Return each PTP waypoint with the LIN and CIRC waypoints after it."""
    cuts = [i for i, waypoint in enumerate(waypoints) if i and not waypoint.prescribes_path]
    return [waypoints[a:b] for a, b in pairwise([0, *cuts, len(waypoints)])] if waypoints else []


def best_sequence(layers: list[list[Branch]], back: list[list[int]], last: int) -> list[IkResult]:
    """Return the IK results of the cheapest sequence, traced back from its last branch."""
    results: list[IkResult] = []
    for layer, before in zip(reversed(layers), reversed(back), strict=True):
        results[:0] = layer[last].results
        last = before[last]
    return results


def furthest_failure(group: Sequence[Waypoint], failed: Sequence[PlanError]) -> PlanError:
    """Return the error for the furthest waypoint at which a branch failed."""
    order = [waypoint.name for waypoint in group]
    furthest = max(failed, key=lambda error: order.index(error.waypoint))
    if len(failed) == 1:
        return furthest
    reasons = list(dict.fromkeys(f"{error.waypoint}: {error.explanation}" for error in failed))
    more = f"; and {len(reasons) - _TOLD} more" if len(reasons) > _TOLD else ""
    return PlanError(
        furthest.waypoint,
        f"none of {len(failed)} configurations of {order[0]!r} leads there: "
        + "; ".join(reasons[:_TOLD])
        + more,
        furthest.rejection,
    )


_ROOM = 0.02
"""Branches with at least this `Branch.room` are tried first: the final timing of a line, or of a
part of it, may pass a joint limit that is closer."""
_SAME = 1e-6
"""Largest difference of configurations that count as the same [rad or m]."""
_LOOKS = 33
"""Points of a tool path between which collision checks take the joint path as straight."""


@dataclass(frozen=True, kw_only=True)
class BranchChoice(Checked):
    """Chooses configurations for waypoints. Its fields are settings.

    Only a PTP waypoint leaves a choice: a tool path is followed in the branch in which it
    starts. So each PTP waypoint is solved for several different configurations, the paths after
    it are followed from each, and those that leave the joint limits, do not converge or change
    branch are dropped. Among what is left, the sequence of least cost is taken: the
    sum over PTP motions of max_i |Δq_i| / v_max_i [s] and over branches of
    `crowding` (1 - room) [s], by dynamic programming (Bellman, 1957).
    """

    candidates: Count = 8
    """Number of configurations to try per PTP waypoint."""
    restarts: CountOrZero = 100
    """Number of IK starts per PTP waypoint."""
    crowding: NotNegative = 0.5
    """Cost of a configuration at a joint limit [s]."""
    collisions: Collisions | None = None
    """Collision check; configurations for PTP waypoints that collide, or from which a tool path
    does, are left out. IK, which takes the fingers as closed, may accept them."""

    def choose(
        self,
        arm: Arm,
        ik: IkSolver,
        lin: Lin,
        waypoints: Sequence[Waypoint],
        q_start: Vector,
        v_max: Vector,
    ) -> list[IkResult]:
        """Return the IK result for each waypoint.

        Args:
            arm: The arm.
            ik: Solves for poses; a `MultiStart` finds several configurations, any other one.
            lin: Follows the tool paths.
            waypoints: The sequence.
            q_start: Configuration at its start (n,) [rad].
            v_max: Joint speeds that weigh distances between configurations (n,) [rad/s].

        Raises:
            PlanError: No sequence of configurations is feasible; the furthest waypoint that
                failed is named, with the reason for each branch.
        """
        grouped = groups(waypoints)
        layers = [self._branches(arm, ik, lin, group, q_start) for group in grouped]
        cost = np.zeros(1)
        ends = [q_start]
        back: list[list[int]] = []
        for group, layer in zip(grouped, layers, strict=True):
            reached = [branch.results[0].q for branch in layer]
            led = group[0].prescribes_path
            ways = np.array([[_way(arm, q, end, v_max, led) for end in ends] for q in reached])
            total = ways + cost
            back.append([int(row.argmin()) for row in total])
            crowded = np.array([self.crowding * (1.0 - branch.room) for branch in layer])
            lines = np.array([_lines(branch, v_max) for branch in layer])
            cost = total.min(axis=1) + crowded + lines
            ends = [branch.results[-1].q for branch in layer]
        chosen = best_sequence(layers, back, int(cost.argmin()))
        return _short_ways(arm, grouped, chosen, q_start) if arm.free.any() else chosen

    def candidates_for(
        self, arm: Arm, ik: IkSolver, lin: Lin, waypoint: Waypoint, q_start: Vector
    ) -> Iterator[IkResult]:
        """Yield configurations for a PTP waypoint from which its `onward` paths can be followed.

        The solution near home comes first, if it is one of them and has room to the joint limits,
        or if no path follows. Then, computed on demand, come others with room, then the rest in
        order of room. None is followed twice. Joints that move no tool of the target stay at
        q_start (n,) [rad].

        Raises:
            PlanError: There is none; the furthest waypoint that failed is named.
        """
        usual = self._usual(arm, ik, lin, waypoint, q_start)
        group, cramped = [waypoint, *waypoint.onward], list[Branch]()
        tried = [] if usual is None else [usual.results[0].q]
        if usual is not None and (usual.room >= _ROOM or not waypoint.onward):
            yield usual.results[0]
        elif usual is not None:
            cramped.append(usual)
        for more in (1, 2):
            wider = replace(self, candidates=more * self.candidates, restarts=more * self.restarts)
            starts = []
            for start in wider._starts(arm, ik, lin, waypoint, q_start):
                if all(np.abs(start.q - q).max() >= _SAME for q in tried):
                    starts.append(start)
                    tried.append(start.q)
            branches, failed = self._followable(arm, ik, lin, starts, waypoint.onward)
            if len(failed) == len(tried):
                raise furthest_failure(group, failed)
            for branch in branches:
                if branch.room >= _ROOM:
                    yield branch.results[0]
                else:
                    cramped.append(branch)
        for branch in sorted(cramped, key=lambda branch: -branch.room):
            yield branch.results[0]

    def _usual(
        self, arm: Arm, ik: IkSolver, lin: Lin, waypoint: Waypoint, q_start: Vector
    ) -> Branch | None:
        """Return the branch of the solution near home; None where the onward paths fail from there.

        Raises:
            PlanError: IK finds no configuration.
        """
        usual = replace(self, candidates=1).answers(arm, ik, waypoint, q_start)[0]
        if not self._clear([usual]):
            return None
        try:
            return self.followed(arm, ik, lin, usual, waypoint.onward)
        except PlanError:
            return None

    def _branches(
        self, arm: Arm, ik: IkSolver, lin: Lin, group: Sequence[Waypoint], q_start: Vector
    ) -> list[Branch]:
        starts = self._starts(arm, ik, lin, group[0], q_start)
        branches, failed = self._followable(arm, ik, lin, starts, group[1:])
        if not branches:
            raise furthest_failure(group, failed)
        return branches

    def _starts(
        self, arm: Arm, ik: IkSolver, lin: Lin, first: Waypoint, q_start: Vector
    ) -> list[IkResult]:
        """Return the configurations at the first waypoint from which branches may start."""
        if first.prescribes_path:
            # The sequence begins with a tool path: the branch is that of its start.
            return [self._line(arm, ik, lin, first, q_start)]
        found = self.answers(arm, ik, first, q_start)
        # Where all collide, the planner refuses the motion there.
        return self._clear(found) or found

    def _followable(
        self,
        arm: Arm,
        ik: IkSolver,
        lin: Lin,
        starts: Sequence[IkResult],
        lines: Sequence[Waypoint],
    ) -> tuple[list[Branch], list[PlanError]]:
        """Return the branches from which tool paths can be followed, and why others cannot."""
        branches, failed = [], []
        for start in starts:
            try:
                branches.append(self.followed(arm, ik, lin, start, lines))
            except PlanError as error:
                failed.append(error)
        return branches, failed

    def _clear(self, found: list[IkResult]) -> list[IkResult]:
        """Return the configurations without collision."""
        if self.collisions is None:
            return found
        return [result for result in found if self.collisions.at(result.q) is None]

    def answers(
        self, arm: Arm, ik: IkSolver, waypoint: Waypoint, q_start: Vector
    ) -> list[IkResult]:
        """Return different configurations for a PTP waypoint, the preferred one first.

        They are sought near home, so that they do not depend on where the arm comes from. Joints
        that move no tool of the target stay at q_start (n,) [rad].

        Raises:
            PlanError: There is none.
        """
        target, ik = goal_pose(arm, waypoint), waypoint.solver(ik)
        seed = start_of(ik, arm, np.where(arm.joints_of(target), arm.home, q_start), q_start)
        if isinstance(waypoint.target, Place):
            found: Sequence[IkResult] = [judged(arm, target, arm.home, ik.tolerance, 0)]
        elif isinstance(ik, MultiStart):
            several = replace(ik, answers=self.candidates, max_restarts=self.restarts)
            found = several.solve_all(arm, target, seed)
        else:
            found = [ik.solve(arm, target, seed)]
        if not found[0].converged:
            raise PlanError(waypoint.name, found[0].explanation)
        if not arm.free.any():
            return list(found)
        return [replace(one, q=arm.nearest(one.q, q_start)) for one in found]

    def followed(
        self, arm: Arm, ik: IkSolver, lin: Lin, start: IkResult, lines: Sequence[Waypoint]
    ) -> Branch:
        """Return the branch that starts at an IK result and follows tool paths.

        Raises:
            PlanError: A path cannot be followed; the waypoint is named.
        """
        results = [start]
        for waypoint in lines:
            results.append(self._line(arm, ik, lin, waypoint, results[-1].q))
        span = 0.5 * (arm.q_high - arm.q_low)
        q = np.array([result.q for result in results])
        room = float((np.minimum(q - arm.q_min, arm.q_max - q) / span).min())
        return Branch(results=tuple(results), room=min(room, 1.0))

    def _line(self, arm: Arm, ik: IkSolver, lin: Lin, waypoint: Waypoint, q: Vector) -> IkResult:
        goal, ik = goal_pose(arm, waypoint), waypoint.solver(ik)
        start = arm.pose_as(goal, q)
        asked = waypoint.path(start, ik.tolerance.demand.aimed(start, goal))
        time = lin.profile.least_time(asked.length, asked.angle)
        try:
            end, path = lin.follow(arm, ik, q, asked)
        except PathError as error:
            raise PlanError(waypoint.name, *error.refusal(error.fraction * time)) from error
        if self.collisions is not None:
            looks = path(np.linspace(0.0, 1.0, _LOOKS))
            hit = self.collisions.first_hit(looks, time / (_LOOKS - 1))
            if hit is not None:
                raise PlanError(waypoint.name, *hit)
        return end


def _way(arm: Arm, q: Vector, q_before: Vector, v_max: Vector, led: bool) -> float:
    return 0.0 if led else float((np.abs(arm.way(q_before, q)) / v_max).max())


def _lines(branch: Branch, v_max: Vector) -> float:
    """Return the way of the joints along the tool paths of a branch, as `_way` counts it."""
    q = np.array([result.q for result in branch.results])
    return float((np.abs(np.diff(q, axis=0)) / v_max).max(axis=1, initial=0.0).sum())


def _short_ways(
    arm: Arm, grouped: Sequence[Sequence[Waypoint]], chosen: Sequence[IkResult], q_start: Vector
) -> list[IkResult]:
    """Return a sequence with freely turning joints shifted by whole turns, the short way each."""
    results, q, left = list[IkResult](), q_start, iter(chosen)
    for group in grouped:
        mine = list(islice(left, len(group)))
        if not group[0].prescribes_path:
            turn = arm.nearest(mine[0].q, q) - mine[0].q
            mine = [replace(one, q=one.q + turn) for one in mine]
        results += mine
        q = results[-1].q
    return results
