"""Executor: where episodes run; here, worker processes of this machine."""

import os
import pickle
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Protocol

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.episode import (
    Episode,
    EpisodeResult,
    EpisodeSpec,
    died,
    overdue,
)
from robo47_qp.evaluation.workers.worker import Worker, WorkerError, wait_for

_START_TIMEOUT = 300.0
"""How long a worker may take to get ready, for instance to load a large policy [s]."""


def cores() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Executor(Protocol):
    """Runs episodes somewhere."""

    def run(self, episode: Episode, specs: Sequence[EpisodeSpec]) -> Iterator[EpisodeResult]:
        """Run episodes, in any order; one result for each spec.

        Every episode ends: one that takes too long, or takes its process with it, has a result
        that says so.

        Raises:
            WorkerError: There is nowhere to run.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class LocalProcesses:
    """Worker processes of this machine, each with a thread and an interpreter of its own."""

    workers: int
    """Processes at once."""
    timeout: float
    """Wall time of an episode, after which its process is killed and replaced [s]."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: One is not positive.
        """
        if self.workers < 1:
            raise InvalidValueError("--workers", self.workers, "1 or more")
        if not self.timeout > 0.0:
            raise InvalidValueError("--timeout", self.timeout, "above 0")

    def run(self, episode: Episode, specs: Sequence[EpisodeSpec]) -> Iterator[EpisodeResult]:
        """See `Executor.run`; workers are ended with the iterator."""
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
                    # Last: whoever gets the result takes time that workers need not wait.
                    if result is not None:
                        yield result
        finally:
            for worker in pool:
                worker.stop()

    def _heard(self, worker: Worker, *, foreign: bool) -> tuple[EpisodeResult | None, bool]:
        """A result that is there now, and whether the worker is lost."""
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
