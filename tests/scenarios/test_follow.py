"""Following a target: by a hand path and by keys, recorded; it ends when it is told to."""

import json
import os
import signal
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from mink import SE3
from rich.console import Console

from robo47_qp.arrays import Matrix
from robo47_qp.cli import BAD_INPUT, INTERRUPTED, OK, main
from robo47_qp.collision.clearance import Clearance
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.rerun.reading import read_recording
from robo47_qp.run.observers import Observer
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.teleop.driver import TARGET, TeleopDriver, TeleopSettings
from robo47_qp.run.teleop.hand_path import HandPath, read_hand_path
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.table import TABLE
from scenarios import follow
from scenarios.follow import HAND_PATH, Follow, FollowOptions

QUIET = Console(quiet=True)


class Hand(Observer):
    """Does something at one instant."""

    def __init__(self, at: float, act: object) -> None:
        self._at, self._act = at, act

    def tick(self, simulation: Simulation) -> None:
        if simulation.time >= self._at and self._act is not None:
            self._act()  # type: ignore[operator]
            self._act = None


def ran(driver: TeleopDriver, *hands: Hand, simulation: Simulation | None = None) -> Run:
    world = Simulation(PANDA, Follow().build_scene) if simulation is None else simulation
    scenario = ClassicalStack().scenario(PANDA, Follow())
    runner = Runner(scenario, world, driver, extra=driver.signals)
    return runner.run(observers=hands)


def events(run: Run, name: str) -> int:
    """Ticks with an event."""
    signal = next(s for s in run.rows.signals if s.name == "target/events")
    return int(run.rows["target/events"][:, signal.labels.index(name)].sum())


def nudge(step: Matrix, seconds: float) -> HandPath:
    """From rest to rest."""
    x = np.linspace(0.0, 1.0, 30)
    s = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
    return HandPath(times=seconds * x, displacements=np.outer(s, step), turns=np.zeros((30, 3)))


def test_the_tool_follows_a_hand_path_and_it_is_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "follow.rrd"
    options = FollowOptions(seconds=1.5, path=HAND_PATH, log=file, json=True)
    assert follow.run(options, QUIET) == OK
    told = json.loads(capsys.readouterr().out)
    assert told["success"]
    assert all(finding["ok"] for finding in told["audit"])
    recorded = read_recording(file)
    rows, path = recorded.rows, read_hand_path(HAND_PATH)
    started = next(time for time, phase in recorded.phases if phase == "follow")
    since = np.flatnonzero(rows["time"][:, 0] >= started - 1e-9)
    T_start = SE3(np.roll(rows["target/pose"][0], 4))
    wanted = path.poses(1e-3 * np.arange(1500), T_start)
    pose = rows["target/pose"][since[:1500]]
    np.testing.assert_allclose(pose[:, :3], [p.translation() for p in wanted], atol=1e-9)
    # The arm was there, too: by the simulated tool, not by what was commanded.
    gone = np.linalg.norm(rows["tool/pose"][since[-1], :3] - rows["tool/pose"][since[0], :3])
    assert gone > 0.08
    error = np.linalg.norm(rows["target/pose"][:, :3] - rows["tool/pose"][:, :3], axis=1)
    np.testing.assert_allclose(rows["target/position_error"][:, 0], error, atol=1e-12)
    assert error[since[:1500]].max() < 0.02
    assert rows["target/events"].sum() == 0


def test_steady_motion_has_the_lag_of_the_mean_and_rest_has_none() -> None:
    path = nudge(np.array([0.0, 0.1, 0.0]), 1.0)
    rows = ran(TeleopDriver(TeleopSettings(seconds=1.6, path=path))).rows
    error = rows["target/position_error"][:, 0]
    speed = 0.1 * 1.875  # largest of a stroke of least jerk
    assert error.max() == pytest.approx(9.5e-3 * speed, rel=0.25)
    assert error[-1] < 1e-4


def test_keys_move_the_target_and_the_arm_goes_there() -> None:
    driver = TeleopDriver(TeleopSettings(seconds=1.5))
    keys = [Hand(1.0, partial(driver.press, key)) for key in (263, 263, 266)]
    run = ran(driver, *keys)
    pose = run.rows["target/pose"]
    np.testing.assert_allclose(pose[-1, :3] - pose[0, :3], [0.0, 0.04, 0.02], atol=1e-4)
    way = run.rows["tool/pose"][-1, :3] - run.rows["tool/pose"][0, :3]
    np.testing.assert_allclose(way, [0.0, 0.04, 0.02], atol=1e-3)


def test_a_target_dragged_out_of_reach_is_followed_as_far_as_it_goes() -> None:
    simulation = Simulation(PANDA, Follow().build_scene)
    far = SE3.from_translation(np.array([0.5, 0.2, -3.0]))
    drag = Hand(1.0, lambda: simulation.place_marker(TARGET, far))
    settings = TeleopSettings(seconds=2.5, obstacles=(TABLE,), clearance=0.01)
    run = ran(TeleopDriver(settings), drag, simulation=simulation)
    assert run.failure is None
    assert not run.rows["contact/tool"].any()
    arm = Arm(PANDA, obstacles=(TABLE,))
    least = min(Clearance(arm, 0.01).nearest(q)[0] for q in run.rows["joints/q"][1000::50])
    assert 0.0099 < least < 0.014  # it went down to the table, and no further
    assert events(run, "clearance_relaxed") + events(run, "target_jumped") > 0


def test_it_ends_when_the_window_is_closed() -> None:
    driver = TeleopDriver(TeleopSettings(seconds=60.0, path=nudge(np.full(3, 0.05), 2.0)))
    run = ran(driver, Hand(1.3, driver.leave))
    assert run.failure is None
    assert 1.3 < len(run.rows) * 1e-3 < 2.2
    assert np.abs(run.rows["joints/v_ref"][-1]).max() == 0.0


def test_ctrl_c_ends_it_with_a_complete_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracked = TeleopDriver._note

    def interrupted(self: TeleopDriver, loop: object, events: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        tracked(self, loop, events)  # type: ignore[arg-type]

    monkeypatch.setattr(TeleopDriver, "_note", interrupted)
    before = signal.getsignal(signal.SIGINT)
    file = tmp_path / "follow.rrd"
    assert follow.run(FollowOptions(seconds=60.0, path=HAND_PATH, log=file), QUIET) == INTERRUPTED
    assert signal.getsignal(signal.SIGINT) is before
    assert read_recording(file).summary is not None


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--seconds", "0"], "--seconds must be above 0 and at most 590"),
        (["--seconds", "nan"], "--seconds must be above 0 and at most 590"),
        (["--clearance", "-1"], "--clearance must be at least 0"),
        (["--speed", "2"], "--speed must be between 0.01 and 1"),
        (["--path", "none.csv"], "none.csv cannot be read: No such file"),
        (["--log", "run.txt"], "--log must be a file that ends with .rrd"),
        (["--viewer"], "needs a display"),
    ],
)
def test_bad_input_gets_one_message(
    args: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert main(FollowOptions, follow.run, follow.__doc__, args=args) == BAD_INPUT
    told = " ".join(capsys.readouterr().err.split())
    assert message in told
    assert told.count("error:") == 1
    assert not (tmp_path / "logs" / "follow.rrd").exists()
