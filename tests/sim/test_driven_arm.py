"""A run of the stack by libfranka, against the server in lock-step; and what goes wrong in one."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import sleep
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from robo47_qp.arrays import Vector
from robo47_qp.cli import main, run_command, task_options
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import ArmStopped, InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robots import load_robot
from robo47_qp.run.row_file import read_rows
from robo47_qp.run.runner import Runner
from robo47_qp.sim.franka.driven_arm import DrivenArm, driven
from robo47_qp.sim.franka.link import Link, named
from robo47_qp.sim.franka.protocol import COMMAND, Controller, Generator
from robo47_qp.sim.franka.served_arm import ServedArm
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from tests.driven import FR3, Nudge, one, run
from tests.franka import address, served

franka = pytest.importorskip("pylibfranka", reason="the extra franka is not installed")


@pytest.fixture(scope="module")
def host() -> Iterator[str]:
    with served("--lock-step", "--task", "pick_place") as (host, _):
        yield host


def test_the_same_program_runs_and_two_runs_are_equal_to_the_bit(host: str) -> None:
    runs = [run(host, grips=True) for _ in range(2)]
    for done in runs:
        assert done.failure is None
        tracked = np.abs(done.rows["errors/q"]).max()
        assert tracked < 2e-4
        assert done.rows["franka/commands"][:, 1].max() == 0.0
        # Torques of the robot and what was recorded as delivered: gravity is added once.
        told, ours = done.rows["franka/torque"], done.rows["joints/tau"]
        np.testing.assert_allclose(told[10:], ours[10:], atol=0.05)
    np.testing.assert_array_equal(runs[0].rows.values, runs[1].rows.values)
    simulation = Simulation(FR3, Nudge().build_scene)
    simulated = Runner(ClassicalStack().scenario(FR3, Nudge(grips=True)), simulation).run()
    lengths = [len(leg.trajectory.q) for leg in runs[0].legs]
    assert lengths == [len(leg.trajectory.q) for leg in simulated.legs]


def test_an_arm_that_is_not_at_home_goes_there_slowly_first(host: str) -> None:
    """The server's arm stands where an earlier motion of this client left it."""
    away = FR3.home + one(3, 0.008)
    task = Nudge()
    arm = DrivenArm(replace(FR3, home=away), task.build_scene, host)
    try:
        result = Runner(ClassicalStack().scenario(arm.robot, task), arm).run()
    finally:
        arm.close()
    assert result.failure is None
    first = result.legs[0]
    assert first.waypoint.name == "first way home"
    assert np.abs(result.rows["joints/v_ref"][: first.trajectory.steps]).max() < 0.15
    np.testing.assert_allclose(result.rows["joints/q"][0], FR3.home, atol=1e-4)
    np.testing.assert_allclose(result.rows["joints/q"][-1], away, atol=1e-3)


def test_the_first_torques_are_those_that_hold_the_arm_where_it_is(host: str) -> None:
    """Far from home, at whose gravity a controller might start."""
    task, first = Nudge(), []
    far = FR3.home + one(1, 0.7) + one(3, 0.7)
    arm = DrivenArm(replace(FR3, home=far), task.build_scene, host)
    exchange = arm.link.exchange

    def some(tau: Vector) -> None:
        first.append(tau.copy())
        if len(first) > 20:
            raise ArmStopped("enough was seen")
        exchange(tau)

    arm.link.exchange = some  # type: ignore[method-assign]
    try:
        result = Runner(ClassicalStack().scenario(arm.robot, task), arm).run()
    finally:
        arm.close()
    assert result.failure is not None
    assert result.failure.evidence == "enough was seen"
    assert np.abs(first).max() < 0.2


def test_a_force_on_the_tool_has_the_sign_that_a_simulation_has(host: str) -> None:
    """libfranka: forces applied by the environment on the robot are negative."""
    arm = DrivenArm(FR3, Nudge().build_scene, host)
    told = arm.link.state
    names = ("q", "dq", "tau_J", "tau_ext_hat_filtered", "control_command_success_rate")
    pushed_up = [0.0, 0.0, -7.0, 0.0, 0.0, 0.0]
    try:
        arm.link.state = SimpleNamespace(
            **{name: getattr(told, name) for name in names}, O_F_ext_hat_K=pushed_up
        )
        arm._write_state()
        np.testing.assert_array_equal(arm.felt_force(), [0.0, 0.0, 7.0])
    finally:
        arm.link.state = told
        arm.close()


def test_the_robot_stops_at_the_twentieth_command_that_is_lost() -> None:
    """On the robot's side, as its clock decides there, and not that of a loaded machine."""
    served_arm = ServedArm(Simulation(FR3, Nudge().build_scene))
    served_arm.start(Controller.EXTERNAL, Generator.NONE)
    command: Any = np.zeros((), COMMAND)[()]
    for commands in ([None] * 19, [command], [None] * 19):
        for one_command in commands:
            assert not served_arm.advance(one_command)
    assert served_arm.advance(None)
    assert served_arm.errors == ["communication_constraints_violation"]


