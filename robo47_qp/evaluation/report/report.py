"""EvaluationReport: results of an evaluation, and comparisons of policies on the same seeds."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.episode import EpisodeResult
from robo47_qp.evaluation.report.not_judged import NotJudged
from robo47_qp.evaluation.report.paired import CycleTimes, PairedComparison, UnequalEpisode
from robo47_qp.evaluation.statistics import CONFIDENCE, holm, mcnemar, paired_difference, wilson
from robo47_qp.files import plain
from robo47_qp.report.metrics import FAILED_STEPS
from robo47_qp.report.run_report import versions
from robo47_qp.stack import ClassicalStack

CYCLE = "cycle_time_s"
"""The metric of comparisons."""
PAIRED = ("task", "robot", "perturbation", "time_limit")
"""Settings that paired evaluations share."""
_TOLD = ("code", "versions", "robot_sha256", "timeout")
"""Settings that may differ where versions are compared, but are told. The digest of a robot changes
with MuJoCo and the code; where these are the same, it is another robot."""
_NAMING = ("name", "ik", "process")
"""Settings of a policy that its name tells, or that follow from it."""
_SHARED = (*PAIRED, "robot_sha256", "code")


@dataclass(frozen=True, kw_only=True)
class FigureSummary:
    """Distribution of one figure over the successful episodes."""

    n: int
    median: float
    p95: float
    max: float


@dataclass(frozen=True, kw_only=True)
class Throughput:
    """Speed of an evaluation."""

    episodes: int
    """Episodes that were run now; those read from a journal do not count."""
    workers: int
    wall_s: float
    """Wall time, including the start of the workers [s]."""
    episodes_per_minute: float
    episodes_per_minute_per_worker: float
    busy: float
    """Share of the workers' time that was spent on episodes [-]."""

    @classmethod
    def of(
        cls, results: Sequence[EpisodeResult], seconds: float, workers: int
    ) -> "Throughput | None":
        """Return the throughput of episodes that took `seconds` together; None without any."""
        if not results or seconds <= 0.0:
            return None
        rate = 60.0 * len(results) / seconds
        busy = sum(result.timing.get("wall_s", 0.0) for result in results)
        return cls(
            episodes=len(results),
            workers=workers,
            wall_s=seconds,
            episodes_per_minute=rate,
            episodes_per_minute_per_worker=rate / workers,
            busy=busy / (seconds * workers),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class EvaluationReport:
    """Outcome of all episodes of one policy. Nothing but `timing` differs from run to run.

    An episode that ended with an internal error says nothing about the policy: it has no cause,
    and does not count in the rate.
    """

    settings: Mapping[str, Any]
    """All that the results depend on, as JSON."""
    results: Sequence[EpisodeResult]
    """In the order of the seeds."""
    timing: Throughput | None = None
    """None where every episode was read from a journal."""
    comparison: PairedComparison | None = None
    """With another evaluation, if one was asked for."""
    replayed: Mapping[int, bool | None] = field(default_factory=dict)
    """By seed of the recorded failures: whether the recorded run was identical bit by bit; None
    where one of the two ran out of wall time."""
    versions: Mapping[str, str] = field(default_factory=versions)
    """Of the packages that a result depends on."""

    @property
    def task(self) -> str:
        """Name of the task."""
        return str(self.settings["task"]["name"])

    @property
    def policy(self) -> str:
        """Name of the policy; "classical" names its IK where that is not the default."""
        name, ik = self.settings["policy"]["name"], self.settings["policy"].get("ik", "qp")
        return f"{name}:{ik}" if name == "classical" and ik != ClassicalStack.ik else str(name)

    @property
    def episodes(self) -> int:
        """Number of episodes."""
        return len(self.results)

    @property
    def judged(self) -> int:
        """Number of episodes without an internal error."""
        return self.episodes - len(self.errors)

    @property
    def first_attempts(self) -> int | None:
        """Number of successes in which no step failed; None where that was not measured."""
        failed = [result.metrics.get(FAILED_STEPS) for result in self.results if result.success]
        return None if not failed or None in failed else sum(count == 0 for count in failed)

    @property
    def successes(self) -> int:
        """Number of successful episodes."""
        return sum(result.success for result in self.results)

    @property
    def rate(self) -> float:
        """Success rate of the episodes that were judged; 0 without any."""
        return self.successes / max(self.judged, 1)

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's interval of the success rate, 95 %; all of it where nothing was judged."""
        return wilson(self.successes, self.judged) if self.judged else (0.0, 1.0)

    @property
    def causes(self) -> dict[str, int]:
        """Number of failures by cause, the most frequent one first."""
        counts = Counter(result.cause for result in self.results if result.cause is not None)
        return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))

    @property
    def errors(self) -> list[EpisodeResult]:
        """Episodes that ended with an internal error."""
        return [result for result in self.results if result.error is not None]

    @property
    def broken_audits(self) -> int:
        """Number of episodes that violated a limit of the audit."""
        return sum(result.audit_ok is False for result in self.results)

    @property
    def audits_kept(self) -> int:
        """Number of episodes that were audited and kept to all limits."""
        return sum(result.audit_ok is True for result in self.results)

    @property
    def sound(self) -> bool:
        """True if there were no internal errors and every replay was identical."""
        return not self.errors and False not in self.replayed.values()

    @cached_property
    def figures(self) -> dict[str, FigureSummary]:
        """Measures and metrics over the successful episodes, by name with unit."""
        columns: dict[str, list[float]] = {}
        for result in self.results:
            if result.success:
                for name, value in (*result.measures.items(), *result.metrics.items()):
                    if isinstance(value, int | float):
                        columns.setdefault(name, []).append(float(value))
        return {
            name: FigureSummary(
                n=len(values),
                median=float(np.median(values)),
                p95=float(np.percentile(values, 95.0)),
                max=max(values),
            )
            for name, values in columns.items()
        }

    @cached_property
    def not_judged(self) -> list[NotJudged]:
        """What the audit did not judge, that of the largest share of the time first."""
        return NotJudged.of(self.results)

    def as_json(self) -> dict[str, Any]:
        """Return the report as JSON, all figures and episodes included."""
        compared = {} if self.comparison is None else {"comparison": self.comparison.as_json()}
        return {
            **self.headline(),
            "figures": {name: asdict(figure) for name, figure in self.figures.items()},
            "not_judged": [
                {name: plain(value) for name, value in asdict(one).items()}
                for one in self.not_judged
            ],
            "settings": dict(self.settings),
            "versions": dict(self.versions),
            "entries": [result.entry() for result in self.results],
            "timing": {} if self.timing is None else asdict(self.timing),
            **compared,
            "replayed": dict(self.replayed),
        }

    def headline(self) -> dict[str, Any]:
        """Return name and counts as JSON."""
        return {
            "task": self.task,
            "policy": self.policy,
            "episodes": self.episodes,
            "judged": self.judged,
            "successes": self.successes,
            "first_attempts": self.first_attempts,
            "rate": self.rate,
            "interval": list(self.interval),
            "confidence": CONFIDENCE,
            "causes": self.causes,
            "errors": len(self.errors),
            "broken_audits": self.broken_audits,
            "audits_kept": self.audits_kept,
        }

    @classmethod
    def of_json(cls, content: Mapping[str, Any]) -> "EvaluationReport":
        """Return the report that was written as JSON, with its figures computed again.

        Raises:
            KeyError, TypeError: It is not a report.
        """
        results = [EpisodeResult.of_entry(entry) for entry in content["entries"]]
        settings = content["settings"]
        if not (results and isinstance(settings, dict)):
            raise TypeError("settings and episodes")
        for name in ("task", "policy"):
            if not isinstance(settings[name]["name"], str):
                raise TypeError(f"the name of the {name}")
        seeds = Counter(result.seed for result in results)
        twice = [seed for seed, count in seeds.items() if count > 1]
        if twice:
            raise TypeError(f"one episode of each seed: {twice[0]} is there twice")
        return cls(settings=settings, results=results)


