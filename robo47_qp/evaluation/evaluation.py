"""Evaluation: episodes on consecutive seeds, each run once, across interruptions."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from time import perf_counter
from typing import Any

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.episode import Episode, EpisodeResult, EpisodeSpec
from robo47_qp.evaluation.journal import Journal
from robo47_qp.evaluation.report.report import EvaluationReport, Throughput
from robo47_qp.evaluation.workers.executor import Executor

Show = Callable[[Sequence[EpisodeResult]], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """Episodes to run, and their seeds."""

    episode: Episode
    settings: Mapping[str, Any]
    """All that the results depend on, as JSON."""
    episodes: int
    seed: int = 0
    """Episode i has the seed `seed + i`."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: There are no episodes, or seeds below 0.
        """
        if self.episodes < 1:
            raise InvalidValueError("--episodes", self.episodes, "1 or more")
        if self.seed < 0:
            raise InvalidValueError("--seed", self.seed, "0 or more")

    @property
    def specs(self) -> list[EpisodeSpec]:
        """All episodes, in their order."""
        return [EpisodeSpec(index=i, seed=self.seed + i) for i in range(self.episodes)]

    def run(
        self,
        executor: Executor,
        path: Path | None = None,
        show: Show | None = None,
        *,
        resume: bool = False,
    ) -> EvaluationReport:
        """Run the episodes that are not in the journal yet.

        Args:
            executor: Where the episodes run.
            path: Journal of the finished episodes; None keeps none.
            show: Called with all results so far, at the start and after each episode.
            resume: Continue the journal, if there is one.

        Raises:
            JournalError, RecordingError: See `Journal`.
            WorkerError: See `Executor.run`.
        """
        started, fresh = perf_counter(), []
        with ExitStack() as stack:
            journal = None
            if path is not None:
                journal = stack.enter_context(closing(Journal(path, self.settings, resume=resume)))
            known = {} if journal is None else journal.results.copy()
            done = [known[spec.seed] for spec in self.specs if spec.seed in known]
            left = [spec for spec in self.specs if spec.seed not in known]
            if show is not None:
                show(done)
            for result in stack.enter_context(closing(_generator(executor, self.episode, left))):
                if journal is not None:
                    journal.add(result)
                fresh.append(result)
                if show is not None:
                    show([*done, *fresh])
        return EvaluationReport(
            settings=self.settings,
            results=sorted([*done, *fresh], key=lambda result: result.index),
            timing=Throughput.of(fresh, perf_counter() - started, executor.workers),
        )


def _generator(
    executor: Executor, episode: Episode, specs: Sequence[EpisodeSpec]
) -> Generator[EpisodeResult, None, None]:
    """Yield the results; closing the generator ends the workers, also on Ctrl-C."""
    if specs:
        yield from executor.run(episode, specs)


def code_digest(folders: Sequence[Path]) -> str:
    """Return the SHA-256 of all Python and model files in some folders."""
    digest = sha256()
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if path.suffix in (".py", ".xml"):
                digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
                digest.update(path.read_bytes())
    return digest.hexdigest()
