"""IK that keeps a clearance: a Panda among obstacles, evaluated by contacts of a separate model."""

import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from robo47_qp.report.importing import importing

with importing():
    import numpy as np
    from mink import SE3, SO3
    from rich.console import Console
    from scipy.stats import binomtest

    from robo47_qp.arrays import Checked, Count, CountOrZero, Range, Suffix
    from robo47_qp.cli import main
    from robo47_qp.collision.clearance import Clearance
    from robo47_qp.evaluation.benchmarks.ik.contact_judge import ContactJudge
    from robo47_qp.files import check_writable, write_json
    from robo47_qp.ik.gauss_newton import Stall
    from robo47_qp.ik.lm import LmIk
    from robo47_qp.ik.multistart import MultiStart
    from robo47_qp.ik.qp import QpIk
    from robo47_qp.ik.solver import IkResult, IkSolver
    from robo47_qp.model.arm import Arm
    from robo47_qp.model.obstacle import Obstacle, Shape
    from robo47_qp.model.robots.panda import PANDA
    from robo47_qp.report.figures_table import FiguresTable
    from robo47_qp.report.progress import Steps
    from robo47_qp.report.provenance import provenance

_LARGEST = 0.05
"""Clearance above which hardly any configuration among the obstacles is left [m]."""


@dataclass(frozen=True, kw_only=True)
class CollisionIkOptions(Checked):
    """Options of this scenario."""

    n: Count = 1000
    """Targets made of configurations that keep the clearance."""
    cluttered: CountOrZero = 200
    """Targets made of configurations that do not; about a third has another solution."""
    seed: CountOrZero = 0
    """Seed of the targets."""
    clearance: Annotated[float, Range(above=0.0, at_most=_LARGEST)] = 0.01
    """Distance to be kept [m]."""
    exhaustive: CountOrZero = 600
    """Restarts of the exhaustive search for targets that no solver reached."""
    report: Annotated[Path, Suffix(".json")] | None = None
    """File for the figures (JSON)."""

    def _label(self, field: str) -> str:
        return f"--{field}"


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Results of one solver on one kind of targets."""

    solver: str
    targets: str
    n: int
    solvable: int
    """Targets for which a solver or the exhaustive search found a solution."""
    solved: int
    interval: tuple[float, float]
    """Wilson's 95 % interval of the share."""
    least_clearance_mm: float | None
    """Smallest clearance of all solutions, measured by the judge; None where there is none."""
    median_ms: float | None
    """Times of the targets that have a solution; None where there are none."""
    p95_ms: float | None
    p99_ms: float | None
    unsolvable_median_ms: float | None


def cell() -> list[Obstacle]:
    """Return a table, a post, a ball and a tilted shelf."""

    def at(x: float, y: float, z: float) -> SE3:
        return SE3.from_translation(np.array([x, y, z]))

    tilted = at(0.6, 0.0, 0.5) @ SE3.from_rotation(SO3.from_rpy_radians(0.2, 0.1, 0.4))
    table, shelf = (0.6, 0.6, 0.02), (0.15, 0.2, 0.01)
    return [
        Obstacle(name="table", shape=Shape.BOX, size=table, T_world_obstacle=at(0.3, 0.0, -0.02)),
        Obstacle(
            name="post",
            shape=Shape.CYLINDER,
            size=(0.05, 0.3),
            T_world_obstacle=at(0.45, 0.3, 0.3),
        ),
        Obstacle(
            name="ball", shape=Shape.SPHERE, size=(0.1,), T_world_obstacle=at(0.45, -0.3, 0.5)
        ),
        Obstacle(name="shelf", shape=Shape.BOX, size=shelf, T_world_obstacle=tilted),
    ]


def targets(
    arm: Arm, clearance: Clearance, options: CollisionIkOptions, *, clear: bool
) -> Iterator[SE3]:
    """Yield poses of random configurations that keep the clearance, or that do not."""
    rng = np.random.default_rng([options.seed, clear])
    missing = options.n if clear else options.cluttered
    while missing:
        q = arm.drawn(rng)
        if clearance.clear(q, options.clearance) == clear:
            missing -= 1
            yield arm.pose(q)


def solvers(clearance: float) -> dict[str, IkSolver]:
    lm = LmIk(max_iterations=20, stall=Stall(), clearance=clearance)
    qp = QpIk(max_iterations=30, stall=Stall(), clearance=clearance)
    return {"LM": MultiStart(solver=lm), "QP": MultiStart(solver=qp)}


