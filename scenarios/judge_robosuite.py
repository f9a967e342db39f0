"""robosuite judges: its tasks, done by the programs of scenarios/judges/suite, on seeds of its own.

A policy server answers clients that run robosuite in the environment which `make judges` sets up.
Success is robosuite's own verdict half a second after a program has ended, not at its best step.
"""

import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from robo47_qp.report.importing import importing

with importing():
    from rich.console import Console

    from robo47_qp.arrays import Checked, Count, CountOrZero
    from robo47_qp.cli import FAILED, LOGS, OK, main
    from robo47_qp.errors import InvalidValueError, Robo47Error, UnknownNameError
    from robo47_qp.evaluation.statistics import wilson
    from robo47_qp.files import check_writable, read_json, write_json
    from robo47_qp.report.figures_table import FiguresTable
    from robo47_qp.report.provenance import provenance
    from robo47_qp.report.terminal import print_files
    from scenarios.judges.suite.programs import PROGRAMS

ROOT = Path(__file__).resolve().parents[1]
JUDGE = ROOT / ".judges" / "robosuite" / "bin" / "python"
PROGRAMS_FILE = ROOT / "scenarios" / "judges" / "suite" / "programs.py"
CLIENT = "scenarios.judges.suite.client"
NOISY = tuple(task for task in PROGRAMS if task != "Wipe")
"""Tasks that are also done with noise on the poses."""
_ENDING = 10.0
"""Time that a process has to end [s]."""


class JudgeError(Robo47Error):
    """A client of the judge, or the server, that ended before its work."""


@dataclass(frozen=True, kw_only=True)
class JudgeOptions(Checked):
    """Options of the judgement."""

    tasks: tuple[str, ...] = ()
    """Tasks by robosuite's names; all that there are programs for if none is named."""
    episodes: Count = 100
    """Episodes of each task."""
    seed: CountOrZero = 80_000
    """Seed of the first episode."""
    true_poses: bool = True
    """With the poses as they are."""
    noise: bool = True
    """Also with 2 mm and 2 degrees of noise on the poses, which is drawn once in an episode."""
    workers: Count = 1
    """Clients at once."""
    report: Path = LOGS / "judge_robosuite.json"
    """File for the figures (JSON)."""
    resume: bool = False
    """Keep what the report has of other tasks, and of these what is of the same commit and seeds;
    every row tells its own."""

    def __post_init__(self) -> None:
        """Check every option.

        Raises:
            InvalidValueError: A number is out of range, or robosuite is not here.
            UnknownNameError: There is no program for a task.
        """
        super().__post_init__()
        for task in self.tasks:
            if task not in PROGRAMS:
                raise UnknownNameError("task", task, PROGRAMS)
        if not self.asked:
            raise InvalidValueError("poses", "none of these tasks", "true, noisy, or both")
        if not JUDGE.exists():
            raise InvalidValueError("robosuite", "no .judges/robosuite", "there: make judges")

    @property
    def asked(self) -> list[tuple[str, bool]]:
        """What is judged: tasks, and whether with noise; those without noise first."""
        tasks = self.tasks or PROGRAMS
        noisy = [(task, True) for task in tasks if self.noise and task in NOISY]
        return [(task, False) for task in tasks if self.true_poses] + noisy

    def _label(self, field: str) -> str:
        return f"--{field}"


def run(options: JudgeOptions, console: Console) -> int:
    """Run all episodes, print the table, write figures; return 0 unless an episode broke down."""
    check_writable(options.report)
    made = provenance()
    asked = options.asked
    mine = {"commit": made["commit"], "seeds": seeds(options)}
    rows, failures = finished(options, made, asked)
    done = {(row["task"], row["noise"]) for row in rows}
    with served() as address:
        for task, noisy in asked:
            if (task, noisy) in done:
                continue
            lines = list(episodes(address, task, options, noisy=noisy))
            row = {**summary(task, lines, noisy=noisy), **mine}
            rows.append(row)
            rows.sort(key=lambda row: (row["noise"], list(PROGRAMS).index(row["task"])))
            failures += [line for line in lines if not line["success"]]
            console.print(f"{task}{' with noise' if noisy else ''}: {_words(row)}")
            # After each task: a long judgement that is stopped leaves what it has.
            write_json(options.report, {**made, "rows": rows, "failures": failures})
    table = FiguresTable(("task", "noise", "succeeded", "errors", "median s"), texts=("task",))
    for row in rows:
        noise = "2 mm, 2°" if row["noise"] else "–"
        seconds = "–" if row["seconds"] is None else f"{row['seconds']:.1f}"
        succeeded = f"{row['successes']} of {row['judged']}"
        table.add_row(row["task"], noise, succeeded, str(row["errors"]), seconds)
    console.print(table)
    print_files(console, {"report": options.report})
    return FAILED if any(row["errors"] for row in rows) else OK