@dataclass(frozen=True, kw_only=True, eq=False)
class PolicyComparison:
    """Several policies on the same seeds: each one by itself, and against the first."""

    reports: Mapping[str, EvaluationReport]
    """By the names of their files; the first is the baseline."""
    comparisons: Sequence[PairedComparison]
    """Of each other policy with the baseline."""

    @property
    def baseline(self) -> EvaluationReport:
        """The first report."""
        return next(iter(self.reports.values()))

    def as_json(self) -> dict[str, Any]:
        """Return the comparison as JSON."""
        first = self.baseline
        return {
            "task": first.task,
            "baseline": first.policy,
            "episodes": first.episodes,
            "confidence": CONFIDENCE,
            "policies": [
                {"report": name, **report.headline(), f"median_{CYCLE}": median_cycle_time(report)}
                for name, report in self.reports.items()
            ],
            "comparisons": [comparison.as_json() for comparison in self.comparisons],
            "settings": self.settings,
            "versions": dict(first.versions),
        }

    @property
    def settings(self) -> dict[str, Any]:
        """What all policies have in common."""
        return {name: self.baseline.settings.get(name) for name in _SHARED}


def median_cycle_time(report: EvaluationReport) -> float | None:
    """Return the median cycle time of the successful episodes [s]; None without any."""
    return report.figures[CYCLE].median if CYCLE in report.figures else None


