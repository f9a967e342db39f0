"""Grasps about the vertical: what a free axis of the tool is worth, for the QP and for DLS.

The tool points straight down, turned by any angle. Demanded is the whole pose (fixed axis), or the
position and the direction (free axis). Judged are the answers: errors by forward kinematics, and
joint limits.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any, Literal

from robo47_qp.report.importing import importing

with importing():
    import numpy as np
    from mink import SE3, SO3
    from numpy.typing import NDArray
    from rich.console import Console
    from rich.table import Table

    from robo47_qp.arrays import Checked, Count, CountOrZero, Matrix
    from robo47_qp.cli import FAILED, LOGS, OK, main
    from robo47_qp.errors import InvalidValueError, UnknownNameError
    from robo47_qp.evaluation.benchmarks.ik.workspace import find_reach
    from robo47_qp.evaluation.statistics import mcnemar, paired_difference, wilson
    from robo47_qp.files import check_writable, write_json
    from robo47_qp.ik.dls import TUNED
    from robo47_qp.ik.gauss_newton import Stall
    from robo47_qp.ik.lm import LmIk
    from robo47_qp.ik.mink import MinkIk
    from robo47_qp.ik.multistart import MultiStart
    from robo47_qp.ik.solver import IkSolver, Tolerance
    from robo47_qp.ik.tool_demand import FULL, FreeAxis, ToolDemand
    from robo47_qp.model.arm import Arm
    from robo47_qp.model.robots import load_robot
    from robo47_qp.motion.waypoint import tool_down
    from robo47_qp.report.provenance import provenance

_YAWS = 24
"""Angles about the vertical that are tried one by one where the free axis fails."""
_TIGHT = 1.001e-6
"""Error of a tight answer [m] and [rad]."""
_BOXES = {
    "tabletop": ((0.35, 0.75), (-0.45, 0.45), (0.02, 0.4)),
    "wide": ((0.3, 0.95), (-0.8, 0.8), (0.02, 0.6)),
}
"""Ranges of x, y and z as parts of the arm's reach; z of the tabletop begins 20 mm up."""
SOLVERS: dict[str, Callable[[Tolerance], IkSolver]] = {
    "mink": lambda t: MultiStart(solver=MinkIk(max_iterations=30, stall=Stall(), tolerance=t)),
    "lm": lambda t: MultiStart(solver=LmIk(max_iterations=30, stall=Stall(), tolerance=t)),
    "dls": lambda t: MultiStart(solver=replace(TUNED, max_iterations=30, tolerance=t)),
    "mink-single": lambda t: MinkIk(max_iterations=200, tolerance=t),
    "lm-single": lambda t: LmIk(max_iterations=200, tolerance=t),
    "dls-single": lambda t: replace(TUNED, tolerance=t),
    "dls-free-single": lambda t: replace(TUNED, tolerance=t, clip=False, wrap=True),
}
"""Restarted, as often as `MultiStart` does, and from home alone; DLS is clamped to the joint limits
or, free, has its angles wrapped at the end."""


@dataclass(frozen=True, kw_only=True)
class FreeAxisOptions(Checked):
    """Options of the comparison."""

    robot: str = "panda"
    """Robot whose inverse kinematics is solved."""
    n: Count = 1000
    """Targets."""
    seed: CountOrZero = 0
    """Seed of the targets."""
    box: Literal["tabletop", "wide"] = "wide"
    """Where the targets are: over the middle of a table, all of it within reach, or to the edge of
    the reach, where the fixed axis does not reach everything."""
    solvers: tuple[str, ...] = ("lm", "lm-single", "dls-single", "dls-free-single")
    """Solvers: mink, lm, dls, mink-single, lm-single, dls-single, dls-free-single."""
    report: Path = LOGS / "free_axis.json"
    """File for the figures (JSON)."""

    def _label(self, field: str) -> str:
        return f"--{field}"


def run(options: FreeAxisOptions, console: Console) -> int:
    """Compare; return 0 if the first solver reaches all that any of them does, and all tight."""
    check_writable(options.report)
    made = provenance()
    unknown = [name for name in options.solvers if name not in SOLVERS]
    if unknown:
        raise UnknownNameError("solver", unknown[0], SOLVERS)
    if not options.solvers:
        raise InvalidValueError("--solvers", "none", f"one at least of {', '.join(SOLVERS)}")
    arm = Arm(load_robot(options.robot))
    targets = drawn(arm, options)
    figures, tight = dict[str, dict[str, Any]](), dict[str, NDArray[np.bool_]]()
    for name in options.solvers:
        for axis, demand in (("fixed", FULL), ("free", FreeAxis())):
            solver = SOLVERS[name](Tolerance(demand=demand))
            key = f"{name}, {axis} axis"
            figures[key], tight[key] = measured(arm, solver, demand, targets)
    first = f"{options.solvers[0]}, free axis"
    known = np.logical_or.reduce([*tight.values()])
    missed = int((known & ~tight[first]).sum())
    search = MultiStart(
        solver=LmIk(max_iterations=30, stall=Stall()), max_restarts=10, seed_first=False
    )
    by_yaw = sum(_any_yaw(search, arm, targets[i]) for i in np.flatnonzero(~known).tolist())
    console.print(_table(figures))
    effects = [_effect(tight, f"{n}, fixed axis", f"{n}, free axis") for n in options.solvers]
    for one in effects:
        low, high = one["interval"]
        points = f"{one['points']:+.2f} points ({low:+.2f} to {high:+.2f})"
        console.print(f"{one['to']} against fixed: {points}", highlight=False, soft_wrap=True)
    reachable = int(known.sum()) + by_yaw
    console.print(
        f"{first}: tight on {reachable - missed - by_yaw} of {reachable} that are known to be "
        f"reachable ({missed} by another row, {by_yaw} only by trying {_YAWS} angles)",
        highlight=False,
        soft_wrap=True,
    )
    chosen = {name: getattr(options, name) for name in ("robot", "n", "seed", "box")}
    write_json(
        options.report,
        {
            **made,
            **chosen,
            "figures": figures,
            "effects": effects,
            "known_to_be_reachable": reachable,
            "missed_by_the_first": missed + by_yaw,
        },
    )
    console.print(f"{options.report}", soft_wrap=True)
    return OK if missed + by_yaw == 0 else FAILED


