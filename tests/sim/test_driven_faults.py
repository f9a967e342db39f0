"""What goes wrong in a run of `robo47 run --at`: code, message, recording, and where the arm is."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from robo47_qp.arrays import Vector
from robo47_qp.cli import FAILED, _run_chosen, main, task_options
from robo47_qp.run.failure import Cause
from robo47_qp.sim.franka.driven_arm import DrivenArm
from robo47_qp.sim.franka.link import Link
from tests.driven import Nudge, adds, one, run
from tests.franka import served

pytest.importorskip("pylibfranka", reason="the extra franka is not installed")
BUSY = "from time import monotonic as t\nend = t() + 120\nwhile t() < end: pass"
Plant = Callable[["subprocess.Popen[str]"], Callable[[DrivenArm], None]]
Server = Callable[..., AbstractContextManager[tuple[str, "subprocess.Popen[str]"]]]


@contextmanager
def both_cores_busy() -> Iterator[None]:
    """Two processes that do nothing but take time; they end with the context."""
    others = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(2)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def test_two_runs_are_equal_to_the_bit_with_both_cores_busy() -> None:
    with served("--lock-step") as (host, _):
        quiet = run(host)
        with both_cores_busy():
            busy = run(host)
    assert quiet.failure is None
    np.testing.assert_array_equal(busy.rows.values, quiet.rows.values)


def test_a_robot_that_gets_no_commands_stops_by_itself() -> None:
    """On its own clock: it waits for nobody, and 20 commands are lost in a row."""

    def plant(arm: DrivenArm) -> None:
        exchange = arm.link.exchange

        def paused(tau: Vector) -> None:
            # Long enough for the 20 periods of a server that has little of a core.
            sleep(3.0)
            exchange(tau)

        arm.link.exchange = paused  # type: ignore[method-assign]

    with served() as (host, _):
        failure = run(host, plant).failure
        at_rest(host)
    assert failure is not None
    assert failure.cause is Cause.ARM
    assert failure.evidence.startswith("communication_constraints_violation: libfranka: Move")


def at_rest(host: str) -> None:
    """Assert that the arm stands."""
    link = Link(host)
    try:
        assert np.abs(link.state.dq).max() < 1e-3
    finally:
        link.close()


def adding(tau: Callable[[int], Vector], *, blind: bool = False) -> Plant:
    return lambda _: adds(tau, blind=blind)


def no_number(_: "subprocess.Popen[str]") -> Callable[[DrivenArm], None]:
    def plant(arm: DrivenArm) -> None:
        deliver, count = arm._motors.deliver, 0

        def wrong(tau: Vector) -> None:
            nonlocal count
            count += 1
            deliver(tau if count < 100 else tau * np.nan)

        arm._motors.deliver = wrong  # type: ignore[method-assign]

    return plant


def gone(process: "subprocess.Popen[str]") -> Callable[[DrivenArm], None]:
    def killed(i: int) -> Vector:
        if i == 0:
            process.kill()
        return np.zeros(7)

    return adds(killed)


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


def late(_: "subprocess.Popen[str]") -> Callable[[DrivenArm], None]:
    def plant(arm: DrivenArm) -> None:
        start = arm.link.start

        def started() -> None:
            start()
            arm.link._control = Late(arm.link._control)

        arm.link.start = started  # type: ignore[method-assign]

    return plant


def jammed(_: "subprocess.Popen[str]") -> Callable[[DrivenArm], None]:
    def plant(arm: DrivenArm) -> None:
        grip = arm.link.grip

        def wrong(width: float, speed: float, force: float | None) -> bool:
            return grip(0.5 + width, speed, None)

        arm.link.grip = wrong  # type: ignore[method-assign]

    return plant


@dataclass(frozen=True, kw_only=True)
class Gripping(Nudge):
    """The short program, with its grasp."""

    grips: bool = True


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    """Give the context of a server: that of the module, or a new one."""
    options = ("--lock-step", "--task", "pick_place")
    with served(*options) as usual:
        yield lambda *, anew: served(*options) if anew else nullcontext(usual)


_JUMPED = "controller_torque_discontinuity: libfranka: Move command aborted"


@pytest.mark.parametrize(
    ("plant", "told", "rows"),
    [
        (adding(lambda _: one(3, 5.0)), _JUMPED, range(99, 102)),
        (adding(lambda i: one(1, 1.4 * i), blind=True), _JUMPED, range(99, 110)),
        (
            adding(lambda i: one(0, min(0.8 * i, 50.0)), blind=True),
            "joint_velocity_violation: libfranka: Move command aborted",
            range(120, 400),
        ),
        (
            adding(lambda i: one(6, 0.9 * i), blind=True),
            "tau_J_range_violation: libfranka: Move command aborted",
            range(102, 130),
        ),
        (late, "13 periods went by without a command; 10 in a row", range(99, 102)),
        (no_number, "commanded torque must be finite", range(99, 102)),
        (gone, "libfranka", range(98, 102)),
        (jammed, "the hand: libfranka gripper: Command failed!", range(200, 3000)),
    ],
    ids=["jump", "rate", "velocity", "range", "late", "no number", "server killed", "jam"],
)
def test_a_run_that_is_stopped_ends_with_code_message_and_a_whole_recording(
    plant: Plant,
    told: str,
    rows: range,
    server: Server,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    """The arm is at rest then, and does the next of them: a reflex is cleared by that run."""
    log = tmp_path / "run.rrd"
    with server(anew=plant is gone) as (host, process):
        init, planted = DrivenArm.__init__, plant(process)

        def faulty(self: DrivenArm, *args: Any, **options: Any) -> None:
            init(self, *args, **options)
            planted(self)

        options, act = task_options(Gripping), _run_chosen(Gripping)
        args = ["--log", str(log), "--robot", "fr3", "--at", host]
        with monkeypatch.context() as patch:
            patch.setattr(DrivenArm, "__init__", faulty)
            assert main(options, act, None, args=args, prog="run") == FAILED
        if plant is not gone:
            at_rest(host)
    assert "failed: arm" in capsys.readouterr().out
    summary = json.loads(log.with_suffix(".json").read_text())
    assert summary["failure"] == "arm"
    assert summary["evidence"].startswith(told) or plant is gone
    assert told in summary["evidence"]
    chunks = RrdReader(log).stream().to_chunks()
    signals = [chunk for chunk in chunks if str(chunk.entity_path) == "/signals"]
    assert sum(chunk.num_rows for chunk in signals) in rows
    assert not list(tmp_path.glob("*.rows"))
