"""RayCluster: episodes in the actors of a Ray cluster; needs the extra "ray"."""

import json
import os
import sys
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from time import monotonic
from typing import Any

from robo47_qp.arrays import CheckedOptions, Count, Positive
from robo47_qp.errors import MissingExtraError
from robo47_qp.evaluation.episode import Episode, EpisodeResult, EpisodeSpec, died, overdue
from robo47_qp.evaluation.workers.worker import WorkerError, run_guarded, worker_environment

_START_TIMEOUT = 300.0
"""Time limit until an actor is ready [s]."""
_POLL = 0.5
"""Period of the check for episodes that take too long [s]."""


class _Actor:
    """A process that runs one episode after the other."""

    def __init__(self, episode: Episode) -> None:
        self._episode = episode

    def ready(self) -> None:
        """Return once the actor has started."""

    def run(self, spec: EpisodeSpec) -> str:
        return json.dumps(run_guarded(self._episode, spec).entry())


@dataclass(kw_only=True)
class _Job:
    """What an actor does now."""

    actor: Any
    spec: EpisodeSpec | None
    """None while it starts."""
    deadline: float


@dataclass(frozen=True, kw_only=True)
class RayCluster(CheckedOptions):
    """Actors of the Ray cluster that RAY_ADDRESS names, or of one started on this machine."""

    workers: Count
    """Number of actors, each with a processor of its own."""
    timeout: Positive
    """Wall time limit of an episode [s]; its actor is then killed and replaced."""

    def __post_init__(self) -> None:
        """Check the numbers, and that Ray is installed.

        Raises:
            MissingExtraError: It is not.
            InvalidValueError: A number is out of range.
        """
        super().__post_init__()
        _ray()

    def run(self, episode: Episode, specs: Sequence[EpisodeSpec]) -> Iterator[EpisodeResult]:
        """See `Executor.run`."""
        ray = _ray()
        joined = "RAY_ADDRESS" in os.environ
        path = os.pathsep.join(entry or str(Path.cwd()) for entry in sys.path)
        # Nodes of a real cluster have the package installed in places of their own.
        variables = worker_environment() | ({} if joined else {"PYTHONPATH": path})
        ray.init(
            num_cpus=None if joined else self.workers,
            runtime_env={"env_vars": variables},
            include_dashboard=None if joined else False,
            log_to_driver=False,
            logging_level="ERROR",
        )
        try:
            yield from _Pool(ray, self, episode, specs).results()
        finally:
            ray.shutdown()


class _Pool:
    """The actors of one run."""

    def __init__(
        self, ray: Any, cluster: RayCluster, episode: Episode, specs: Sequence[EpisodeSpec]
    ) -> None:
        self._ray, self._cluster, self._foreign = ray, cluster, episode.foreign
        self._actor = ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(_Actor)
        self._episode, self._waiting = ray.put(episode), deque(specs)
        self._jobs: dict[Any, _Job] = {}
        for _ in range(min(cluster.workers, len(specs))):
            self._start()

    def results(self) -> Iterator[EpisodeResult]:
        while self._jobs:
            done, _ = self._ray.wait(list(self._jobs), num_returns=1, timeout=_POLL)
            now = monotonic()
            late = [r for r, job in self._jobs.items() if r not in done and now > job.deadline]
            for reference in (*done, *late):
                result = self._ended(reference, late=reference in late)
                if result is not None:
                    yield result

    def _start(self) -> None:
        actor = self._actor.remote(self._episode)
        job = _Job(actor=actor, spec=None, deadline=monotonic() + _START_TIMEOUT)
        self._jobs[actor.ready.remote()] = job

    def _next(self, actor: Any) -> None:
        if self._waiting:
            spec = self._waiting.popleft()
            deadline = monotonic() + self._cluster.timeout
            self._jobs[actor.run.remote(spec)] = _Job(actor=actor, spec=spec, deadline=deadline)

    def _ended(self, reference: Any, *, late: bool) -> EpisodeResult | None:
        job = self._jobs.pop(reference)
        result, words = None, "it was not ready in time"
        if not late:
            try:
                said = self._ray.get(reference)
                result = None if job.spec is None else _result(said, job.spec)
            except self._ray.exceptions.RayError as error:
                words = str(error).strip().splitlines()[0]
            except (ValueError, TypeError, KeyError) as error:
                words = f"it sent something else than the result of its episode: {error}"
            else:
                self._next(job.actor)
                return result
        if job.spec is None:
            raise WorkerError(f"An actor cannot start: {words}.")
        self._ray.kill(job.actor)
        if self._waiting:
            self._start()
        if late:
            return overdue(job.spec, self._cluster.timeout)
        return died(job.spec, words, foreign=self._foreign)


def _result(said: str, spec: EpisodeSpec) -> EpisodeResult:
    """Return the result that an actor sent as JSON.

    Raises:
        ValueError, TypeError, KeyError: It is none, or that of another episode.
    """
    result = EpisodeResult.of_entry(json.loads(said))
    if (result.index, result.seed) != (spec.index, spec.seed):
        raise ValueError(f"index {result.index}, seed {result.seed}")
    return result


def _ray() -> Any:
    try:
        return import_module("ray")
    except ImportError as error:
        raise MissingExtraError("--cluster ray", "ray", "ray") from error
