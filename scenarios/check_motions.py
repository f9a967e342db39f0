"""Random motions on several arms: checks that limits are kept and that refusals are justified."""

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import process_time
from typing import Annotated, Literal, TypeAlias, get_args

from robo47_qp.report.importing import importing

with importing():
    import numpy as np
    from mink import SE3, SO3
    from rich.console import Console

    from robo47_qp.arrays import Checked, CountOrZero, Suffix, Vector
    from robo47_qp.cli import main
    from robo47_qp.constants import TIMESTEP
    from robo47_qp.errors import PlanError
    from robo47_qp.evaluation.benchmarks.motion.motion_check import path_deviations, violations
    from robo47_qp.evaluation.benchmarks.motion.reference_kinematics import ReferenceKinematics
    from robo47_qp.evaluation.benchmarks.motion.refusal_check import RefusalCheck
    from robo47_qp.files import check_writable, write_json
    from robo47_qp.ik.gauss_newton import Stall
    from robo47_qp.ik.lm import LmIk
    from robo47_qp.ik.multistart import MultiStart
    from robo47_qp.model.arm import Arm
    from robo47_qp.model.robot import Robot
    from robo47_qp.model.robots import load_robot
    from robo47_qp.motion.planner import Planner
    from robo47_qp.motion.waypoint import Motion, Waypoint
    from robo47_qp.report.figures_table import FiguresTable
    from robo47_qp.report.progress import Steps
    from robo47_qp.report.provenance import provenance

Kind: TypeAlias = Literal["PTP", "LIN", "CIRC", "blended", "via"]
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True, kw_only=True)
class CheckOptions(Checked):
    """Options of this scenario."""

    n: CountOrZero = 200
    """LIN, CIRC, blended and via motions to draw, each, per robot."""
    ptp: CountOrZero = 1000
    """PTP motions to draw, per robot."""
    robots: tuple[str, ...] = ("panda",)
    """Names of robots; some need MuJoCo Menagerie."""
    kinds: tuple[Kind, ...] = KINDS
    """Kinds of motions."""
    seed: CountOrZero = 0
    """Seed of the random motions."""
    report: Annotated[Path, Suffix(".json")] | None = None
    """File for the figures (JSON)."""

    def _label(self, field: str) -> str:
        return f"--{field}"


@dataclass
class Tally:
    """Results of one kind of motion on one robot."""

    planned: int = 0
    refused: dict[str, int] = field(default_factory=dict)
    unconfirmed: list[str] = field(default_factory=list)
    violations: list[str] = field(default_factory=list)
    off: float = 0.0
    """Largest deviation of the commanded tool from its line or arc [m]."""
    ratios: list[float] = field(default_factory=list)
    """Durations relative to their lower bounds [-]."""
    seconds: list[float] = field(default_factory=list)
    """Processor time of planning, refusals included [s]."""


def draw(kind: str, arm: Arm, rng: np.random.Generator) -> tuple[Vector, list[Waypoint]]:
    """Return a start configuration within the joint limits and the waypoints of a motion."""
    low, high = 0.98 * arm.q_min + 0.02 * arm.q_max, 0.02 * arm.q_min + 0.98 * arm.q_max
    q = rng.uniform(low, high)
    start = arm.pose(q)
    if kind == "PTP":
        return q, [Waypoint(name="goal", target=arm.pose(rng.uniform(low, high)))]
    poses = [start]
    for _ in range(1 if kind in ("LIN", "CIRC") else 3):
        poses.append(_near(poses[-1], rng))
    if kind == "LIN":
        return q, [Waypoint(name="goal", target=poses[1], motion=Motion.LIN)]
    if kind == "CIRC":
        through = 0.5 * (start.translation() + poses[1].translation()) + rng.normal(0.0, 0.05, 3)
        goal = Waypoint(name="goal", target=poses[1], motion=Motion.CIRC, through=through)
        return q, [goal]
    names = ("first", "second", "goal")
    how: list[dict[str, object]] = [{"stop": False}, {"stop": False}, {}]
    if kind == "blended":
        how = [{"blend": radius} for radius in rng.uniform(0.005, 0.04, 2)] + [{}]
    waypoints = [
        Waypoint(name=name, target=pose, motion=Motion.LIN, **one)  # type: ignore[arg-type]
        for name, pose, one in zip(names, poses[1:], how, strict=True)
    ]
    return q, waypoints


