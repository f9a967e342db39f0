"""What goes wrong in a run of `robo47 run --at`: code, message, recording, and where the arm is."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
from robo47_qp.tasks.reach.reach import Reach
from tests.driven import adds, one, run
from tests.franka import served

pytest.importorskip("pylibfranka", reason="the extra franka is not installed")
BUSY = "from time import monotonic as t\nend = t() + 120\nwhile t() < end: pass"
Plant = Callable[["subprocess.Popen[str]"], Callable[[DrivenArm], None]]


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


def jump(_: "subprocess.Popen[str]") -> Callable[[DrivenArm], None]:
    return adds(lambda _: one(3, 5.0))


def no_number(_: "subprocess.Popen[str]") -> Callable[[DrivenArm], None]:
    def plant(arm: DrivenArm) -> None:
        step, count = arm.step, 0

        def wrong(tau: Vector) -> None:
            nonlocal count
            count += 1
            step(tau if count < 100 else tau * np.nan)

        arm.step = wrong  # type: ignore[method-assign]

    return plant


def gone(process: "subprocess.Popen[str]") -> Callable[[DrivenArm], None]:
    def killed(i: int) -> Vector:
        if i == 0:
            process.kill()
        return np.zeros(7)

    return adds(killed)


@pytest.mark.parametrize(
    ("plant", "told", "rows"),
    [
        (jump, "controller_torque_discontinuity: libfranka: Move command aborted", 99),
        (no_number, "commanded torque must be finite", 99),
        (gone, "libfranka", 99),
    ],
)
def test_a_run_that_is_stopped_ends_with_code_message_and_a_whole_recording(
    plant: Plant,
    told: str,
    rows: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    log = tmp_path / "run.rrd"
    with served("--lock-step", "--task", "reach") as (host, process):
        init, planted = DrivenArm.__init__, plant(process)

        def faulty(self: DrivenArm, *args: Any, **options: Any) -> None:
            init(self, *args, **options)
            planted(self)

        monkeypatch.setattr(DrivenArm, "__init__", faulty)
        args = ["--log", str(log), "--robot", "fr3", "--at", host]
        assert main(task_options(Reach), _run_chosen(Reach), None, args=args, prog="run") == FAILED
        if plant is not gone:
            at_rest(host)
    assert "failed: arm" in capsys.readouterr().out
    summary = json.loads(log.with_suffix(".json").read_text())
    assert summary["failure"] == "arm"
    assert told in summary["evidence"]
    chunks = RrdReader(log).stream().to_chunks()
    signals = [chunk for chunk in chunks if str(chunk.entity_path) == "/signals"]
    assert sum(chunk.num_rows for chunk in signals) >= rows
    assert not list(tmp_path.glob("*.rows"))