def run(options: CollisionIkOptions, console: Console) -> int:
    """Solve, evaluate and print; return the exit code."""
    if options.report is not None:
        check_writable(options.report)
    made, arm = provenance(), Arm(PANDA, obstacles=cell())
    clearance, judge = Clearance(arm, options.clearance), ContactJudge(PANDA, cell())
    patient = MultiStart(
        solver=LmIk(max_iterations=50, stall=Stall(steps=5), clearance=options.clearance),
        max_restarts=options.exhaustive,
        library=20000,
    )
    console.print(
        f"{len(clearance.pairs.kept)} pairs of geoms, {1e3 * options.clearance:g} mm asked for"
    )
    rows: list[Figures] = []
    for kind in ("clear", "cluttered"):
        poses = list(targets(arm, clearance, options, clear=kind == "clear"))
        if not poses:
            continue
        results = {}
        for name, solver in solvers(options.clearance).items():
            solver.solve(arm, poses[0], arm.home)
            with Steps(console, len(poses), f"{kind}, {name}", timed=True) as steps:
                results[name] = [solver.solve(arm, pose, arm.home) for pose in steps.over(poses)]
        solvable = []
        with Steps(console, len(poses), f"{kind}, in all ways") as steps:
            for k, pose in enumerate(steps.over(poses)):
                found = any(result[k].converged for result in results.values())
                # A target made from a clear configuration has an answer: that one.
                known = found or kind == "clear"
                solvable.append(known or patient.solve(arm, pose, arm.home).converged)
        rows += [
            _figures(name, kind, poses, result, solvable, judge) for name, result in results.items()
        ]
    _show(rows, console)
    if options.report is not None:
        write_json(options.report, {**made, "rows": [asdict(row) for row in rows]})
    least = [row.least_clearance_mm for row in rows]
    kept = all(one is not None and one >= 1e3 * options.clearance - 0.1 for one in least)
    return 0 if kept and all(row.solved >= 0.995 * row.solvable for row in rows) else 1


def _figures(
    name: str,
    kind: str,
    poses: list[SE3],
    results: list[IkResult],
    solvable: list[bool],
    judge: ContactJudge,
) -> Figures:
    pairs = list(zip(poses, results, solvable, strict=True))
    answers = [result for pose, result, _ in pairs if result.converged]
    solved = sum(judge.accepts(result, pose) for pose, result, _ in pairs if result.converged)
    count = sum(solvable)
    low, high = 0.0, 1.0
    if count:
        share = binomtest(solved, count).proportion_ci(method="wilson")
        low, high = float(share.low), float(share.high)
    ms = [1e3 * result.seconds for _, result, has_answer in pairs if has_answer]
    rest = [1e3 * result.seconds for _, result, has_answer in pairs if not has_answer]
    return Figures(
        solver=name,
        targets=kind,
        n=len(poses),
        solvable=count,
        solved=solved,
        interval=(low, high),
        least_clearance_mm=1e3 * min(judge.clearance(result.q) for result in answers)
        if answers
        else None,
        median_ms=_quantile(ms, 0.5),
        p95_ms=_quantile(ms, 0.95),
        p99_ms=_quantile(ms, 0.99),
        unsolvable_median_ms=_quantile(rest, 0.5),
    )


def _quantile(values: list[float], share: float) -> float | None:
    """Return a quantile; None of nothing."""
    return float(np.quantile(values, share)) if values else None


def _told(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _show(rows: list[Figures], console: Console) -> None:
    texts = ("solver", "targets")
    numbers = ("solved", "of", "95 % from", "least mm", "median ms", "p95", "p99", "none")
    table = FiguresTable((*texts, *numbers), texts=texts)
    for row in rows:
        table.add_row(
            row.solver,
            row.targets,
            str(row.solved),
            str(row.solvable),
            f"{100 * row.interval[0]:.2f} %",
            _told(row.least_clearance_mm, 3),
            *(_told(value, 2) for value in (row.median_ms, row.p95_ms, row.p99_ms)),
            _told(row.unsolvable_median_ms, 1),
        )
    console.print(table)


if __name__ == "__main__":
    sys.exit(main(CollisionIkOptions, run, __doc__))
