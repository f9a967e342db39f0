"""Curves of success against one kind of wrongness at a time, growing until half is lost."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from robo47_qp.arrays import Checked, Count, CountOrZero
from robo47_qp.errors import Robo47Error, UnknownNameError
from robo47_qp.evaluation.evaluation import PolicyEvaluation
from robo47_qp.evaluation.perturbation import Perturbation, options
from robo47_qp.evaluation.statistics import wilson
from robo47_qp.model.robot import Robot
from robo47_qp.run.task import Task
from robo47_qp.sim.sensing import Growth
from robo47_qp.stack import ClassicalStack

STACKS: Mapping[str, ClassicalStack] = {
    "stack": ClassicalStack(),
    "no-observer": ClassicalStack(observer=None),
    "dls": ClassicalStack(ik="dls"),
    "dls-single": ClassicalStack(ik="dls-single"),
}
"""What is compared: the stack, without its observer, and with damped least squares in place of the
QP, restarted and not; DLS has the same controller and observer."""
NOTHING = "none"
"""Name of the level at which nothing is wrong, which all curves share."""


def kinds() -> dict[str, tuple[str, Growth, str]]:
    """Return what can be wrong by itself: unit, growth and meaning by the name of the option."""
    return {
        name: (about.unit, about.growth, about.text)
        for name, (_, _, about) in options().items()
        if about.growth is not None
    }


def alone(kind: str, value: float) -> Perturbation:
    """Return the world in which one thing is wrong, and by how much in the unit of its option.

    Raises:
        InvalidValueError: The value is out of range.
        UnknownNameError: Nothing that can be wrong by itself is called so.
    """
    known = kinds()
    if kind not in known:
        raise UnknownNameError("kind of wrongness", kind, known)
    beside: dict[str, Any] = dict(known[kind][1].beside)
    return replace(Perturbation(), **beside).with_options({kind: value})


class NothingJudgedError(Robo47Error):
    """A level of which nothing is known, since no episode was judged."""

    def __init__(self, journal: Path, why: str) -> None:
        """Name the journal and the first error."""
        super().__init__(
            f"No episode of {journal} was judged: all ended with an internal error, the first with "
            f"{why.rstrip('.')}. Mend that and continue with --resume."
        )


@dataclass(frozen=True, kw_only=True)
class Point:
    """Success at one level."""

    value: float | None
    """In the unit of the option; None where nothing is wrong."""
    successes: int
    episodes: int
    """Those that were judged."""
    causes: Mapping[str, int]
    """Failures by cause."""
    audits_kept: int
    errors: int = 0
    """Episodes that ended with an internal error, which is none of the stack's failures."""

    @property
    def rate(self) -> float:
        """Share of the episodes that succeeded."""
        return self.successes / self.episodes

    def as_json(self) -> dict[str, Any]:
        """Return the point as JSON, with its 95 % interval."""
        return {**vars(self), "causes": dict(self.causes), "interval": list(self.interval)}

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's, 95 %."""
        return wilson(self.successes, self.episodes)


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Success of one stack against one kind of wrongness."""

    stack: str
    kind: str
    points: Sequence[Point]
    """From nothing wrong on."""

    def as_json(self) -> dict[str, Any]:
        """Return the curve as JSON."""
        return {
            "stack": self.stack,
            "kind": self.kind,
            "half_is_lost_at": self.half,
            "points": [point.as_json() for point in self.points],
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """Return the curve of which `as_json` was made."""
        points = [
            Point(**{key: value for key, value in point.items() if key != "interval"})
            for point in content["points"]
        ]
        return cls(stack=content["stack"], kind=content["kind"], points=points)

    @property
    def half_told(self) -> str:
        """Where half is lost, for a table; beyond the last level where that was not reached."""
        if self.half is not None:
            return f"{self.half:.3g}"
        last = self.points[-1].value
        if last is None:
            return "–"
        return f"{'>' if kinds()[self.kind][1].factor > 1.0 else '<'} {last:.3g}"

    @property
    def half(self) -> float | None:
        """Where half of what succeeds with nothing wrong is lost; None where that was not reached.

        Between two levels a straight line is taken. Where less is worse there is no way from
        nothing to the first level: it is that level.
        """
        most = 0.5 * self.points[0].rate
        for before, after in zip(self.points, self.points[1:], strict=False):
            if after.rate <= most and after.value is not None and before.rate > most:
                low = before.value
                if low is None:
                    growth = kinds()[self.kind][1]
                    low = 0.0 if growth.factor > 1.0 else after.value
                share = (before.rate - most) / (before.rate - after.rate)
                return low + share * (after.value - low)
        return None


@dataclass(frozen=True, kw_only=True)
class Robustness(Checked):
    """A campaign: stacks × kinds × levels, each with the same seeds; continued where it stopped."""

    task: Task
    robot: Robot
    stacks: Sequence[str]
    kinds: Sequence[str]
    episodes: Count
    """At each level."""
    levels: Count
    """Levels of a kind at most."""
    stride: Count = 1
    """1: all levels; 2: every other one, and so on."""
    seed: CountOrZero
    workers: Count
    folder: Path
    """Journals, one for each stack, kind and level."""

    def run(self, show: Callable[[str, str, Point], None], *, resume: bool) -> Iterator[Curve]:
        """Yield the curves as they are finished; a kind ends where half is lost.

        Args:
            show: Called with stack, kind and point after each level.
            resume: Continue the journals that are there.

        Raises:
            ChangedError, JournalError, RecordingError, WorkerError: See `Evaluation.run`.
            NothingJudgedError: All episodes of a level ended with internal errors.
            UnknownNameError: A stack or a kind has an unknown name.
        """
        known = kinds()
        for name, all_names in ((self.stacks, STACKS), (self.kinds, known)):
            for one in name:
                if one not in all_names:
                    raise UnknownNameError("stack or kind of wrongness", one, all_names)
        for stack in self.stacks:
            start = self._point(stack, NOTHING, None, Perturbation(), resume=resume)
            show(stack, NOTHING, start)
            for kind in self.kinds:
                points = [start]
                values = known[kind][1].levels(self.levels * self.stride)[:: self.stride]
                for value in values if start.successes else ():
                    point = self._point(stack, kind, value, alone(kind, value), resume=resume)
                    show(stack, kind, point)
                    points.append(point)
                    if point.rate <= 0.5 * start.rate:
                        break
                yield Curve(stack=stack, kind=kind, points=points)

    def _point(
        self, stack: str, kind: str, value: float | None, world: Perturbation, *, resume: bool
    ) -> Point:
        chosen = PolicyEvaluation(
            task=self.task,
            robot=self.robot,
            policy=STACKS[stack],
            name=stack,
            perturbation=world,
            episodes=self.episodes,
            seed=self.seed,
            workers=self.workers,
        )
        level = NOTHING if value is None else f"{kind}.{value:g}"
        journal = self.folder / f"{stack}.{level}.jsonl"
        report = chosen.evaluation.run(chosen.executor, journal, resume=resume)
        if not report.judged:
            raise NothingJudgedError(journal, report.errors[0].explanation)
        return Point(
            value=value,
            successes=report.successes,
            episodes=report.judged,
            causes=report.causes,
            audits_kept=report.audits_kept,
            errors=len(report.errors),
        )
