"""Options of an evaluation."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypedDict

import tyro

from robo47_qp.arrays import CheckedOptions, CountOrZero, Positive, Range, Suffix
from robo47_qp.cli import LOGS, StackOptions, TaskOption, unset
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.evaluation import Episodes, PolicyEvaluation
from robo47_qp.evaluation.perturbation import PRESETS, Perturbation, options
from robo47_qp.evaluation.policies import (
    CLASSICAL,
    Contender,
    PolicyReference,
    check_different,
    labels,
)
from robo47_qp.evaluation.workers.executor import cores
from robo47_qp.model.robot import Robot
from robo47_qp.run.policy.drivers import DecisionRate, EpisodeTime, PolicyTiming
from robo47_qp.run.task import Task
from robo47_qp.stack import BY_QP, ClassicalStack

_GIVEN: Any = TypedDict(  # type: ignore[misc]
    "_GIVEN",
    {
        name: Annotated[kind, tyro.conf.arg(help=f"{about.text} [{about.unit}].")]
        for name, (_, kind, about) in options().items()
    },
    total=False,
)
"""By name, those of the options of perturbations that are given."""


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions(CheckedOptions, StackOptions, TaskOption):
    """Options of an evaluation on the command line."""

    policy: tuple[str, ...] = ()
    """The classical stack (the default): classical with the IK of --ik, or classical:mink,
    :qp, :lm or :dls, each also with -single. Or module:Class or file.py:Class of a policy: a
    class with reset(observation) and act(observation). Given more than once, each one runs on
    the same seeds, and the first is the baseline that each other one is compared with."""
    rate: DecisionRate = PolicyTiming.rate
    """Decisions per second of another policy, at most 1000 [1/s]."""
    time_limit: Annotated[EpisodeTime | None, unset("FLOAT")] = None
    """Simulated time for an episode, the same for every policy; by default that of the task [s]."""
    episodes: Episodes = 100
    """Number of episodes; episode i has the seed `seed` + i."""
    seed: CountOrZero = 0
    """Seed of the first episode."""
    workers: Annotated[int, Range(at_least=1, at_most=4096, whole=True)] = field(
        default_factory=cores
    )
    """Processes at once; all processors by default."""
    timeout: Positive = 300.0
    """Wall time of an episode, after which its process is killed and replaced [s]."""
    cluster: Literal["local", "ray"] = "local"
    """Where episodes run: processes of this machine, or a Ray cluster (needs the extra "ray")."""
    perturb: Literal["none", "moderate", "severe"] = "none"
    """How much the world differs from what the stack believes: moderate is a calibrated real cell,
    severe about twice as wrong; docs/evaluation.md has the table."""
    perturbations: Annotated[
        Mapping[str, float | str], tyro.conf.arg(name="", constructor=_GIVEN)
    ] = field(default_factory=dict)
    """Single perturbations by the names of their options, in place of those of --perturb."""
    failures: CountOrZero = 5
    """Largest number of failed episodes that are recorded."""
    resume: bool = False
    """Continue an interrupted evaluation."""
    replay: Annotated[CountOrZero | None, unset("INT")] = None
    """Run only the episode with this seed, and record it."""
    against: Annotated[Path | None, unset("PATH")] = None
    """Report (.json) of another evaluation on the same seeds to compare with."""
    log: Annotated[Path, Suffix(".rrd")] = LOGS / "eval.rrd"
    """Recording of the failures; the other files go beside it: report (.json and .md), journal
    (.jsonl), picture (.png). Of several policies, each has files of its own (eval.NAME.json and
    so on), and eval.json and eval.md hold the comparison."""
    json: bool = False
    """Print the report as JSON on the standard output and nothing else."""

    def __post_init__(self) -> None:
        """Check every option, and those that depend on the policies.

        Raises:
            InvalidValueError: A value is out of range, or options contradict each other.
        """
        super().__post_init__()
        contenders = self.contenders
        check_different(contenders)
        if all(c.ik is not None for c in contenders) and self.rate != PolicyTiming.rate:
            expected = f"left out with --policy {CLASSICAL}, which has no use for it"
            raise InvalidValueError("--rate", f"{self.rate:g}", expected)
        if self.ik != EvaluateOptions.ik and all(c.name != CLASSICAL for c in contenders):
            raise InvalidValueError("--ik", self.ik, f"left out without --policy {CLASSICAL}")
        if self.qp_solver != ClassicalStack.qp_solver and not any(c.solves_qp for c in contenders):
            expected = f"left out without a --policy {CLASSICAL} whose IK is {' or '.join(BY_QP)}"
            raise InvalidValueError("--qp-solver", self.qp_solver, expected)
        for name in ("against", "resume"):
            if self.replay is not None and getattr(self, name):
                expected = "left out with --replay, which runs a single episode"
                raise InvalidValueError(f"--{name}", getattr(self, name), expected)
        for name in ("against", "replay"):
            found = getattr(self, name)
            if len(contenders) > 1 and found is not None:
                raise InvalidValueError(f"--{name}", found, "left out with several policies")

    @property
    def contenders(self) -> list[Contender]:
        """The policies, in their order.

        Raises:
            UnknownNameError: One has an unknown IK.
        """
        names = self.policy if self.policy else (CLASSICAL,)
        return [Contender.of(name, self.ik) for name in names]

    @property
    def contender(self) -> Contender:
        """The first policy."""
        return self.contenders[0]

    @property
    def each(self) -> "list[EvaluateOptions]":
        """The options of each policy alone; with several policies, each has its own files."""
        contenders = self.contenders
        if len(contenders) == 1:
            return [self]
        return [
            replace(
                self,
                policy=(contender.name,),
                ik=self.ik if contender.name == CLASSICAL else EvaluateOptions.ik,
                rate=self.rate if contender.ik is None else PolicyTiming.rate,
                qp_solver=self.qp_solver if contender.solves_qp else ClassicalStack.qp_solver,
                log=self.log.with_name(f"{self.log.stem}.{label}.rrd"),
            )
            for contender, label in zip(contenders, labels(contenders), strict=True)
        ]

    @property
    def perturbation(self) -> Perturbation:
        """The chosen ranges.

        Raises:
            InvalidValueError: A number is out of range.
        """
        return PRESETS[self.perturb].with_options(self.perturbations)

    def evaluation(self, task: Task, robot: Robot) -> PolicyEvaluation:
        """Return the evaluation of a single policy.

        Raises:
            InvalidValueError: A number is out of range.
        """
        contender, reference = self.contender, self.contender.reference
        stack = replace(self.stack, ik=contender.ik or self.ik)
        policy: ClassicalStack | PolicyReference = stack
        if reference is not None:
            policy = replace(reference, timing=PolicyTiming(rate=self.rate), stack=stack)
        return PolicyEvaluation(
            task=task,
            robot=robot,
            policy=policy,
            name=contender.name,
            perturbation=self.perturbation,
            time_limit=self.time_limit,
            episodes=self.episodes,
            seed=self.seed,
            workers=self.workers,
            timeout=self.timeout,
            cluster=self.cluster,
        )

    @property
    def files(self) -> dict[str, Path]:
        """Files that are written, by name."""
        endings = {"report": ".json", "text": ".md", "journal": ".jsonl", "plot": ".png"}
        files = {name: self.log.with_suffix(ending) for name, ending in endings.items()}
        return {**files, "recording": self.log}