def compare_policies(reports: Mapping[str, EvaluationReport]) -> PolicyComparison:
    """Compare every policy with the first one, with Holm's correction.

    Raises:
        InvalidValueError: Their episodes are not pairs.
    """
    baseline, *others = reports.values()
    found = [compare(other, baseline) for other in others]
    corrected = holm([comparison.p for comparison in found])
    comparisons = [replace(c, p_holm=p) for c, p in zip(found, corrected, strict=True)]
    return PolicyComparison(reports=reports, comparisons=comparisons)


def compare(a: EvaluationReport, b: EvaluationReport) -> PairedComparison:
    """Compare two evaluations on the seeds that both have.

    Raises:
        InvalidValueError: Their episodes are not pairs.
    """
    check_paired(a.settings, [result.seed for result in a.results], b)
    theirs = {result.seed: result for result in b.results}
    both = [(x, theirs[x.seed]) for x in a.results if x.seed in theirs]
    pairs = [(x, y) for x, y in both if x.error is None and y.error is None]
    if not pairs:
        expected = "one with episodes that both have, and no internal error in them"
        raise InvalidValueError("--against", "one without such episodes", expected)
    won = np.array([(x.success, y.success) for x, y in pairs], dtype=np.bool_)
    only_a, only_b, p = mcnemar(won[:, 0], won[:, 1])
    return PairedComparison(
        a=a.policy,
        b=b.policy,
        episodes=len(pairs),
        successes_a=int(won[:, 0].sum()),
        successes_b=int(won[:, 1].sum()),
        only_a=only_a,
        only_b=only_b,
        p=p,
        difference=float(won[:, 0].mean() - won[:, 1].mean()),
        interval=paired_difference(only_a, only_b, len(pairs)),
        identical=sum(x.sha256 is not None and x.sha256 == y.sha256 for x, y in pairs),
        cycle_time_s=_cycle_times(pairs),
        differing=tuple(_unequal(x, y) for x, y in pairs if x.success != y.success),
        settings=(*_differing(a.settings, b.settings, _TOLD), *_other_ways(a, b)),
    )


def _other_ways(a: EvaluationReport, b: EvaluationReport) -> list[str]:
    """Return in what two policies differ beside their names, where both have such a setting."""
    one, other = a.settings["policy"], b.settings["policy"]
    alike = _NAMING if a.policy == b.policy else (*_NAMING, "sha256")
    names = [name for name in one if name in other and name not in alike]
    return [f"{name} ({one[name]}, {other[name]})" for name in names if one[name] != other[name]]


def check_paired(
    settings: Mapping[str, Any], seeds: Sequence[int], other: EvaluationReport
) -> None:
    """Check that an evaluation with these settings and seeds can be compared with another one.

    Raises:
        InvalidValueError: Task, robot, perturbation or time limit differ, or there is no common
            seed.
    """
    differing = _differing(settings, other.settings, PAIRED)
    told = _differing(settings, other.settings, _TOLD)
    if differing or set(told) - {"timeout"} == {"robot_sha256"}:
        found = f"one with another {', '.join(differing or told)}"
        expected = "a result of the same task, world and time limit"
        raise InvalidValueError("--against", found, expected)
    if not {result.seed for result in other.results}.intersection(seeds):
        raise InvalidValueError("--against", "one without any of these seeds", "of the same seeds")


def _differing(a: Mapping[str, Any], b: Mapping[str, Any], names: Sequence[str]) -> tuple[str, ...]:
    return tuple(name for name in names if a.get(name) != b.get(name))


def _cycle_times(pairs: Sequence[tuple[EpisodeResult, EpisodeResult]]) -> CycleTimes:
    both = [
        x.metrics[CYCLE] - y.metrics[CYCLE]
        for x, y in pairs
        if x.success and y.success and CYCLE in x.metrics and CYCLE in y.metrics
    ]
    median = float(np.median(both)) if both else None
    return CycleTimes(episodes=len(both), median_difference=median)


def _unequal(a: EpisodeResult, b: EpisodeResult) -> UnequalEpisode:
    failed = b if a.success else a
    return UnequalEpisode(
        seed=a.seed,
        solved_by="a" if a.success else "b",
        cause=failed.failure,
        evidence=failed.explanation,
        step=failed.step,
        time=failed.time,
    )
