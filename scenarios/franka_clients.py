"""Clients of libfranka alone pick a cube in our world: pylibfranka and franky, unmodified.

Each episode has a server in lock-step and a client in a process of the environment that `make
judges` makes. The client is told where cube and goal are; the task judges when it has left.
"""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robo47_qp.report.importing import importing

with importing():
    import numpy as np
    from mink import SE3
    from rich.console import Console

    from robo47_qp.arrays import CheckedOptions, Count, CountOrZero
    from robo47_qp.cli import FAILED, LOGS, OK, main
    from robo47_qp.errors import InvalidValueError, Robo47Error, UnknownNameError
    from robo47_qp.files import check_writable, write_json
    from robo47_qp.model.robots import load_robot
    from robo47_qp.report.figures_table import FiguresTable
    from robo47_qp.report.provenance import provenance
    from robo47_qp.report.terminal import print_files
    from robo47_qp.run.start import checked_start
    from robo47_qp.tasks.goal import marked_goal
    from robo47_qp.tasks.pick_place.pick_place import PickPlace

ROOT = Path(__file__).resolve().parents[1]
JUDGE = ROOT / ".judges" / "franka" / "bin" / "python"
CLIENTS = {
    "pylibfranka": "scenarios.judges.franka_pick",
    "franky": "scenarios.judges.franky_pick",
}
COMMAND = ("robo47_qp", "serve-franka", "--task", "pick_place", "--lock-step")
_LONGEST = 600.0
"""Time that an episode may take [s]."""


class ServerError(Robo47Error):
    """A server that ended before it served."""


@dataclass(frozen=True, kw_only=True)
class ClientOptions(CheckedOptions):
    """Options of the episodes."""

    clients: tuple[str, ...] = tuple(CLIENTS)
    """Libraries whose scripts pick."""
    episodes: Count = 20
    """Episodes of each client."""
    seed: CountOrZero = 80_000
    """Seed of the first episode's places of cube and goal."""
    host: str = "127.0.0.1"
    """Address of this machine at which the world is served."""
    report: Path = LOGS / "franka_clients.json"
    """File for the figures (JSON)."""

    def __post_init__(self) -> None:
        """Check every option.

        Raises:
            InvalidValueError: A number is out of range, or the clients are not here.
            UnknownNameError: There is no such client.
        """
        super().__post_init__()
        for client in self.clients:
            if client not in CLIENTS:
                raise UnknownNameError("client", client, CLIENTS)
        if not JUDGE.exists():
            raise InvalidValueError("clients", "no .judges/franka", "there: make judges")


def run(options: ClientOptions, console: Console) -> int:
    """Run all episodes, print the table, write figures; return 0 if all picked and placed."""
    check_writable(options.report)
    seeds = [options.seed, options.seed + options.episodes - 1]
    told, rows = {**provenance(), "seeds": seeds}, list[dict[str, Any]]()
    for client in options.clients:
        failures = list[dict[str, Any]]()
        rows.append({"client": client, "done": 0, "episodes": 0, "failures": failures})
        for seed in range(options.seed, options.seed + options.episodes):
            failure = episode(client, seed, options.host)
            rows[-1]["episodes"] += 1
            rows[-1]["done"] += failure is None
            if failure is not None:
                failures.append({"seed": seed, "told": failure})
                console.print(f"{client}, seed {seed}: {failure}", highlight=False, soft_wrap=True)
            # After every episode: an interruption loses none.
            write_json(options.report, {**told, "rows": rows})
    table = FiguresTable(("client", "picked and placed"), texts=("client",))
    for row in rows:
        table.add_row(row["client"], f"{row['done']} of {row['episodes']}")
    console.print(table)
    print_files(console, {"report": options.report})
    return FAILED if any(row["failures"] for row in rows) else OK


def episode(client: str, seed: int, host: str) -> str | None:
    """Let a client pick and place; return why it does not count as done, or None."""
    pick, place = places(seed)
    with served(host, "--once", "--seed", str(seed)) as server:
        try:
            told = subprocess.run(
                [JUDGE, "-m", CLIENTS[client], "--host", host, "--pick", *pick, "--place", *place],
                cwd=ROOT,
                capture_output=True,
                text=True,
                timeout=_LONGEST,
                check=False,
            )
            verdict, _ = server.communicate(timeout=_LONGEST)
        except subprocess.TimeoutExpired as error:
            late = "client" if error.cmd[0] == JUDGE else "server"
            return f"the {late} did not end within {_LONGEST:.0f} s"
    if told.returncode:
        return " ".join((told.stdout + told.stderr).split())[-500:]
    return " ".join(verdict.split()) if server.returncode else None


@contextmanager
def served(host: str, *options: str) -> Iterator["subprocess.Popen[str]"]:
    """A server of pick_place in lock-step that is ready; it ends with the context.

    Raises:
        ServerError: It ended before.
    """
    with subprocess.Popen(
        [sys.executable, "-u", "-m", *COMMAND, "--host", host, *options],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    ) as server:
        try:
            if server.stdout is None or not server.stdout.readline():
                raise ServerError("serve-franka must serve; it ended before it did.")
            yield server
        finally:
            server.terminate()


def places(seed: int) -> tuple[list[str], list[str]]:
    """Where cube and goal of an episode are: x, y [m] and heading [rad], as arguments."""
    task = PickPlace()
    simulation = checked_start(task, load_robot("fr3"), seed)
    cube, goal = simulation.object_pose(task.item.name), marked_goal(simulation)
    return _arguments(cube), _arguments(goal)


def _arguments(pose: SE3) -> list[str]:
    x, y, _ = pose.translation()
    R = pose.rotation().as_matrix()
    return [f"{value:.9f}" for value in (x, y, np.arctan2(R[1, 0], R[0, 0]))]


if __name__ == "__main__":
    sys.exit(main(ClientOptions, run, __doc__))
