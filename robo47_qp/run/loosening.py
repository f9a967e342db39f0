"""Loosening: joints go a little both ways at the start of a run, which shows their dry friction."""

import numpy as np

from robo47_qp.constants import TIMESTEP
from robo47_qp.motion.planner import Planner
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.trajectory import Trajectory, joined
from robo47_qp.run.control_loop import ControlLoop

AT_HOME = 5e-3
"""Distance from home within which an arm stands there [rad]."""


class Loosening:
    """Moves all joints towards the middle of their ranges and back, once, from rest at home.

    A `DisturbanceObserver` tells dry friction from what else the belief does not know by the first
    reversal of a joint. Where that is the beginning of a line, the tool leaves the line. So the
    reversal is made before, while the arm has nothing to do. `FrictionLearning.swing` is how far
    the joints go.
    """

    def __init__(self, loop: ControlLoop, planner: Planner) -> None:
        """Prepare it; nothing moves.

        Args:
            loop: What moves the arm.
            planner: Its profile and its collision checks hold here, too.
        """
        self._loop, self._planner = loop, planner
        self._left, self._begun = loop.at_rest(0), False
        observed = loop.control.observed
        learned = None if observed is None else observed.settings.friction
        self._swing = 0.0 if learned is None else learned.swing

    def spend(self, seconds: float, lasts: float) -> None:
        """Let time pass, in which the arm loosens its joints if it has to and can, or stands still.

        Args:
            seconds: The time [s].
            lasts: How long nothing else is to be done, at least [s]; it does not begin in less than
                it takes.

        Raises:
            Aborted: See `ControlLoop.track`.
        """
        loop = self._loop
        if not np.array_equal(loop.reference.q, self._left.q[0]):
            # Something else was done in between.
            loop.halt()
            self._left = loop.at_rest(0)
        if not self._begun and self._is_of_use():
            self._begin(lasts)
        rows = round(seconds / TIMESTEP)
        now = min(rows, self._left.steps)
        loop.track(self._left.part(0, now))
        self._left = self._left.part(now, self._left.steps)
        loop.hold((rows - now) * TIMESTEP)

    def _is_of_use(self) -> bool:
        loop = self._loop
        off_home = float(np.abs(loop.reference.q - loop.arm.home).max())
        return self._swing > 0.0 and loop.resting and off_home <= AT_HOME

    def _begin(self, lasts: float) -> None:
        """Plan the way there and back, if there is time; where it is not free, there is none."""
        arm, q, planner = self._loop.arm, self._loop.reference.q, self._planner
        inwards = np.where(0.5 * (arm.q_low + arm.q_high) < q, -1.0, 1.0)
        there = q + self._swing * inwards
        profile = planner.profile.slowed(planner.pace)
        way = plan_ptp(q, there, profile, TIMESTEP, planner.law)
        back = plan_ptp(there, q, profile, TIMESTEP, planner.law)
        if way.duration + back.duration > lasts:
            return
        self._begun = True
        if self._is_free(way):
            self._left = joined([way, back])

    def _is_free(self, way: Trajectory) -> bool:
        checks = (self._planner.collisions, self._planner.surroundings)
        return all(check is None or check.first_hit(way.q, way.dt) is None for check in checks)
