"""Steps that look for contact or live with it."""

from dataclasses import replace

import numpy as np

from robo47_qp.controllers.cartesian_impedance import CartesianImpedance
from robo47_qp.failure import Failure, StepFailed
from robo47_qp.loop import TICK_ROWS, ControlLoop
from robo47_qp.motion.trajectory import hold
from robo47_qp.scene import TIMESTEP
from robo47_qp.step_failures import demand, planned
from robo47_qp.steps import Comply, Guarded

_GUARD_ROWS = 2
"""Control periods between two looks at the force of a guarded motion."""
_SETTLED = 2e-3
"""Joint speed below which the arm counts as at rest [rad/s]."""
_SETTLE_TIMEOUT = 1.0
"""How long to wait for that [s]."""


class Touching:
    """Carries out guarded and compliant motions."""

    def __init__(self, loop: ControlLoop) -> None:
        """Keep the loop to act with."""
        self._loop = loop

    def guarded(self, step: Guarded) -> None:
        """Go until something is touched.

        Raises:
            StepFailed: The line cannot be planned, or nothing was touched.
        """
        loop, planner = self._loop, self._loop.scenario.planner
        bounds = planner.lin.profile
        v, a, j = bounds.linear
        slow = replace(bounds, linear=(min(step.speed, v), a, j))
        planner = replace(planner, lin=replace(planner.lin, profile=slow))
        (leg,) = planned(loop, [step.waypoint], planner)
        loop.believe(step.waypoint.carried)
        before = loop.sim.felt_force()

        def touched() -> bool:
            change = loop.sim.felt_force() - before
            return float(np.sqrt(change.dot(change))) >= step.force

        loop.begin(step.name, leg)
        if loop.track(leg.trajectory, touched, block=_GUARD_ROWS):
            loop.halt()
        elif step.missing is not None:
            evidence = f"nothing was touched on the way; {step.force:.1f} N were waited for"
            raise StepFailed(Failure(cause=step.missing, evidence=evidence, step=step.name))

    def comply(self, step: Comply) -> None:
        """Lead the tool on springs; at the end the reference is where the arm has come to.

        Raises:
            StepFailed: The way cannot be planned, or what was to come about did not.
        """
        loop = self._loop
        legs = planned(loop, step.waypoints) if step.waypoints else []
        stiff = loop.control.controller
        loop.control.switch(CartesianImpedance(stiffness=step.compliance.stiffness))
        ended = False
        for leg in legs:
            loop.begin(leg.waypoint.name, leg, compliant=True)
            ended = loop.track(leg.trajectory, lambda: _is_so(step), block=_GUARD_ROWS)
            if ended:
                loop.halt()
                break
        if not ended and step.seconds:
            loop.begin(step.name, compliant=True)
            still = hold(loop.reference.q, round(step.seconds / TIMESTEP), TIMESTEP)
            loop.track(still, lambda: _is_so(step), block=_GUARD_ROWS)
        self._settle(step)
        loop.control.switch(stiff)
        if step.until is not None:
            demand(step.name, (step.until,))

    def _settle(self, step: Comply) -> None:
        """Let the arm come to rest on its springs, and take where it is as the reference."""
        loop, waited = self._loop, 0.0
        while waited < _SETTLE_TIMEOUT:
            loop.begin(f"{step.name}: settle", compliant=True, afresh=False)
            loop.hold(TICK_ROWS * TIMESTEP)
            waited += TICK_ROWS * TIMESTEP
            state = loop.sim.state()
            if np.abs(state.v).max() < _SETTLED:
                break
        arm = loop.arm
        loop.rest(np.clip(loop.sim.state().q, arm.q_min, arm.q_max))


def _is_so(step: Comply) -> bool:
    return step.until is not None and step.until.against() is None
