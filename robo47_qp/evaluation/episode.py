"""Episode: one attempt at a task, what is asked for and what came of it, as plain data."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

from robo47_qp.run.failure import Cause, Failure


@dataclass(frozen=True, kw_only=True)
class EpisodeSpec:
    """Which episode to run."""

    index: int
    """Place in the evaluation, from 0."""
    seed: int
    """What world and perturbation are drawn from."""
    recording: Path | None = None
    """Recording to write; None writes none."""


@dataclass(frozen=True, kw_only=True)
class EpisodeResult:
    """What came of an episode: a success, a failure with its cause, or an error of our own."""

    index: int
    seed: int
    success: bool
    cause: str | None = None
    """Value of `Cause`; None for a success, and for an error."""
    evidence: str | None = None
    """What was seen, with numbers."""
    step: str | None = None
    """The step that failed, where it was one."""
    condition: str | None = None
    """The condition that did not hold, where it was one."""
    time: float | None = None
    """When the failure was seen, in simulated time [s]; None where nothing tells."""
    measures: Mapping[str, Any] = field(default_factory=dict)
    """Figures of the task's own, by name with unit."""
    metrics: Mapping[str, Any] = field(default_factory=dict)
    """Figures of the run, by name with unit; none of wall time."""
    audit_ok: bool | None = None
    """Whether all promises were kept; None where no run was left to look at."""
    broken_promises: tuple[str, ...] = ()
    """Findings of the audit that are not ok."""
    disturbance: Mapping[str, Any] = field(default_factory=dict)
    """What was wrong in this world."""
    sha256: str | None = None
    """Of the recorded rows, bit by bit."""
    error: str | None = None
    """An error of our own that ended the episode, with its traceback: nothing is known of the
    policy then."""
    timing: Mapping[str, float] = field(default_factory=dict)
    """Figures of wall time: all that may differ from run to run."""

    @property
    def failure(self) -> str | None:
        """Why it is no success: the cause, or "error"."""
        return "error" if self.error is not None else self.cause

    @property
    def timed_out(self) -> bool:
        """True where wall time ended it: how far it came depends on the machine."""
        return self.cause == Cause.TIMEOUT.value and self.time is None

    def entry(self) -> dict[str, Any]:
        """The result as JSON."""
        return {**asdict(self), "broken_promises": list(self.broken_promises)}

    @classmethod
    def of_entry(cls, entry: Mapping[str, Any]) -> "EpisodeResult":
        """The result that an entry stands for.

        Raises:
            TypeError, KeyError: It is no entry.
        """
        return cls(**{**entry, "broken_promises": tuple(entry["broken_promises"])})


class Episode(Protocol):
    """Runs episodes of one task under one policy; goes to worker processes by pickle.

    What it does depends on the spec alone, and not on the episodes before. What the policy does
    wrong is a failure in its result; what it raises is an error of our own.
    """

    @property
    def foreign(self) -> bool:
        """True where code that is not ours decides: if its process dies, that is its failure."""
        ...

    def __call__(self, spec: EpisodeSpec) -> EpisodeResult:
        """Run one episode."""
        ...


def failed(spec: EpisodeSpec, failure: Failure, **more: Any) -> EpisodeResult:
    """The result of an episode that failed."""
    return EpisodeResult(
        index=spec.index,
        seed=spec.seed,
        success=False,
        cause=failure.cause.value,
        evidence=failure.evidence,
        step=failure.step,
        condition=failure.condition,
        time=failure.time,
        **more,
    )


def errored(spec: EpisodeSpec, words: str) -> EpisodeResult:
    """The result of an episode that an error of our own ended."""
    return EpisodeResult(index=spec.index, seed=spec.seed, success=False, error=words)


def overdue(spec: EpisodeSpec, seconds: float) -> EpisodeResult:
    """The result of an episode whose worker process had to be stopped."""
    evidence = f"the episode took more than {seconds:g} s of wall time; its process was stopped"
    return failed(spec, Failure(cause=Cause.TIMEOUT, evidence=evidence))


def died(spec: EpisodeSpec, how: str, *, foreign: bool) -> EpisodeResult:
    """The result of an episode whose worker process died."""
    evidence = f"the process of the episode died: {how}"
    if not foreign:
        return errored(spec, evidence)
    return failed(spec, Failure(cause=Cause.LIMIT, evidence=evidence))
