"""DLS against the QP at 1 kHz: one arm and two, on paired targets, with limits and clearances.

Both get the same targets, the same reference velocity, the same box of joint limits and the same
measured distances. The QP has clearances as constraints, DLS repels in its null space; what does
not fit the box is scaled ("dls") or clamped joint by joint ("dls-clip"). Judged are the commands:
limits by differences of positions, clearances by MuJoCo's contacts.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robo47_qp.report.importing import importing

with importing():
    import numpy as np
    from mink import SE3
    from rich.console import Console

    from robo47_qp.arrays import Checked, Count, CountOrZero
    from robo47_qp.cli import LOGS, OK, main
    from robo47_qp.evaluation.benchmarks.ik.dls_stream import DlsStream
    from robo47_qp.evaluation.benchmarks.ik.hostile_targets import DT, pair_targets, targets
    from robo47_qp.evaluation.benchmarks.ik.stream_audit import audit, clearance_audit
    from robo47_qp.files import check_writable, write_json
    from robo47_qp.model.arm import Arm
    from robo47_qp.report.figures_table import FiguresTable
    from robo47_qp.report.provenance import provenance
    from robo47_qp.report.terminal import print_files
    from scenarios.stream_ik import StreamOptions


@dataclass(frozen=True, kw_only=True)
class CompareOptions(Checked):
    """Options of this scenario."""

    ticks: Count = 10_000
    """Ticks of each stream on each kind of targets."""
    seed: CountOrZero = 0
    """Draw the targets from this seed."""
    report: Path = LOGS / "streams.json"
    """File for the figures (JSON)."""

    def _label(self, field: str) -> str:
        return f"--{field}"


def run(options: CompareOptions, console: Console) -> int:
    """Run both on all targets, print the table, write the figures."""
    check_writable(options.report)
    made = provenance()
    texts = ("arms", "targets", "stream")
    numbers = ("error mm", "p95", "q v a", "too close", "lacking mm", "relaxed")
    table = FiguresTable((*texts, *numbers), texts=texts)
    figures: list[dict[str, Any]] = []
    for robot in ("panda", "panda_pair"):
        chosen = StreamOptions(robot=robot)
        arm = chosen.arm()
        for kind in ("gentle", "hostile"):
            for stream in ("qp", "dls", "dls-clip"):
                one = measured(arm, chosen, stream, kind, options)
                figures.append({"robot": robot, "targets": kind, "stream": stream, **one})
                table.add_row(
                    str(len(arm.robot.tools)),
                    kind,
                    stream,
                    f"{one['error_median_mm']:.2f}",
                    f"{one['error_p95_mm']:.1f}",
                    str(one["limit_violations"]),
                    str(one["clearance_violations"]),
                    f"{one['clearance_lacking_mm']:.1f}",
                    "-" if one["relaxed"] is None else str(one["relaxed"]),
                )
    console.print(table)
    write_json(
        options.report,
        {**made, "ticks": options.ticks, "seed": options.seed, "figures": figures},
    )
    print_files(console, {"report": options.report})
    return OK


def measured(
    arm: Arm, chosen: StreamOptions, stream: str, kind: str, options: CompareOptions
) -> dict[str, Any]:
    """Return the figures of one stream on targets that are the same for both."""
    rng, count = np.random.default_rng(options.seed), options.ticks
    given = gentle(arm, rng) if kind == "gentle" else _hostile(arm, rng)
    q, v, a = (np.empty((count, arm.n)) for _ in range(3))
    errors = np.empty(count)
    relaxed: int | None = None
    if stream == "qp":
        solver = chosen.settings().build(arm)
        for k, target in zip(range(count), given, strict=False):
            tick = solver.tick(target)
            q[k], v[k], a[k], errors[k] = tick.q, tick.v, tick.a, tick.position_error
        counts = {event.name: n for event, n in solver.counts.items()}
        relaxed = counts["CLEARANCE_RELAXED"]
    else:
        clamped = stream == "dls-clip"
        rival = DlsStream(settings=chosen.settings(), clamped=clamped).build(arm)
        for k, target in zip(range(count), given, strict=False):
            q[k], v[k], a[k], errors[k] = rival.tick(target)
    profile = chosen.settings().profile or arm.robot.profile
    found = audit(arm, profile, DT, arm.home, q, v, a)
    near = clearance_audit(arm.robot, arm.obstacles, q, chosen.clearance)
    return {
        "error_median_mm": 1e3 * float(np.nanmedian(errors)),
        "error_p95_mm": 1e3 * float(np.nanpercentile(errors, 95)),
        "limit_violations": sum(int(found[f"{name}_violations"]) for name in "qva"),
        **near,
        "relaxed": relaxed,
    }


def gentle(arm: Arm, rng: np.random.Generator) -> Iterator[object]:
    """Endless: each tool glides through space, 0.3 m around where it is at home, at 0.2 m/s."""
    names = [tool.name for tool in arm.robot.tools]
    homes = [arm.pose(arm.home, i) for i in range(len(names))]
    phases = rng.uniform(0.0, 2.0 * np.pi, (len(names), 3))
    k = 0
    while True:
        t, poses = k * DT, {}
        for name, home, phase in zip(names, homes, phases, strict=True):
            fade = 1.0 - np.exp(-t)
            away = 0.3 * fade * np.sin(np.array([0.31, 0.43, 0.37]) * 2.0 * t + phase)
            poses[name] = SE3.from_translation(away) @ home
        yield poses if len(names) > 1 else poses[names[0]]
        k += 1


def _hostile(arm: Arm, rng: np.random.Generator) -> Iterator[object]:
    return targets(arm, rng) if len(arm.robot.tools) == 1 else pair_targets(arm, rng)


if __name__ == "__main__":
    sys.exit(main(CompareOptions, run, __doc__))
