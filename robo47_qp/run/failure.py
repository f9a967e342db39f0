"""Failure: why a run did not succeed, from a closed list, with evidence."""

from dataclasses import dataclass
from enum import Enum

from robo47_qp.errors import Robo47Error


class Cause(Enum):
    """Why a run failed. Every failed run has exactly one."""

    IK = "ik"
    """A waypoint is out of reach, or was not reached by inverse kinematics."""
    PLAN = "plan"
    """Every waypoint is reached, but no motion leads there within the limits."""
    TRACK = "track"
    """The arm was not where its reference was."""
    GRASP = "grasp"
    """The fingers closed and did not hold the object."""
    SLIP = "slip"
    """The object is between the fingers and moved there."""
    DROP = "drop"
    """The object was held and got lost."""
    PLACE = "place"
    """All was done, and the world at the end is not as it should be."""
    COLLISION = "collision"
    """Something was touched that must not be, or pressed harder than allowed."""
    TIMEOUT = "timeout"
    """What was waited for did not happen in time."""
    LIMIT = "limit"
    """A joint left its limits, or a command was none that can be carried out."""


@dataclass(frozen=True, kw_only=True)
class Failure:
    """How a run failed."""

    cause: Cause
    evidence: str
    """What was seen, with numbers."""
    step: str | None = None
    """The step that failed; None where the end was judged."""
    condition: str | None = None
    """The condition that did not hold, where it was one."""
    time: float | None = None
    """When it was seen [s]; None where that has not been written down yet."""


class StepFailed(Robo47Error):  # noqa: N818  # read as a sentence in `except StepFailed`
    """A step of a program that failed; raised in the program where the step was yielded."""

    def __init__(self, failure: Failure) -> None:
        """Tell what was seen."""
        super().__init__(f"{failure.step}: {failure.evidence}")
        self.failure = failure
