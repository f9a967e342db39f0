"""A run of the stack by libfranka, against the server in lock-step; and what goes wrong in one."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np
import pytest

from robo47_qp.arrays import Vector
from robo47_qp.cli import main, task_options
from robo47_qp.errors import ArmStopped, InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots import load_robot
from robo47_qp.run.failure import Cause
from robo47_qp.run.runner import Runner
from robo47_qp.sim.franka.driven_arm import DrivenArm, driven
from robo47_qp.sim.franka.link import named
from robo47_qp.sim.franka.protocol import COMMAND, Controller, Generator
from robo47_qp.sim.franka.served_arm import ServedArm
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from tests.driven import FR3, Nudge, adds, one, run
from tests.franka import served

pytest.importorskip("pylibfranka", reason="the extra franka is not installed")


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


@pytest.mark.parametrize(
    ("name", "plant"),
    [
        ("controller_torque_discontinuity", adds(lambda _: one(3, 5.0))),
        ("controller_torque_discontinuity", adds(lambda i: one(1, 1.4 * i), blind=True)),
        ("joint_velocity_violation", adds(lambda i: one(0, min(0.8 * i, 50.0)), blind=True)),
        ("tau_J_range_violation", adds(lambda i: one(6, 0.9 * i), blind=True)),
    ],
    ids=["jump", "rate", "velocity", "range"],
)
def test_what_the_robot_refuses_is_told_by_its_name(
    host: str, name: str, plant: Callable[[DrivenArm], None]
) -> None:
    failure = run(host, plant).failure
    assert failure is not None
    assert failure.cause is Cause.ARM
    assert failure.evidence.startswith(f"{name}: libfranka: Move command aborted")
    # The reflex is cleared by the run that comes next.
    assert run(host).failure is None


def test_a_torque_that_is_no_number_stops_the_arm_before_it_is_sent(host: str) -> None:
    def plant(arm: DrivenArm) -> None:
        deliver, count = arm._motors.deliver, 0

        def wrong(tau: Vector) -> None:
            nonlocal count
            count += 1
            deliver(tau if count < 100 else tau * np.nan)

        arm._motors.deliver = wrong  # type: ignore[method-assign]

    result = run(host, plant)
    assert result.failure is not None
    assert "commanded torque must be finite" in result.failure.evidence
    assert len(result.rows) == 99


def test_a_hand_that_jams_is_told(host: str) -> None:
    def plant(arm: DrivenArm) -> None:
        grip = arm.link.grip

        def wrong(width: float, speed: float, force: float | None) -> bool:
            return grip(0.5 + width, speed, None)

        arm.link.grip = wrong  # type: ignore[method-assign]

    failure = run(host, plant, grips=True).failure
    assert failure is not None
    assert failure.cause is Cause.ARM
    assert failure.evidence == "the hand: libfranka gripper: Command failed!"


def test_a_robot_that_is_gone_is_told_and_what_was_recorded_is_whole() -> None:
    with served("--lock-step") as (host, process):

        def plant(arm: DrivenArm) -> None:
            def killed(i: int) -> Vector:
                if i == 0:
                    process.kill()
                return np.zeros(7)

            adds(killed)(arm)

        result = run(host, plant)
    assert result.failure is not None
    assert result.failure.cause is Cause.ARM
    assert "libfranka" in result.failure.evidence
    assert len(result.rows) >= 98


class Late:
    """A control of torques that tells of periods without a command, from the 100th on."""

    def __init__(self, control: Any) -> None:
        self._control, self._count = control, 0
        self.writeOnce = control.writeOnce

    def readOnce(self) -> tuple[Any, Any]:
        state, passed = self._control.readOnce()
        self._count += 1
        return state, self if self._count >= 100 else passed

    def to_sec(self) -> float:
        return 0.014


def test_commands_that_come_late_end_the_run(host: str) -> None:
    def plant(arm: DrivenArm) -> None:
        start = arm.link.start

        def started() -> None:
            start()
            arm.link._control = Late(arm.link._control)

        arm.link.start = started  # type: ignore[method-assign]

    result = run(host, plant)
    assert result.failure is not None
    assert result.failure.cause is Cause.ARM
    assert result.failure.evidence.startswith("13 periods went by without a command; 10 in a row")
    assert len(result.rows) == 99


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
            while not rows.exists() or rows.stat().st_size < 1 << 20:
                assert client.poll() is None
                sleep(0.05)
            client.send_signal(signal.SIGKILL)
        assert process.stdout is not None
        assert "the client has left" in process.stdout.readline()
        assert process.wait(10.0) == 1
    assert rows.stat().st_size >= 1 << 20


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
        (("--robot", "fr3", "--at", "127.0.0.1"), "Connection to FCI refused"),
    ):
        assert robo47(*args) == 2
        assert told in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


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
        DrivenArm(FR3, Nudge().build_scene, "127.0.0.1")
