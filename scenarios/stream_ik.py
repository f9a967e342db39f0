"""Differential IK at 1 kHz among obstacles, with targets that jump, are out of reach or invalid."""

import gc
import hashlib
import json
import sys
from dataclasses import dataclass
from math import isnan
from time import process_time_ns
from typing import Annotated, Any, Literal

from robo47_qp.report.importing import importing

with importing():
    import numpy as np
    from rich.console import Console

    from robo47_qp.arrays import Checked, Count, CountOrZero, Range
    from robo47_qp.cli import FAILED, OK, main
    from robo47_qp.collision.clearance import Clearance
    from robo47_qp.evaluation.benchmarks.ik.hostile_targets import (
        DT,
        OBSTACLES,
        PAIR_OBSTACLES,
        circling,
        pair_targets,
        targets,
    )
    from robo47_qp.evaluation.benchmarks.ik.stream_audit import audit, clearance_audit
    from robo47_qp.ik.stream.stream import StreamIk, StreamSolver
    from robo47_qp.model.arm import Arm
    from robo47_qp.model.robots import load_robot
    from robo47_qp.report.figures_table import FiguresTable
    from robo47_qp.report.progress import Steps

WARM_UP = 200
"""Ticks before the first one that is timed."""


@dataclass(frozen=True, kw_only=True)
class StreamOptions(Checked):
    """Options of this scenario."""

    robot: Literal["panda", "panda_pair"] = "panda"
    """One arm, or two at one table, which are told targets against each other."""
    ticks: Count = 100_000
    """Ticks on hostile targets."""
    far: CountOrZero = 50
    """Number of static targets within reach, each approached from home; 0 for none."""
    seed: CountOrZero = 0
    """Draw the targets from this seed."""
    limits: Literal["rated", "profile"] = "rated"
    """Joint limits to use: the manufacturer's, or the slower ones of the robot's profile."""
    clearance: Annotated[float, Range(at_least=0.0, at_most=0.05)] = 0.02
    """Distance to keep between links and from obstacles [m]."""
    json: bool = False
    """Print the figures as JSON on the standard output and nothing else."""

    def _label(self, field: str) -> str:
        return f"--{field}"

    def arm(self) -> Arm:
        obstacles = OBSTACLES if self.robot == "panda" else PAIR_OBSTACLES
        return Arm(load_robot(self.robot), obstacles=obstacles)

    def settings(self) -> StreamIk:
        robot = load_robot(self.robot)
        profile = robot.rated if self.limits == "rated" else robot.profile
        return StreamIk(dt=DT, profile=profile, clearance=self.clearance)


def run(options: StreamOptions, console: Console) -> int:
    """Run, audit and print; return the exit code, 0 if no limit was violated."""
    arm = options.arm()
    stream = options.settings().build(arm)
    figures: dict[str, Any] = {
        "ticks": options.ticks,
        "seed": options.seed,
        "pairs": len(arm.derived(Clearance, options.clearance).pairs.kept),
    }
    rng = np.random.default_rng(options.seed)
    with Steps(console, options.ticks, "ticks", timed=True) as steps:
        figures |= hostile_run(stream, options, rng, steps)
    figures |= circle(options.settings().build(arm), speed=0.2, radius=0.1)
    figures |= far_targets(options.settings().build(arm), options, rng)
    figures["limits"] = options.limits
    if options.json:
        told = {
            name: None if _is_real(value) and isnan(value) else value
            for name, value in figures.items()
        }
        sys.stdout.write(json.dumps(told, indent=2, allow_nan=False) + "\n")
    else:
        table = FiguresTable(("what", "figure"), texts=("what",))
        for name, value in figures.items():
            table.add_row(name.replace("_", " "), f"{value:.4g}" if _is_real(value) else str(value))
        console.print(table)
    violated = sum(figures[f"{name}_violations"] for name in ("q", "v", "a", "clearance"))
    return OK if violated == 0 else FAILED


def hostile_run(
    stream: StreamSolver, options: StreamOptions, rng: np.random.Generator, steps: Steps
) -> dict[str, Any]:
    """Return the audit of the commands, and the times of the ticks, on hostile targets."""
    arm, q0, ticks = stream.arm, stream.q, options.ticks
    q, v, a = (np.empty((ticks, arm.n)) for _ in range(3))
    spent, rows = np.empty(ticks), np.empty(ticks)
    gc.collect()
    gc.disable()
    hostile = targets(arm, rng) if len(arm.robot.tools) == 1 else pair_targets(arm, rng)
    for k, target in zip(range(ticks), hostile, strict=False):
        started = process_time_ns()
        tick = stream.tick(target)
        spent[k] = process_time_ns() - started
        q[k], v[k], a[k], rows[k] = tick.q, tick.v, tick.a, tick.rows
        if k % 2_000 == 0:
            steps.show(k)
        if k % 10_000 == 0:
            gc.collect()
    gc.enable()
    late = 1e-6 * spent[min(WARM_UP, ticks - 1) :]
    counts = {event.name.lower(): count for event, count in stream.counts.items()}
    found = {
        **audit(arm, stream.profile, DT, q0, q, v, a),
        **clearance_audit(arm.robot, arm.obstacles, q, options.clearance),
        "ms_median": float(np.median(late)),
        "ms_p95": float(np.percentile(late, 95)),
        "ms_p99": float(np.percentile(late, 99)),
        "ms_max": float(late.max()),
        "rows_mean": float(rows.mean()),
        "rows_max": int(rows.max()),
        **counts,
        "sha256": hashlib.sha256(q.tobytes() + v.tobytes() + a.tobytes()).hexdigest(),
    }
    return found


def circle(stream: StreamSolver, *, speed: float, radius: float) -> dict[str, Any]:
    """Return the largest error on a circle, from half a second after its start."""
    T = stream.arm.pose(stream.arm.home)
    errors = [stream.tick(target).position_error for target in circling(T, radius, speed, 4000)]
    return {"circle_error_mm": 1e3 * max(errors[500:])}


def far_targets(
    stream: StreamSolver, options: StreamOptions, rng: np.random.Generator
) -> dict[str, Any]:
    """Return how many static targets are reached from home in 8 s, how soon, and the overshoot."""
    arm, clearance = stream.arm, stream.arm.derived(Clearance, options.clearance)
    times, rises, tried = [], [], 0
    while tried < options.far:
        q = arm.drawn(rng)
        if clearance.nearest(q)[0] < options.clearance + stream.settings.buffer:
            continue
        tried += 1
        target = arm.pose(q)
        stream.reset(arm.home)
        errors = []
        for k in range(8000):
            tick = stream.tick(target)
            errors.append(tick.position_error)
            if tick.position_error < 1e-4 and tick.orientation_error < 1e-3:
                times.append(DT * k)
                after = [stream.tick(target).position_error for _ in range(300)]
                rises.append(1e3 * max(after))
                break
    return {
        "far_targets": options.far,
        "far_targets_reached": len(times),
        "far_targets_seconds_median": float(np.median(times)) if times else float("nan"),
        "error_after_arrival_mm": max(rises, default=float("nan")),
    }


def _is_real(value: object) -> bool:
    return isinstance(value, float)


if __name__ == "__main__":
    sys.exit(main(StreamOptions, run, __doc__))