def _near(pose: SE3, rng: np.random.Generator) -> SE3:
    shift, turn = rng.normal(0.0, 0.1, 3), rng.normal(0.0, 0.3, 3)
    rotation = pose.rotation() @ SO3.exp(turn)
    return SE3.from_rotation_and_translation(rotation, pose.translation() + shift)


def check(robot: Robot, kind: str, rng: np.random.Generator, steps: Iterable[int]) -> Tally:
    """Plan motions of one kind and check each; `steps` are their numbers."""
    arm, look, tally = Arm(robot), ReferenceKinematics(robot), Tally()
    refusals = RefusalCheck(look)
    ik = MultiStart(solver=LmIk(max_iterations=30, stall=Stall()))
    planner = Planner(ik=ik, profile=robot.profile)
    for k in steps:
        q, waypoints = draw(kind, arm, rng)
        began = process_time()
        try:
            legs = planner.plan_chain(arm, waypoints, q, TIMESTEP)
        except PlanError as error:
            tally.seconds.append(process_time() - began)
            found = error.rejection
            name = "pose not reached" if found is None else found.reason.value
            tally.refused[name] = tally.refused.get(name, 0) + 1
            doubt = refusals.doubt(q, waypoints, error)
            if doubt is not None:
                tally.unconfirmed.append(f"{k}: {error} | {doubt}")
            continue
        tally.seconds.append(process_time() - began)
        tally.planned += 1
        missed, off = path_deviations(look, legs, q, waypoints)
        tally.violations += [
            f"{k}: {what}" for what in violations(look, legs, robot.profile) + missed
        ]
        tally.off = max(tally.off, off)
        bound = sum(leg.lower_bound for leg in legs)
        if bound > 0.0:
            tally.ratios.append(sum(leg.trajectory.duration for leg in legs) / bound)
    return tally


def figures(tally: Tally) -> dict[str, object]:
    """Return a tally as plain numbers."""
    return {
        "planned": tally.planned,
        "refused": tally.refused,
        "unconfirmed": tally.unconfirmed,
        "violations": tally.violations,
        "off_m": tally.off,
        "duration_per_bound_median": float(np.median(tally.ratios)) if tally.ratios else None,
        "plan_ms_median": 1e3 * float(np.median(tally.seconds)) if tally.seconds else None,
        "plan_ms_p99": 1e3 * float(np.quantile(tally.seconds, 0.99)) if tally.seconds else None,
    }


def show(console: Console, rows: Sequence[tuple[str, str, Tally]]) -> None:
    """Print the table."""
    headings = ("robot", "motion", "planned", "violations", "refused", "unconfirmed", "off µm")
    texts = ("robot", "motion", "reasons")
    table = FiguresTable(
        (*headings, "per bound", "plan ms", "reasons"), texts=texts, title="Random motions"
    )
    for robot, kind, tally in rows:
        table.add_row(
            *(robot, kind, str(tally.planned), str(len(tally.violations))),
            *(str(sum(tally.refused.values())), str(len(tally.unconfirmed))),
            f"{1e6 * tally.off:.2f}",
            f"{np.median(tally.ratios):.2f}" if tally.ratios else "-",
            f"{1e3 * np.median(tally.seconds):.0f}" if tally.seconds else "-",
            ", ".join(f"{name} {count}" for name, count in sorted(tally.refused.items())),
        )
    console.print(table)
    for robot, kind, tally in rows:
        for line in [*tally.violations, *tally.unconfirmed][:5]:
            console.print(f"{robot} {kind} {line}", highlight=False, markup=False)


def run(options: CheckOptions, console: Console) -> int:
    """Check and print; return the exit code."""
    if options.report is not None:
        check_writable(options.report)
    made = provenance()
    robots, rows = {name: load_robot(name) for name in options.robots}, []
    for name, robot in robots.items():
        for number, kind in enumerate(KINDS):
            if kind not in options.kinds:
                continue
            rng = np.random.default_rng([options.seed, number])
            count = options.ptp if kind == "PTP" else options.n
            with Steps(console, count, f"{name} {kind}") as steps:
                rows.append((name, kind, check(robot, kind, rng, steps.over(range(count)))))
    show(console, rows)
    if options.report is not None:
        told = {f"{robot} {kind}": figures(tally) for robot, kind, tally in rows}
        write_json(options.report, {**made, "figures": told})
    bad = any(tally.violations or tally.unconfirmed for _, _, tally in rows)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(CheckOptions, run, __doc__))
