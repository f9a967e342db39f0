"""Episode: one attempt at a task, its specification and its result as plain data."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from robo47_qp.files import plain
from robo47_qp.report.audit.finding import Finding
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.foreign_code import TaskError


@dataclass(frozen=True, kw_only=True)
class EpisodeSpec:
    """Which episode to run."""

    index: int
    """Place in the evaluation, from 0."""
    seed: int
    """Seed of the world and its perturbation."""
    recording: Path | None = None
    """Recording to write, if any."""


@dataclass(frozen=True, kw_only=True)
class EpisodeResult:
    """Outcome of an episode: a success, a failure with its cause, or an internal error."""

    index: int
    seed: int
    success: bool
    cause: str | None = None
    """Value of `Cause`; None for a success, and for an error."""
    evidence: str | None = None
    """Observation that shows the failure, with numbers."""
    step: str | None = None
    """The failed step, if any."""
    condition: str | None = None
    """The violated condition, if any."""
    time: float | None = None
    """Simulated time of the failure [s]; None if unknown."""
    measures: Mapping[str, Any] = field(default_factory=dict)
    """The task's own figures, by name with unit."""
    metrics: Mapping[str, Any] = field(default_factory=dict)
    """Metrics of the run, by name with unit, except those of wall time."""
    audit_ok: bool | None = None
    """Whether all limits of the audit were kept; None if there is no run to audit."""
    broken_promises: tuple[str, ...] = ()
    """Signals that violated a limit of the audit."""
    exempt: Sequence[Mapping[str, Any]] = ()
    """Findings of the audit that are told without being judged, as JSON; see `Finding.exempt`."""
    disturbance: Mapping[str, Any] = field(default_factory=dict)
    """How the simulated world differed from its model."""
    sha256: str | None = None
    """SHA-256 of the recorded rows."""
    error: str | None = None
    """Traceback of an internal error, which says nothing about the policy."""
    timing: Mapping[str, float] = field(default_factory=dict)
    """Figures of wall time, the only ones that may differ from run to run."""

    @property
    def failure(self) -> str | None:
        """The cause of failure, or "error"; None for a success."""
        return "error" if self.error is not None else self.cause

    @property
    def explanation(self) -> str:
        """The evidence of the failure, or the last line of the error."""
        if self.error is None:
            return self.evidence or ""
        task_error = f"{TaskError.__module__}.{TaskError.__name__}: "
        return self.error.splitlines()[-1].removeprefix(task_error)

    @property
    def timed_out(self) -> bool:
        """True if the limit of wall time ended the episode, which depends on the machine."""
        return self.cause == Cause.TIMEOUT.value and self.time is None

    def is_same(self, other: "EpisodeResult") -> bool:
        """Return whether two results are equal except for wall time."""
        return replace(self, timing={}) == replace(other, timing={})

    def entry(self) -> dict[str, Any]:
        """Return the result as JSON."""
        lists = {name: list(getattr(self, name)) for name in ("broken_promises", "exempt")}
        return {**asdict(self), **lists}

    @classmethod
    def of_entry(cls, entry: Mapping[str, Any]) -> "EpisodeResult":
        """Return the result that was written as JSON.

        Raises:
            TypeError, KeyError: It is not the entry of an episode.
        """
        # Reports of before do not have it.
        entry = {"exempt": [], **entry}
        for name, kinds in _KINDS.items():
            value = entry[name]
            # A bool is an int, too.
            if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
                raise TypeError(f"{name} of an episode is {value!r:.60}")
        exempt = tuple(map(_exempt, entry["exempt"]))
        broken = tuple(map(str, entry["broken_promises"]))
        return cls(**{**entry, "broken_promises": broken, "exempt": exempt})


def exempt_findings(findings: Iterable[Finding]) -> tuple[Mapping[str, Any], ...]:
    """Return those that are told without being judged, for `EpisodeResult.exempt`."""
    return tuple(_exempt(asdict(finding)) for finding in findings if finding.exempt)


def _exempt(finding: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a finding as it was written; numbers that are none are text in JSON."""
    words = {name: str(finding[name]) for name in ("signal", "unit", "exempt")}
    numbers = {name: plain(float(finding[name])) for name in ("extreme", "limit", "time", "share")}
    return {**words, **numbers, "least": bool(finding["least"])}


_TEXT = (str, type(None))
_KINDS: Mapping[str, tuple[type, ...]] = {
    "index": (int,),
    "seed": (int,),
    "success": (bool,),
    **dict.fromkeys(("cause", "evidence", "step", "condition", "sha256", "error"), _TEXT),
    "time": (int, float, type(None)),
    **dict.fromkeys(("measures", "metrics", "disturbance", "timing"), (dict,)),
    "audit_ok": (bool, type(None)),
    **dict.fromkeys(("broken_promises", "exempt"), (list,)),
}
"""What JSON has of each field of a result."""


class Episode(Protocol):
    """Runs episodes of one task under one policy; sent to worker processes by pickle.

    The outcome depends on the spec alone, not on earlier episodes. Errors of the policy are
    failures in the result; any exception is an internal error.
    """

    @property
    def foreign(self) -> bool:
        """True if the policy is from outside the package: if its process dies, it has failed."""
        ...

    def __call__(self, spec: EpisodeSpec) -> EpisodeResult:
        """Run one episode."""
        ...


def failed(spec: EpisodeSpec, failure: Failure, **more: Any) -> EpisodeResult:
    """Return the result of an episode that failed."""
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
    """Return the result of an episode that an internal error ended."""
    return EpisodeResult(index=spec.index, seed=spec.seed, success=False, error=words)


def overdue(spec: EpisodeSpec, seconds: float) -> EpisodeResult:
    """Return the result of an episode whose process was killed after its time limit."""
    evidence = f"the episode took more than {seconds:g} s of wall time; its process was stopped"
    return failed(spec, Failure(cause=Cause.TIMEOUT, evidence=evidence))


def died(spec: EpisodeSpec, how: str, *, foreign: bool) -> EpisodeResult:
    """Return the result of an episode whose worker process died."""
    evidence = f"the process of the episode died: {how}"
    if not foreign:
        return errored(spec, evidence)
    return failed(spec, Failure(cause=Cause.LIMIT, evidence=evidence))
