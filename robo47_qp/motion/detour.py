"""Detour: a joint motion around obstacles in the way of the straight one."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from itertools import count, pairwise
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from robo47_qp.arrays import (
    Checked,
    Count,
    CountOrZero,
    Matrix,
    NotNegative,
    Positive,
    Vector,
)
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.collision_check import Collisions
from robo47_qp.motion.refusals import PathError
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.timing.retiming import Timing, limits
from robo47_qp.motion.trajectory import Trajectory, joined

_ROUNDING = 1e-9
"""Tolerance of the ends of a spline [rad or m]."""


@dataclass(frozen=True, kw_only=True)
class Detour(Checked):
    """Finds joint paths with OMPL and runs them without a stop. Its fields are settings.

    RRT-Connect (Kuffner and LaValle, ICRA 2000) joins start and goal by a polyline, which is
    shortened by leaving out corners and by cutting them (Geraerts and Overmars, 2007). A natural
    cubic spline through its corners is timed; where it hits something, that stretch of the
    polyline gets a corner in its middle, which draws the spline closer to the free polyline. The
    timed motion is checked in the end. If no such spline is free, the motion stops at each
    corner of the polyline.

    Results are deterministic: all random numbers come from `seed`, and the search ends after a
    number of steps, not after a time.
    """

    roomy: Collisions
    """Collision check of the search, with some more clearance for what splines and the wider
    spacing of its checks may use up."""
    iterations: Count = 5000
    """Largest number of steps of a search."""
    step: Positive = 0.025
    """Distance in joint space between two collision checks [rad or m]."""
    stride: Positive = 0.6
    """Longest edge of the trees [rad or m]."""
    margin: NotNegative = 0.02
    """Distance to keep from the joint limits [rad or m]."""
    searches: Count = 3
    """Number of searches, of which the quickest result is taken. The first that finds no way is the
    last: where one has used up its steps, others seldom find more."""
    shortenings: CountOrZero = 200
    """Number of attempts to shorten a path."""
    refinements: CountOrZero = 12
    """Number of rounds that add corners before the motion stops at each instead."""
    seed: Count = 1
    """Seed of the first search, at least 1; each further search has the next one."""

    def plan(
        self,
        arm: Arm,
        collisions: Collisions,
        ends: tuple[Vector, Vector],
        profile: MotionProfile,
        dt: float,
    ) -> Trajectory | None:
        """Return a motion from rest to rest without collision; None where none is found.

        Args:
            arm: The arm, for its joint limits.
            collisions: Checks the timed motion.
            ends: Configurations at the start and at the goal (n,) [rad].
            profile: Bounds of the joints.
            dt: Time between samples [s].
        """
        best: Trajectory | None = None
        for seed in range(self.seed, self.seed + self.searches):
            corners = self.corners(arm, ends, seed)
            if corners is None:
                break
            motion = self._run(arm, corners, profile, dt)
            shorter = best is None or motion.steps < best.steps
            if shorter and collisions.first_hit(motion.q, dt) is None:
                best = motion
        return best

    def corners(self, arm: Arm, ends: tuple[Vector, Vector], seed: int) -> Matrix | None:
        """Return a collision-free polyline in joint space (N, n) [rad]; None if none is found."""
        # OMPL would wait for a goal that is free.
        if any(self.roomy.at(q) is not None for q in ends):
            return None
        ob, og, util = _ompl("base"), _ompl("geometric"), _ompl("util")
        space = ob.RealVectorStateSpace(arm.n)
        bounds = ob.RealVectorBounds(arm.n)
        for i, (low, high) in enumerate(zip(*self._limits(arm, ends), strict=True)):
            bounds.setLow(i, float(low))
            bounds.setHigh(i, float(high))
        space.setBounds(bounds)
        # Reseeding makes OMPL complain that what was drawn before came from another seed.
        util.setLogLevel(util.LogLevel.LOG_NONE)
        util.RNG.setSeed(seed)
        setup = og.SimpleSetup(space)
        about = setup.getSpaceInformation()
        n = arm.n
        setup.setStateValidityChecker(
            lambda state: self.roomy.at(np.array([state[i] for i in range(n)])) is None
        )
        about.setStateValidityCheckingResolution(self.step / space.getMaximumExtent())
        start, goal = (_state(space, q) for q in ends)
        setup.setStartAndGoalStates(start, goal)
        planner = og.RRTConnect(about)
        planner.setRange(self.stride)
        setup.setPlanner(planner)
        steps = count()
        setup.solve(ob.PlannerTerminationCondition(lambda: next(steps) > self.iterations))
        if not setup.haveExactSolutionPath():
            return None
        path = setup.getSolutionPath()
        simplifier = og.PathSimplifier(about)
        simplifier.reduceVertices(path, self.shortenings, self.shortenings)
        simplifier.partialShortcutPath(path, self.shortenings, self.shortenings)
        simplifier.reduceVertices(path, self.shortenings, self.shortenings)
        return np.array([[state[i] for i in range(n)] for state in path.getStates()])

    def _limits(self, arm: Arm, ends: Sequence[Vector]) -> tuple[Vector, Vector]:
        """Return the joint limits less the margin, widened to include the ends (n,), (n,) [rad]."""
        least, most = np.min(ends, axis=0), np.max(ends, axis=0)
        low = np.minimum(np.where(arm.free, least - np.pi, arm.q_min + self.margin), least)
        high = np.maximum(np.where(arm.free, most + np.pi, arm.q_max - self.margin), most)
        return np.maximum(low, arm.q_min), np.minimum(high, arm.q_max)

    def _run(self, arm: Arm, corners: Matrix, profile: MotionProfile, dt: float) -> Trajectory:
        """Return a motion through the corners; it stops at each where no spline is free."""
        polyline = corners
        for _ in range(self.refinements + 1):
            places = _places(corners, profile)
            spline = CubicSpline(places, corners, bc_type="natural")
            amiss = self._amiss(arm, spline, places)
            if not amiss:
                bounds = limits(profile, [None] * (len(corners) - 1), [1.0] * (len(corners) - 1))
                try:
                    return Timing().timed(arm, spline, places, bounds, dt)
                except PathError:
                    break
            for i in reversed(amiss):
                corners = np.insert(corners, i + 1, 0.5 * (corners[i] + corners[i + 1]), axis=0)
        return _with_stops(polyline, profile, dt)

    def _amiss(self, arm: Arm, spline: CubicSpline, places: Vector) -> list[int]:
        """Between which corners, each with its next, the spline hits something or leaves limits."""
        found = []
        q_min, q_max = self._limits(arm, (spline(0.0), spline(1.0)))
        for i, (low, high) in enumerate(pairwise(places)):
            looks = 2 + int(np.linalg.norm(spline(high) - spline(low)) / self.step)
            for q in spline(np.linspace(low, high, looks)):
                outside = (q < q_min - _ROUNDING) | (q > q_max + _ROUNDING)
                if outside.any() or self.roomy.at(q) is not None:
                    found.append(i)
                    break
        return found


def _places(corners: Matrix, profile: MotionProfile) -> Vector:
    """Where corners are on the way, from 0 to 1: by the time at full speed between them."""
    times = (np.abs(np.diff(corners, axis=0)) / profile.v_max).max(axis=1)
    places: Vector = np.concatenate([[0.0], np.cumsum(times)]) / times.sum()
    return places


def _with_stops(corners: Matrix, profile: MotionProfile, dt: float) -> Trajectory:
    return joined([plan_ptp(a, b, profile, dt) for a, b in pairwise(corners)])


def _state(space: Any, q: Vector) -> Any:
    state = space.allocState()
    for i, angle in enumerate(q.tolist()):
        state[i] = angle
    return state


@cache
def _ompl(part: str) -> Any:
    """Return a module of OMPL, which takes a while to load."""
    return _PARTS[part]()


_PARTS = {
    "base": lambda: import_module("ompl.base"),
    "geometric": lambda: import_module("ompl.geometric"),
    "util": lambda: import_module("ompl.util"),
}