def drawn(arm: Arm, options: FreeAxisOptions) -> list[SE3]:
    """Return the targets: uniform in the box, the tool down, turned by any angle."""
    rng, reach = np.random.default_rng(options.seed), find_reach(arm).across
    foot = arm.model.body(int(arm.model.body_rootid[arm.model.jnt_bodyid[0]])).pos
    low, high = reach * np.array(_BOXES[options.box]).T
    positions: Matrix = foot + rng.uniform(low, high, (options.n, 3))
    yaws = rng.uniform(-np.pi, np.pi, options.n)
    return [tool_down(p, float(yaw)) for p, yaw in zip(positions, yaws, strict=True)]


def measured(
    arm: Arm, solver: IkSolver, demand: ToolDemand, targets: list[SE3]
) -> tuple[dict[str, Any], NDArray[np.bool_]]:
    """Return the figures of a solver, and which targets it reached tight and within limits."""
    reached = outside = 0
    tight, worst, spent = np.zeros(len(targets), dtype=np.bool_), 0.0, list[float]()
    for i, target in enumerate(targets):
        started = process_time()
        found = solver.solve(arm, target, arm.home)
        spent.append(1e3 * (process_time() - started))
        error = _error(arm, target, found.q, whole=demand == FULL)
        inside = bool(((found.q >= arm.q_min) & (found.q <= arm.q_max)).all())
        outside += not inside
        reached += found.converged
        if found.converged:
            worst = max(worst, error)
        tight[i] = found.converged and inside and error <= _TIGHT
    figures = {
        "reached": reached,
        "tight": int(tight.sum()),
        "of": len(targets),
        "interval": list(wilson(reached, len(targets))),
        "worst_error": worst,
        "outside_limits": outside,
        "median_ms": float(np.median(spent)),
        "p99_ms": float(np.percentile(spent, 99.0)),
    }
    return figures, tight


def _effect(tight: dict[str, NDArray[np.bool_]], a: str, b: str) -> dict[str, Any]:
    better, worse, p = mcnemar(tight[b], tight[a])
    n = len(tight[a])
    interval = [100.0 * end for end in paired_difference(better, worse, n)]
    return {
        "from": a,
        "to": b,
        "points": 100.0 * (better - worse) / n,
        "interval": interval,
        "p": p,
    }


def _table(figures: dict[str, dict[str, Any]]) -> Table:
    table = Table(box=None, header_style="")
    table.add_column("solver")
    for name in ("reached", "tight", "share", "outside limits", "median ms", "p99 ms"):
        table.add_column(name, justify="right")
    for name, one in figures.items():
        share = f"{100 * one['tight'] / one['of']:.2f} %"
        counts = [str(one[key]) for key in ("reached", "tight")]
        times = [f"{one[key]:.2f}" for key in ("median_ms", "p99_ms")]
        table.add_row(name, *counts, share, str(one["outside_limits"]), *times)
    return table


def _error(arm: Arm, target: SE3, q: np.ndarray, *, whole: bool) -> float:
    """Return the larger error of position [m], and of direction or orientation [rad]."""
    pose = arm.pose(q)
    away = np.linalg.norm(pose.translation() - target.translation())
    if whole:
        return max(float(away), arm.pose_distance(target, q)[1])
    axis = pose.rotation().as_matrix()[:, 2]
    lean = float(np.arccos(np.clip(-axis[2], -1.0, 1.0)))
    # Near none the sine has the digits that the cosine lacks.
    return max(float(away), float(np.hypot(axis[0], axis[1])) if lean < 0.1 else lean)


def _any_yaw(ik: MultiStart, arm: Arm, target: SE3) -> bool:
    """Return whether the pose is reached with any of many angles about the vertical."""
    if arm.target_beyond_reach(target) > 0.0:
        return False
    turns = np.linspace(0.0, 2.0 * np.pi, _YAWS, endpoint=False)
    poses = (target @ SE3.from_rotation(SO3.from_z_radians(float(turn))) for turn in turns)
    return any(ik.solve(arm, pose, arm.home).converged for pose in poses)


if __name__ == "__main__":
    sys.exit(main(FreeAxisOptions, run, __doc__ or ""))
