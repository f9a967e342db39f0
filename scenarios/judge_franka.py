"""franka-sim judges: random PTP, LIN and CIRC motions in torque mode, through libfranka.

franka-sim is a libfranka server on MuJoCo, with limits and error names of the robot; it enforces
those of motions and those of communication. It runs in an environment of its own (`make judges`)
and keeps to the clock, so that server and client ask for real-time priority, each on a core. On a
machine that cannot keep to it, its clock can go slower; the client goes by the states alone.
"""

import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robo47_qp.report.importing import importing

with importing():
    import numpy as np
    from numpy.typing import NDArray
    from rich.console import Console

    from robo47_qp.arrays import CheckedOptions, Count, CountOrZero, Matrix, Ratio
    from robo47_qp.cli import ARM_ROWS, FAILED, LOGS, OK, main
    from robo47_qp.errors import ArmStopped, InvalidValueError, Robo47Error
    from robo47_qp.files import check_writable, write_json
    from robo47_qp.model.robots import load_robot
    from robo47_qp.report.figures_table import FiguresTable
    from robo47_qp.report.provenance import provenance
    from robo47_qp.report.terminal import print_files
    from robo47_qp.run.runner import Runner
    from robo47_qp.run.scenario import Run
    from robo47_qp.sim.franka.driven_arm import DrivenArm, driven, uncollected
    from robo47_qp.sim.franka.link import named
    from robo47_qp.stack import ClassicalStack
    from scenarios.judges.franka_motions import RandomMotions
    from scenarios.judges.real_time import own_core

ROOT = Path(__file__).resolve().parents[1]
JUDGE = ROOT / ".judges" / "franka" / "bin" / "python"
SERVER = "scenarios.judges.franka_server"
CORE = 1
"""That of the client, to which libfranka gives priority in motions; the server has another one."""
TRACKING = 2.0
"""Largest error of a joint that is asked for [mrad]."""
_KEYS = {
    "done": "done",
    "rate_min": "success rate, least",
    "rate_median": "median",
    "largest": "largest error mrad",
    "within": "within 2 mrad",
    "rms": "rms mrad",
    "tool": "tool mm",
    "even": "in even time",
    "even_within": "of these within",
    "jump": "longest period ms",
}
"""Columns by the keys of the figures."""
_SIGNALS = ("joints/q", "joints/v", "errors/q", "errors/tool_position", "franka/commands")
_MOVING, _JUMP = 0.1, 2.5e-3
"""Speed of the joints at which time is told by them [rad/s], and a period that is too long [s]."""
_WINDOW = 100
"""Commands of which libfranka's success rate tells: before, a motion has too few [-]."""


class Touched:
    """Keeps rows in memory that the process has already: to get some takes longer than a period."""

    def __init__(self, width: int) -> None:
        self._width = width

    def block(self, rows: int) -> tuple[Matrix, NDArray[np.int64]]:
        """See `Store.block`."""
        block = np.empty((rows, self._width))
        block.fill(0.0)
        return block, np.zeros(1, np.int64)


class JudgeError(Robo47Error):
    """A server that ended before it served."""


@dataclass(frozen=True, kw_only=True)
class JudgeOptions(CheckedOptions):
    """Options of the judgement."""

    motions: Count = 200
    """Motions in all."""
    kinds: tuple[str, ...] = RandomMotions.kinds
    """Kinds of motion, which take turns."""
    connection: Count = 20
    """Motions of one connection; each begins at home."""
    seed: CountOrZero = 80_000
    """Seed of the first connection's motions."""
    speed: Ratio = 1.0
    """Pace of the motions, in (0, 1]."""
    clock: Ratio = 1.0
    """Pace of franka-sim's clock, in (0, 1]: at 0.1, its millisecond takes ten. Below 1, it stands
    still while the machine holds it up; at 1, it is that of the machine."""
    observer: bool = True
    """Estimate the joints' state and compensate what disturbs them."""
    host: str = "127.0.0.1"
    """Address of this machine at which franka-sim serves."""
    report: Path = LOGS / "judge_franka.json"
    """File for the figures (JSON)."""

    def __post_init__(self) -> None:
        """Check every option.

        Raises:
            InvalidValueError: A number is out of range, or franka-sim is not here.
        """
        super().__post_init__()
        if not JUDGE.exists():
            raise InvalidValueError("franka-sim", "no .judges/franka", "there: make judges")


