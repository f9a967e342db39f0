"""Evaluation: episodes of a row of seeds, each run once, whatever happens in between."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from time import perf_counter
from typing import Any

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.episode import Episode, EpisodeResult, EpisodeSpec
from robo47_qp.evaluation.journal import Journal
from robo47_qp.evaluation.workers.executor import Executor

Show = Callable[[Sequence[EpisodeResult]], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Finished:
    """An evaluation that is done."""

    results: Sequence[EpisodeResult]
    """All of them, in the order of the seeds."""
    fresh: Sequence[EpisodeResult]
    """Those that were run now, as they came."""
    seconds: float
    """Wall time of these, with the start of the workers [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """What is to be evaluated, and on which seeds."""

    episode: Episode
    settings: Mapping[str, Any]
    """All that the results depend on, as JSON."""
    episodes: int
    """How many."""
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

    def run(self, executor: Executor, path: Path, show: Show, *, resume: bool) -> Finished:
        """Run the episodes that a journal does not hold yet.

        Args:
            executor: Where they run.
            path: The journal.
            show: Called with all results so far, at the start and after each one.
            resume: Go on with the journal, if there is one.

        Raises:
            JournalError, RecordingError: See `Journal`.
            WorkerError: See `Executor.run`.
        """
        started, fresh = perf_counter(), []
        with closing(Journal(path, self.settings, resume=resume)) as journal:
            there = journal.results
            done = [there[spec.seed] for spec in self.specs if spec.seed in there]
            show(done)
            left = [spec for spec in self.specs if spec.seed not in there]
            with closing(_generator(executor, self.episode, left)) as results:
                for result in results:
                    journal.add(result)
                    fresh.append(result)
                    show([*done, *fresh])
        found = sorted([*done, *fresh], key=lambda result: result.index)
        return Finished(results=found, fresh=fresh, seconds=perf_counter() - started)


def _generator(
    executor: Executor, episode: Episode, specs: Sequence[EpisodeSpec]
) -> Generator[EpisodeResult, None, None]:
    """The results, as something to be closed: workers end with it, also on Ctrl-C."""
    if specs:
        yield from executor.run(episode, specs)


def code_digest(folders: Sequence[Path]) -> str:
    """SHA-256 of all Python and model files of some folders: results of other code are others."""
    digest = sha256()
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if path.suffix in (".py", ".xml"):
                digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
                digest.update(path.read_bytes())
    return digest.hexdigest()