def finished(
    options: JudgeOptions, made: Mapping[str, Any], asked: Sequence[tuple[str, bool]]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The rows to keep of a report, and their failures.

    A row that is asked for is judged again if it has errors or is of another commit or seeds.

    Raises:
        InvalidValueError: There are changes of files that no commit has, here or in the report.
    """
    if not options.resume or not options.report.exists():
        return [], []
    kept = read_json(options.report, "Judge without --resume.")
    if not {"changed", "rows", "failures"} <= set(kept):
        must = "a report of this scenario; judge without --resume"
        raise InvalidValueError("--resume", str(options.report), must)
    if kept["changed"] or made["changed"]:
        must = "made by a commit, as this one, without changes of files"
        raise InvalidValueError("--resume", str(options.report), must)
    rows = []
    for row in kept["rows"]:
        mine = {"commit": made["commit"], "seeds": seeds(options), "errors": 0}
        if (row["task"], row["noise"]) not in asked or row | mine == row:
            rows.append(row)
    those = {(row["task"], row["noise"]) for row in rows}
    failures = [one for one in kept["failures"] if (one["task"], one["noisy"]) in those]
    return rows, failures


def seeds(options: JudgeOptions) -> list[int]:
    """The first and the last seed."""
    return [options.seed, options.seed + options.episodes - 1]


@contextmanager
def served() -> Iterator[str]:
    """The address of a server with the programs.

    Raises:
        JudgeError: It ended before it could be reached.
    """
    command = ["-m", "robo47_qp", "serve-policy", "--port", "0"]
    policy = ["--policy", f"{PROGRAMS_FILE}:Programs"]
    with subprocess.Popen(
        [sys.executable, *command, *policy], stdout=subprocess.PIPE, text=True, cwd=ROOT
    ) as server:
        try:
            line = "" if server.stdout is None else server.stdout.readline()
            if " at ws://" not in line:
                raise JudgeError("The policy server must serve; it ended before it did.")
            yield line.split(" at ")[1].split(";")[0]
        finally:
            server.terminate()
            server.wait(_ENDING)


def episodes(
    address: str, task: str, options: JudgeOptions, *, noisy: bool
) -> Iterator[dict[str, Any]]:
    """What the clients tell of each episode, by the seed.

    Raises:
        JudgeError: A client ended before its work.
    """
    shares = [len(range(i, options.episodes, options.workers)) for i in range(options.workers)]
    seed, clients = options.seed, []
    for share in shares:
        if share:
            command = [str(JUDGE), "-m", CLIENT, address, "--task", task, "--seed", str(seed)]
            command += ["--episodes", str(share), *(["--noise"] if noisy else [])]
            clients.append((share, _started(command)))
            seed += share
    try:
        for share, client in clients:
            text, errors = client.communicate()
            lines = [json.loads(line) for line in text.splitlines()]
            if len(lines) < share:
                last = errors.strip().splitlines()[-1:] or ["it said nothing"]
                raise JudgeError(f"The client must do {share} episodes of {task}; {last[0]}")
            yield from lines
    finally:
        for _, client in clients:
            client.terminate()
            client.wait(_ENDING)


def _started(command: Sequence[str]) -> "subprocess.Popen[str]":
    pipe = subprocess.PIPE
    # Its matrices are small: more threads would only wait for each other.
    env = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, cwd=ROOT, env=env)


def summary(task: str, lines: Sequence[dict[str, Any]], *, noisy: bool) -> dict[str, Any]:
    """What a table tells of the episodes of a task; those that broke down do not count."""
    judged = [line for line in lines if "error" not in line]
    won = [line for line in judged if line["success"]]
    causes = Counter(line["cause"].partition(":")[0] for line in judged if not line["success"])
    return {
        "task": task,
        "noise": noisy,
        "judged": len(judged),
        "successes": len(won),
        "interval": list(wilson(len(won), len(judged))) if judged else [0.0, 1.0],
        "causes": dict(causes.most_common()),
        "errors": len(lines) - len(judged),
        "seconds": median(line["seconds"] for line in won) if won else None,
        "speed": max((line["speed"] for line in judged), default=None),
        "saturated": median(line["saturated"] for line in judged) if judged else None,
    }


def _words(row: dict[str, Any]) -> str:
    return f"{row['successes']} of {row['judged']}"


if __name__ == "__main__":
    sys.exit(main(JudgeOptions, run, __doc__))