def run(options: JudgeOptions, console: Console) -> int:
    """Make all motions, print the table, write figures; return 0 where there was no reflex."""
    check_writable(options.report)
    made, motions, stops = provenance(), list[dict[str, Any]](), list[str]()
    others, permitted = list[dict[str, Any]](), dict[str, bool]()
    seed, last = options.seed, options.seed + 2 * -(-options.motions // options.connection)
    while len(motions) < options.motions and seed < last:
        # One that a client has left in the middle of a motion answers none after it.
        with served(options.host, options.clock) as told:
            console.print(told)
            permitted = {"server": "real-time" in told, "client": own_core(CORE)}
            stop = ""
            while not stop and len(motions) < options.motions and seed < last:
                count = min(options.connection, options.motions - len(motions))
                now, stop = made_of(options, seed, count)
                motions += now
                largest = _told(summary("", now)["largest"])
                console.print(f"{seed}: {len(now)} motions, errors up to {largest} mrad")
                for worse in tracked_worse(seed, now):
                    console.print(" ".join(f"{k} {v}" for k, v in worse.items()), soft_wrap=True)
                    others.append(worse)
                if stop:
                    stops.append(f"{seed}: {stop}")
                    console.print(stops[-1], highlight=False)
                seed += 1
    rows = [summary(kind, [m for m in motions if m["kind"] == kind]) for kind in options.kinds]
    rows.append(summary("all", motions))
    figures = {
        "asked": options.motions,
        "seeds": [options.seed, seed - 1],
        "pace": options.speed,
        "clock": options.clock,
        "observer": options.observer,
        "real_time": permitted,
        "rows": rows,
        "worse": others,
        "stops": stops,
        "reflexes": sum(named(stop) != "" for stop in stops),
    }
    write_json(options.report, {**made, **figures})
    table = FiguresTable(("motions", *_KEYS.values()), texts=("motions",))
    for row in rows:
        table.add_row(row["kind"], *(_told(row[key]) for key in _KEYS))
    console.print(table)
    print_files(console, {"report": options.report})
    return FAILED if stops or len(motions) < options.motions else OK


@contextmanager
def served(host: str, clock: float) -> Iterator[str]:
    """What franka-sim says when it is ready; its clock goes at a part of its pace.

    Raises:
        JudgeError: It ended before.
    """
    with subprocess.Popen(
        [JUDGE, "-m", SERVER, host, str(clock)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        cwd=ROOT,
    ) as server:
        try:
            line = "" if server.stdout is None else server.stdout.readline()
            if not line:
                raise JudgeError("franka-sim must serve; it ended before it did.")
            yield line.strip()
        finally:
            server.kill()


def made_of(options: JudgeOptions, seed: int, count: int) -> tuple[list[dict[str, Any]], str]:
    """What was measured of a connection's motions, and what stopped them; "" where nothing did."""
    try:
        done = connection(options, seed, count)
    except ArmStopped as stopped:
        return [], str(stopped)
    return measured(done), "" if done.failure is None else done.failure.evidence


def connection(options: JudgeOptions, seed: int, count: int) -> Run:
    """Connect, make some motions, and leave.

    Raises:
        ArmStopped: The robot cannot be reached, or is not ready to move.
    """
    robot = driven(load_robot("fr3"))
    task = RandomMotions(draw=seed, count=count, kinds=options.kinds)
    observer = ClassicalStack.observer if options.observer else None
    stack = ClassicalStack(pace=options.speed, observer=observer)
    arm = DrivenArm(robot, task.build_scene, options.host)
    try:
        with uncollected():
            runner = Runner(stack.scenario(robot, task), arm)
            store = Touched(sum(len(signal.labels) for signal in runner.signals))
            return runner.run(store=store, chunk_rows=ARM_ROWS)
    finally:
        arm.close()


def measured(run: Run) -> list[dict[str, Any]]:
    """What was measured of each motion that was made to its end."""
    found: list[dict[str, Any]] = []
    stopped = run.failure is not None
    for phase, part in run.spans():
        if phase.leg is None or phase.name not in RandomMotions.kinds:
            continue
        if stopped and part.stop == len(run.rows):
            continue
        rows = {name: run.rows[name][part] for name in _SIGNALS}
        errors, (rates, lost) = rows["errors/q"], rows["franka/commands"].T
        row, joint = np.unravel_index(np.abs(errors).argmax(), errors.shape)
        found.append(
            {
                "motion": 1 + len(found),
                "kind": phase.name,
                "rates": rates[_WINDOW:],
                "largest": 1e3 * float(np.abs(errors[row, joint])),
                "joint": 1 + int(joint),
                "at": 1e-3 * int(row),
                "seconds": 1e-3 * len(errors),
                "lost": int(lost[-1] - lost[0]),
                "squares": 1e6 * errors**2,
                "tool": 1e3 * float(rows["errors/tool_position"].max()),
                "jump": jump(rows["joints/q"], rows["joints/v"]),
            }
        )
    return found


def tracked_worse(seed: int, motions: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What is told of each motion of a connection that was tracked worse than is asked for."""
    keys = ("motion", "kind", "largest", "joint", "at", "seconds", "jump", "lost")
    return [
        {"seed": seed} | {key: motion[key] for key in keys}
        for motion in motions
        if motion["largest"] > TRACKING
    ]


def jump(q: Matrix, v: Matrix) -> float:
    """Return the longest time that the arm moved on between two states of a motion [s].

    A server that keeps to the clock simulates while client, server or machine are held up. What
    has passed then is told by how far the joints have gone, where they move.

    Args:
        q: Positions as they were told, in every period (N, n) [rad].
        v: Velocities (N, n) [rad/s].
    """
    mean = 0.5 * (v[1:] + v[:-1])
    squares = (mean**2).sum(axis=1)
    moving = squares > _MOVING**2
    passed = (np.diff(q, axis=0) * mean).sum(axis=1)[moving] / squares[moving]
    return float(passed.max(initial=0.0))


def summary(kind: str, motions: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What a table tells of some motions; errors are those of joints, but the last of the tool."""
    row: dict[str, Any] = {"kind": kind, "done": len(motions)}
    if not motions:
        return row | dict.fromkeys(list(_KEYS)[1:])
    rates = np.concatenate([motion["rates"] for motion in motions])
    squares = np.concatenate([motion["squares"] for motion in motions])
    largest = [motion["largest"] for motion in motions]
    even = [motion for motion in motions if motion["jump"] < _JUMP]
    return row | {
        "rate_min": float(rates.min()),
        "rate_median": float(np.median(rates)),
        "largest": max(largest),
        "within": sum(one <= TRACKING for one in largest),
        "even": len(even),
        "even_within": sum(motion["largest"] <= TRACKING for motion in even),
        "jump": 1e3 * max(motion["jump"] for motion in motions),
        "rms": float(np.sqrt(squares.mean())),
        "tool": max(motion["tool"] for motion in motions),
    }


def _told(number: float | None) -> str:
    return "–" if number is None else f"{number:.3g}"


if __name__ == "__main__":
    sys.exit(main(JudgeOptions, run, __doc__))
