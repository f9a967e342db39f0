"""Clients of libfranka that know nothing of this package, in the environment of a judge."""

import json
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.model.robots import load_robot
from scenarios import franka_clients
from scenarios.franka_clients import JUDGE, ROOT, ClientOptions, episode, places, run
from tests.franka import served

clients = pytest.mark.skipif(not JUDGE.exists(), reason="no .judges/franka: make judges")


@clients
def test_franky_reads_moves_and_grasps() -> None:
    with served("--task", "pick_place", "--lock-step") as (host, _):
        command = [str(JUDGE), "-m", "scenarios.judges.franky_motions", "--host", host]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    np.testing.assert_allclose(told["home"], load_robot("fr3").home, atol=1e-6)
    assert told["joints"] < 1e-3
    assert told["tool"] < 1e-3
    assert told["turned"] > 0.005
    assert told["controls"]
    assert told["torques"] < 5e-3
    assert told["opened"]
    assert told["width"] == pytest.approx(0.06, abs=1e-3)
    assert not told["grasped"]


def test_clients_are_told_where_cube_and_goal_are() -> None:
    found = [np.array(where, dtype=float) for where in places(84_000)]
    for x, y, heading in found:
        assert 0.35 <= x <= 0.6
        assert abs(y) <= 0.35
        assert abs(heading) <= np.pi
    assert np.linalg.norm(found[1][:2] - found[0][:2]) >= 0.15
    assert places(84_000) != places(84_001)


def test_what_cannot_be_run_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(franka_clients, "JUDGE", tmp_path / "python")
    with pytest.raises(InvalidValueError, match="make judges"):
        ClientOptions()
    with pytest.raises(UnknownNameError, match="pylibfranka"):
        ClientOptions(clients=("ros",))


def test_an_interruption_loses_no_episode(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(franka_clients, "JUDGE", Path(sys.executable))

    def told(client: str, seed: int, host: str) -> str | None:
        if client == "franky" and seed == 84_001:
            raise KeyboardInterrupt
        return "it fell" if client == "franky" else None

    monkeypatch.setattr(franka_clients, "episode", told)
    options = ClientOptions(episodes=2, seed=84_000, report=tmp_path / "report.json")
    with pytest.raises(KeyboardInterrupt):
        run(options, Console(quiet=True))
    assert json.loads(options.report.read_text())["rows"] == [
        {"client": "pylibfranka", "done": 2, "episodes": 2, "failures": []},
        {
            "client": "franky",
            "done": 0,
            "episodes": 1,
            "failures": [{"seed": 84_000, "told": "it fell"}],
        },
    ]


@pytest.mark.parametrize("late", ["client", "server"])
def test_who_does_not_end_fails_the_episode(monkeypatch: pytest.MonkeyPatch, late: str) -> None:
    class Server:
        returncode = 0

        def communicate(self, timeout: float) -> tuple[str, None]:
            raise subprocess.TimeoutExpired(["server"], timeout)

    def client(command: list[str], **_: object) -> "subprocess.CompletedProcess[str]":
        if late == "client":
            raise subprocess.TimeoutExpired(command, 600.0)
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(franka_clients, "served", lambda *_: nullcontext(Server()))
    monkeypatch.setattr(subprocess, "run", client)
    told = episode("franky", 84_000, "127.0.0.1")
    assert told == f"the {late} did not end within 600 s"
