"""Failure: why a run did not succeed, from a closed list, and the conditions that tell."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from robo47_qp.arrays import Checked
from robo47_qp.errors import PlanError, RefusalReason, Robo47Error


class Cause(Enum):
    """Why a run failed. Every failed run has exactly one."""

    IK = "ik"
    """A waypoint is out of reach, or was not reached by inverse kinematics."""
    PLAN = "plan"
    """Every waypoint is reached, but no motion leads there within the limits."""
    TRACK = "track"
    """The arm was not where its reference was."""
    GRASP = "grasp"
    """The fingers closed without holding the object."""
    SLIP = "slip"
    """The object moved between the fingers."""
    DROP = "drop"
    """The object was held and then lost."""
    PLACE = "place"
    """Every step was done, but the world at the end is not as the task wants it."""
    COLLISION = "collision"
    """Something was touched that must not be, or a contact force was above its limit."""
    TIMEOUT = "timeout"
    """What a step waited for did not happen in time."""
    LIMIT = "limit"
    """A joint left its limits, or a command cannot be carried out."""
    ARM = "arm"
    """A real arm has stopped by itself, refused something, or was not heard any more."""


@dataclass(frozen=True, kw_only=True)
class Failure:
    """How a run failed."""

    cause: Cause
    evidence: str
    """What was seen, with numbers."""
    step: str | None = None
    """The step that failed; None where the failure was found at the end of the run."""
    condition: str | None = None
    """The condition that was violated, if it was one."""
    time: float | None = None
    """When it was seen [s]; None until it is filled in."""


class StepFailed(Robo47Error):  # noqa: N818  # read as a sentence in `except StepFailed`
    """A step of a program failed; raised in the program where the step was yielded."""

    def __init__(self, failure: Failure) -> None:
        """Say which step failed and what was seen."""
        super().__init__(f"{failure.step}: {failure.evidence}")
        self.failure = failure


@dataclass(frozen=True, kw_only=True)
class Condition(Checked):
    """A statement about the world that has to hold before, during or after a step."""

    name: str
    """The statement: "the cube is held"."""
    cause: Cause
    """Why the run failed, if it does not hold."""
    against: Callable[[], str | None]
    """Returns the evidence against it now, with numbers; None while it holds."""


def require(step: str, conditions: Sequence[Condition]) -> None:
    """Check that conditions hold.

    Raises:
        StepFailed: One does not.
    """
    for condition in conditions:
        evidence = condition.against()
        if evidence is not None:
            raise StepFailed(violation(step, condition, evidence))


def violation(step: str, condition: Condition, evidence: str) -> Failure:
    """Return the failure of a step whose condition does not hold."""
    return Failure(cause=condition.cause, evidence=evidence, step=step, condition=condition.name)


def refusal(error: PlanError) -> Failure:
    """Return the failure of a step that could not be planned."""
    unreached = error.rejection is None or error.rejection.reason is RefusalReason.REACH
    return Failure(
        cause=Cause.IK if unreached else Cause.PLAN, evidence=str(error), step=error.waypoint
    )


class StepMonitor:
    """Checks, while a step runs, whether it has to end: called every few control periods."""

    def __init__(
        self,
        step: str,
        during: Sequence[Condition],
        until: Condition | None = None,
        observe: Callable[[], None] | None = None,
        *,
        needed: bool = True,
    ) -> None:
        """Set up what is checked at every call.

        Args:
            step: Name of the step.
            during: Conditions that have to hold all the time.
            until: Condition that ends the step.
            observe: Called first, to take notes of the world.
            needed: Whether `until` has to be reached.
        """
        self._step, self._during, self._until, self._observe = step, during, until, observe
        self._reached, self._needed = False, needed
        self.error: StepFailed | None = None
        """The violation that was seen; None while there is none."""

    def __call__(self) -> bool:
        """Return True where the step has to end now."""
        if self._observe is not None:
            self._observe()
        self._reached = self._until is not None and self._until.against() is None
        try:
            require(self._step, self._during)
        except StepFailed as error:
            self.error = error
            return True
        return self._reached

    def judge(self) -> None:
        """Check at the end of the step that nothing was violated, and `until` reached if needed.

        Raises:
            StepFailed: It was not so.
        """
        if self.error is not None:
            raise self.error
        if self._until is not None and self._needed and not self._reached:
            require(self._step, (self._until,))