def test_a_run_that_is_killed_leaves_its_rows_and_the_arm_stops(tmp_path: Path) -> None:
    with served("--lock-step", "--once") as (host, process):
        command = [sys.executable, "-m", "robo47_qp", "run", "pick_place", "--robot", "fr3"]
        rows = tmp_path / "run.rows"
        with subprocess.Popen(
            [*command, "--at", host, "--log", str(tmp_path / "run.rrd")], stdout=subprocess.DEVNULL
        ) as client:
            # The head comes at once, then memory for the first block, then row by row.
            while (
                not rows.exists()
                or rows.stat().st_size < 1 << 20
                or len(read_rows(rows).rows) < 500
            ):
                assert client.poll() is None
                sleep(0.05)
            client.send_signal(signal.SIGKILL)
        assert process.stdout is not None
        assert "the client has left" in process.stdout.readline()
        assert process.wait(10.0) == 1
    kept = read_rows(rows)
    assert len(kept.rows) >= 500
    np.testing.assert_allclose(np.diff(kept.rows["time"][:, 0]), TIMESTEP, atol=1e-9)
    moved = np.ptp(kept.rows["joints/q"], axis=0)
    assert moved.max() > 0.05
    assert np.abs(kept.rows["joints/q"] - kept.rows["joints/q_ref"]).max() < 0.01


def test_exit_codes_and_messages(
    host: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def robo47(*args: str) -> int:
        from robo47_qp.cli import _run_chosen
        from robo47_qp.tasks.reach.reach import Reach

        log = ["--log", str(tmp_path / "run.rrd")]
        return main(task_options(Reach), _run_chosen(Reach), None, args=[*log, *args], prog="run")

    assert robo47("--robot", "fr3", "--at", host, "--dry-run") == 0
    assert "the arm is in mode Idle, 0.000 rad from home" in capsys.readouterr().out
    for args, told in (
        (("--robot", "panda", "--at", host), "--robot must be fr3 with --at"),
        (("--dry-run",), "--dry-run must be given with --at"),
        (("--at", host, "--live"), "--at must be without --live"),
        (("--robot", "fr3", "--at", address()), "Connection to FCI refused"),
    ):
        assert robo47(*args) == 2
        assert told in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


class Stopped:
    """A state of a robot whose user holds its stop."""

    robot_mode = franka.RobotMode.UserStopped

    def __init__(self, state: Any) -> None:
        self._state = state

    def __getattr__(self, name: str) -> Any:
        return getattr(self._state, name)


def test_a_robot_whose_stop_is_pressed_is_told_before_anything_is_written(
    host: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    look = Link.look

    def stopped(link: Link) -> None:
        look(link)
        link.state = Stopped(link.state)

    monkeypatch.setattr(Link, "look", stopped)
    at = ["--robot", "fr3", "--at", host, "--log", str(tmp_path / "run.rrd")]
    assert run_command("reach", args=[*at, "--dry-run"], prog="run") == 0
    assert run_command("reach", args=at, prog="run") == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "the robot is in mode UserStopped and takes no motion; release the stop" in told
    assert not list(tmp_path.iterdir())
    arm = DrivenArm(FR3, Nudge().build_scene, host)
    try:
        with pytest.raises(ArmStopped, match="in mode UserStopped"):
            arm.command_grip(Grip(width=0.02, force=1.0))
        assert arm.link.hand.width == pytest.approx(0.08, abs=1e-3)
    finally:
        arm.close()


def test_names_are_found_in_messages() -> None:
    text = 'aborted by reflex! ["joint_reflex", "cartesian_reflex"] control_command_success_rate: 1'
    assert named(text) == "joint_reflex, cartesian_reflex"
    assert named("libfranka: server closed connection") == ""


class LateArm(Simulation):
    """An arm with the joints that are believed of a driven one, and commands 3 periods late."""

    def __init__(self) -> None:
        super().__init__(driven(FR3), Nudge().build_scene)
        self._waiting = [self._gravity()] * 3

    def step(self, tau: Vector) -> None:
        self._waiting.append(tau.copy())
        super().step(self._waiting.pop(0))

    def _gravity(self) -> Vector:
        return Arm(FR3).inverse_dynamics(FR3.home, np.zeros(7), np.zeros(7))


def test_light_rotors_and_late_commands_swing_only_where_rotors_are_believed_heavy() -> None:
    swings = []
    for believed in (driven(FR3), FR3):
        result = Runner(ClassicalStack().scenario(believed, Nudge()), LateArm()).run()
        swings.append(np.abs(np.diff(result.rows["joints/tau"][-200:, 6])).max())
    assert swings[0] < 1e-3
    assert swings[1] > 0.1


def test_only_an_fr3_is_driven() -> None:
    with pytest.raises(InvalidValueError, match="fr3 with --at"):
        DrivenArm(load_robot("panda"), Nudge().build_scene, "127.0.0.1")
    with pytest.raises(ArmStopped, match="refused"):
        DrivenArm(FR3, Nudge().build_scene, address())
