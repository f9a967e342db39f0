"""What makes a step fail: a condition that does not hold, a motion that cannot be planned."""

from collections.abc import Sequence

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import PlanError, RefusalReason
from robo47_qp.model.arm import Arm
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.motion.waypoint import Waypoint
from robo47_qp.run.control_loop import ControlLoop
from robo47_qp.run.failure import Cause, Failure, StepFailed
from robo47_qp.run.steps import Condition


def demand(step: str, conditions: Sequence[Condition]) -> None:
    """Go on only where conditions hold.

    Raises:
        StepFailed: One does not.
    """
    for condition in conditions:
        against = condition.against()
        if against is not None:
            raise StepFailed(
                Failure(
                    cause=condition.cause, evidence=against, step=step, condition=condition.name
                )
            )


class Broken:
    """Whether one of the conditions that have to hold all along is broken, as it was seen first."""

    def __init__(self, step: str, conditions: Sequence[Condition]) -> None:
        """Look at the conditions of a step whenever called."""
        self._step, self._conditions = step, conditions
        self.error: StepFailed | None = None
        """What was seen; None while all is well."""

    def __call__(self) -> bool:
        """Look; True where one is broken."""
        try:
            demand(self._step, self._conditions)
        except StepFailed as error:
            self.error = error
            return True
        return False


def plan_through(
    planner: Planner, arm: Arm, waypoints: Sequence[Waypoint], q_start: Vector
) -> list[Leg]:
    """Motions from rest through waypoints that are known together.

    Raises:
        PlanError: There are none.
    """
    if len(waypoints) == 1:
        return [planner.plan(arm, waypoints[0], q_start, TIMESTEP)]
    return planner.plan_chain(arm, waypoints, q_start, TIMESTEP)


def planned(
    loop: ControlLoop, waypoints: Sequence[Waypoint], planner: Planner | None = None
) -> list[Leg]:
    """Motions from where the reference rests.

    Raises:
        StepFailed: There are none.
    """
    planner = loop.scenario.planner if planner is None else planner
    try:
        q = loop.reference.q
        return plan_through(planner, loop.planning_arm(q), waypoints, q)
    except PlanError as error:
        rejection = error.rejection
        unreached = rejection is None or rejection.reason is RefusalReason.REACH
        cause = Cause.IK if unreached else Cause.PLAN
        failure = Failure(cause=cause, evidence=str(error), step=error.waypoint)
        raise StepFailed(failure) from error
