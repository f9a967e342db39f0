"""Executor: where episodes run, for example in worker processes of this machine."""

import os
import pickle
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Protocol

from robo47_qp.arrays import CheckedOptions, Count, Positive
from robo47_qp.evaluation.episode import Episode, EpisodeResult, EpisodeSpec, died, overdue
from robo47_qp.evaluation.workers.worker import Worker, WorkerError, stop, wait_for

_START_TIMEOUT = 300.0
"""Time limit until a worker is ready, for instance with a large policy [s]."""


def cores() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Executor(Protocol):
    """Runs episodes in parallel."""

    @property
    def workers(self) -> int:
        """Number of episodes at once."""
        ...

    def run(self, episode: Episode, specs: Sequence[EpisodeSpec]) -> Iterator[EpisodeResult]:
        """Run episodes, in any order, and yield one result for each.

        An episode that takes too long, or whose process dies, has a failure as its result.

        Raises:
            WorkerError: No worker can be started.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class LocalProcesses(CheckedOptions):
    """Worker processes of this machine, single-threaded, each with an interpreter of its own."""

    workers: Count
    """Number of processes."""
    timeout: Positive
    """Wall time limit of an episode [s]; its process is then killed and replaced."""

    def run(self, episode: Episode, specs: Sequence[EpisodeSpec]) -> Iterator[EpisodeResult]:
        """See `Executor.run`; the workers end when the iterator is closed."""
        payload, waiting = pickle.dumps(episode), deque(specs)
        pool = [Worker(payload, _START_TIMEOUT) for _ in range(min(self.workers, len(waiting)))]
        try:
            while pool:
                wait_for(pool)
                for worker in list(pool):
                    result, lost = self._heard(worker, foreign=episode.foreign)
                    if lost:
                        worker.stop()
                        pool.remove(worker)
                        if waiting:
                            pool.append(Worker(payload, _START_TIMEOUT))
                    elif worker.ready and worker.spec is None:
                        self._next(worker, waiting, pool)
                    # Last: the workers need not wait while the caller handles the result.
                    if result is not None:
                        yield result
        finally:
            stop(pool)

    def _heard(self, worker: Worker, *, foreign: bool) -> tuple[EpisodeResult | None, bool]:
        """Return the result that has arrived, if any, and whether the worker is lost."""
        spec, heard = worker.spec, worker.heard()
        if isinstance(heard, EpisodeResult):
            return heard, False
        if spec is not None and heard is not None:
            return died(spec, heard, foreign=foreign), True
        if monotonic() > worker.deadline:
            if spec is None:
                raise WorkerError(f"A worker was not ready after {_START_TIMEOUT:g} s.")
            return overdue(spec, self.timeout), True
        return None, False

    def _next(self, worker: Worker, waiting: deque[EpisodeSpec], pool: list[Worker]) -> None:
        if waiting:
            worker.begin(waiting.popleft(), self.timeout)
        else:
            worker.stop()
            pool.remove(worker)
