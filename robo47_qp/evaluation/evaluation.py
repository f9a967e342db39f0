"""Evaluation: episodes on consecutive seeds, each run once, across interruptions."""

import json
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from os import walk
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any, Literal, TypeAlias

import mujoco
import numpy as np

from robo47_qp.arrays import CheckedOptions, CountOrZero, Range
from robo47_qp.errors import InvalidValueError, Robo47Error
from robo47_qp.evaluation.episode import Episode, EpisodeResult, EpisodeSpec
from robo47_qp.evaluation.journal import Journal, differences_of
from robo47_qp.evaluation.perturbation import Perturbation
from robo47_qp.evaluation.policies import PolicyReference, policy_settings
from robo47_qp.evaluation.report.report import EvaluationReport, Throughput
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.evaluation.workers.executor import Executor, LocalProcesses, cores
from robo47_qp.evaluation.workers.ray_cluster import RayCluster
from robo47_qp.files import plain
from robo47_qp.model.mjcf import forget_files
from robo47_qp.model.robot import Robot
from robo47_qp.report.run_report import versions
from robo47_qp.run.foreign_code import files_beside
from robo47_qp.run.policy.drivers import check_judged, check_one_tool
from robo47_qp.run.start import checked_start
from robo47_qp.run.task import Task
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack

Show = Callable[[Sequence[EpisodeResult]], None]
Episodes: TypeAlias = Annotated[int, Range(at_least=1, at_most=1_000_000, whole=True)]
"""Number of episodes of an evaluation, whose results are all held in memory."""
_CODE = (".py", ".xml", ".c", ".h")
"""Endings of what decides outcomes: Python, models, and the sources of the compiled core, which is
built anew where they change."""


class ChangedError(Robo47Error):
    """An evaluation of which a policy, the code or a robot was changed while it ran."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation(CheckedOptions):
    """Episodes to run, and their seeds."""

    episode: Episode
    settings: Mapping[str, Any]
    """All that the results depend on, as JSON."""
    episodes: Episodes
    seed: CountOrZero = 0
    """Episode i has the seed `seed + i`."""
    now: Callable[[], Mapping[str, Any]] | None = None
    """Returns the settings anew, as files are now; None where none of them is of a file."""

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
            executor: Runs the episodes.
            path: Journal of the finished episodes, if one is kept.
            show: Called with all results so far, at the start and after each episode.
            resume: Continue the journal, if there is one.

        Raises:
            ChangedError: Something that the results depend on has changed meanwhile. That is
                looked for after the first episode and at the end, also that by Ctrl-C.
            JournalError, RecordingError: See `Journal`.
            WorkerError: See `Executor.run`.
        """
        started, fresh = perf_counter(), list[EpisodeResult]()
        with ExitStack() as stack:
            journal = None
            if path is not None:
                journal = stack.enter_context(closing(Journal(path, self.settings, resume=resume)))
            known = {} if journal is None else journal.judged
            wanted = [spec for spec in self.specs if spec.seed in known]
            # The journal may have begun at another seed.
            done = [replace(known[spec.seed], index=spec.index) for spec in wanted]
            left = [spec for spec in self.specs if spec.seed not in known]
            if show is not None:
                show(done)
            try:
                with closing(_generator(executor, self.episode, left)) as results:
                    for result in results:
                        if journal is not None:
                            journal.add(result)
                        fresh.append(result)
                        if show is not None:
                            show([*done, *fresh])
                        if len(fresh) == 1:
                            self._check_unchanged(journal)
            finally:
                if len(fresh) > 1:
                    self._check_unchanged(journal)
        return EvaluationReport(
            settings=self.settings,
            results=sorted([*done, *fresh], key=lambda result: result.index),
            # No more are started than there are episodes.
            timing=Throughput.of(
                fresh, perf_counter() - started, min(executor.workers, max(len(left), 1))
            ),
        )

    def _check_unchanged(self, journal: Journal | None) -> None:
        """Check that files are those that the settings tell; else mark the journal.

        Raises:
            ChangedError: They are not.
        """
        if self.now is None:
            return
        try:
            changed = differences_of(self.settings, self.now())
        except (Robo47Error, OSError) as error:
            changed = [f"files ({error})"]
        if not changed:
            return
        kept = ""
        if journal is not None:
            journal.spoil(changed)
            kept = f" {journal.path} keeps the episodes, and is not continued."
        raise ChangedError(
            f"These changed while the evaluation ran: {', '.join(changed)}. A report would hold "
            f"two versions as one, so none was written.{kept} Let all files be and start a new "
            "evaluation, without --resume."
        )


def _generator(
    executor: Executor, episode: Episode, specs: Sequence[EpisodeSpec]
) -> Generator[EpisodeResult, None, None]:
    """Yield the results; closing the generator ends the workers, also on Ctrl-C."""
    if specs:
        yield from executor.run(episode, specs)


