"""Loosening: joints go a little both ways at the start of a run, which shows their dry friction."""

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import PlanError
from robo47_qp.motion.planner import Planner
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.trajectory import Trajectory, joined
from robo47_qp.run.control_loop import ControlLoop

_NOTHING = 1e-2
"""Distance from home up to which an arm has not begun its work [rad]."""


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
        if not self._begun:
            whole = self._whole()
            if whole is not None and whole.duration <= lasts:
                self._left, self._begun = whole, True
        rows = round(seconds / TIMESTEP)
        now = min(rows, self._left.steps)
        loop.track(self._left.part(0, now))
        self._left = self._left.part(now, self._left.steps)
        loop.hold((rows - now) * TIMESTEP)

    def _whole(self) -> Trajectory | None:
        """Return the way there and back; None where it is of no use or not free."""
        loop, observed = self._loop, self._loop.control.observed
        learned = None if observed is None else observed.settings.friction
        q, arm = loop.reference.q, loop.arm
        off_home = float(np.abs(q - arm.home).max())
        if learned is None or not learned.swing or not loop.resting or off_home > _NOTHING:
            return None
        inwards = np.sign(0.5 * (arm.q_low + arm.q_high) - q)
        return self._free(q, q + learned.swing * np.where(inwards < 0.0, -1.0, 1.0))

    def _free(self, q: Vector, there: Vector) -> Trajectory | None:
        planner = self._planner
        profile = planner.profile.slowed(planner.pace)
        way = plan_ptp(q, there, profile, TIMESTEP, planner.law)
        try:
            planner.check_collisions("loosening", way)
            if planner.surroundings is not None:
                planner.surroundings.check("loosening", way)
        except PlanError:
            return None
        return joined([way, plan_ptp(there, q, profile, TIMESTEP, planner.law)])