@dataclass(frozen=True, kw_only=True, eq=False)
class PolicyEvaluation:
    """A task under one policy in perturbed worlds, on consecutive seeds."""

    task: Task
    robot: Robot
    policy: ClassicalStack | PolicyReference = ClassicalStack()
    name: str | None = None
    """Name of the policy in reports; by default "classical", or its reference."""
    perturbation: Perturbation = Perturbation()
    time_limit: float | None = None
    """Simulated time for an episode, in place of `Task.time_limit` [s]."""
    episodes: int = 100
    seed: int = 0
    """Episode i has the seed `seed + i`."""
    workers: int = field(default_factory=cores)
    """Number of worker processes."""
    timeout: float = 300.0
    """Wall time limit of an episode [s]; its process is then killed and replaced."""
    cluster: Literal["local", "ray"] = "local"

    @property
    def executor(self) -> Executor:
        """Where the episodes run."""
        kind = RayCluster if self.cluster == "ray" else LocalProcesses
        return kind(workers=self.workers, timeout=self.timeout)

    @cached_property
    def evaluation(self) -> Evaluation:
        """The episodes and their settings.

        Raises:
            ClassLoadError: The policy cannot be loaded.
            InvalidValueError: A number is out of range, the robot cannot do the task (see
                `checked_start`), the task is done before it begins, or the stack has no
                velocities: without an observer, and with a cut-off of 0.
        """
        if self._stack.observer is None and self.perturbation.velocity_cutoff == 0.0:
            expected = "above 0 without an observer: controllers need velocities"
            raise InvalidValueError("--velocity-cutoff", 0.0, expected)
        return Evaluation(
            episode=self._episode(),
            settings=self._settings(),
            episodes=self.episodes,
            seed=self.seed,
            now=self._settings,
        )

    def _settings(self) -> dict[str, Any]:
        policy, stack = self._policy, self._stack
        return {
            "task": plain(self.task),
            "robot": self.robot.name,
            "robot_sha256": robot_digest(self.robot),
            "policy": policy_settings(policy, self.name),
            "perturbation": plain(self.perturbation),
            "speed": stack.pace,
            "time_limit": self.time_limit or self.task.time_limit,
            "timeout": self.timeout,
            "code": code_digest(self._places),
            "versions": versions(),
        }

    @cached_property
    def _places(self) -> list[Path]:
        return _sources(self.task)

    @cached_property
    def _policy(self) -> ClassicalStack | PolicyReference:
        """The policy, which is waited for as long as for an episode."""
        if isinstance(self.policy, ClassicalStack):
            return self.policy
        return replace(self.policy, patience=self.timeout)

    @property
    def _stack(self) -> ClassicalStack:
        return self.policy if isinstance(self.policy, ClassicalStack) else self.policy.stack

    def _episode(self) -> Episode:
        policy, robot, task = self._policy, self.robot, self.task
        if not isinstance(policy, ClassicalStack):
            check_one_tool(task)
            _ = policy.loaded  # what cannot be had is told first
        simulation = checked_start(task, robot, self.seed)
        plain_episode = TaskEpisode(
            robot=robot, task=task, perturbation=self.perturbation, time_limit=self.time_limit
        )
        if isinstance(policy, ClassicalStack):
            return replace(plain_episode, stack=policy)
        check_judged(task, simulation)
        driver = policy.driver
        return replace(plain_episode, stack=policy.stack, driver=driver, foreign=True)


def evaluate_policy(
    task: Task,
    robot: Robot,
    policy: ClassicalStack | PolicyReference | None = None,
    *,
    episodes: int = 100,
    seed: int = 0,
    workers: int | None = None,
    perturbation: Perturbation | None = None,
) -> EvaluationReport:
    """Run episodes of a task under one policy in worker processes; writes no files.

    Workers import the calling script: call this under `if __name__ == "__main__":`.

    Args:
        task: The task.
        robot: The robot.
        policy: By default the classical stack.
        episodes: Number of episodes; episode i has the seed `seed + i`.
        seed: Seed of the first episode.
        workers: Number of processes; by default one per processor.
        perturbation: Ranges of the disturbances; by default none.

    Raises:
        ChangedError: See `Evaluation.run`.
        ClassLoadError: The policy cannot be loaded.
        InvalidValueError: A number is out of range, the robot cannot do the task (see
                `checked_start`), or the task is done before it begins.
        WorkerError: The processes cannot be started.
    """
    chosen = PolicyEvaluation(
        task=task,
        robot=robot,
        policy=ClassicalStack() if policy is None else policy,
        episodes=episodes,
        seed=seed,
        workers=cores() if workers is None else workers,
        perturbation=Perturbation() if perturbation is None else perturbation,
    )
    return chosen.evaluation.run(chosen.executor)


def _sources(task: Task) -> list[Path]:
    """Where the code of this package and of a task is: folders of packages, or files."""
    names = {__name__.partition(".")[0], type(task).__module__.partition(".")[0]}
    files = [Path(sys.modules[name].__file__ or "") for name in sorted(names)]
    places = [[f.parent] if f.name == "__init__.py" else files_beside(str(f)) for f in files]
    return [Path(place) for some in places for place in some]


def robot_digest(robot: Robot) -> str:
    """Return the SHA-256 of a robot's description and of its model as its files are now."""
    forget_files()
    model = Simulation(robot, lambda _: None).model
    compiled = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, compiled)
    told = json.dumps(plain(robot), sort_keys=True)
    return sha256(told.encode() + compiled.tobytes()).hexdigest()


def code_digest(places: Sequence[Path]) -> str:
    """Return the SHA-256 of all code and models in some folders, links followed; see `_CODE`."""
    digest = sha256()
    for place in places:
        inside = [
            Path(at, name) for at, _, names in walk(place, followlinks=True) for name in names
        ]
        for path in sorted(inside) or [place]:
            if path.suffix in _CODE:
                digest.update(path.relative_to(place.parent).as_posix().encode() + b"\0")
                digest.update(path.read_bytes())
    return digest.hexdigest()
