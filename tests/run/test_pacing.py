"""Pace: simulated time does not pass faster than the clock, and it is not delayed twice."""

import sys
from importlib import import_module
from typing import Any

import pytest

from robo47_qp.errors import RenderingError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run import observers
from robo47_qp.run.observers import RealTime, ViewerWindow
from robo47_qp.sim.simulation import Simulation
from tests.runs import Holder, no_objects


class Clock:
    """Goes on as is slept, and as is said."""

    def __init__(self) -> None:
        self.now = 100.0
        self.slept: list[float] = []

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(observers, "perf_counter", lambda: made.now)
    monkeypatch.setattr(observers, "sleep", made.sleep)
    return made


@pytest.fixture
def world() -> Holder:
    return Holder(Simulation(PANDA, no_objects))


def test_simulated_time_passes_like_the_clock(world: Holder, clock: Clock) -> None:
    pace = RealTime()
    pace.tick(world.simulation)
    for taken in (0.0, 0.005, 0.02, 0.0):
        world.hold(20)
        clock.now += taken
        pace.tick(world.simulation)
    # The third block took as long as it is, so that there was nothing to wait for.
    assert clock.slept == pytest.approx([0.02, 0.015, 0.02], abs=1e-9)


def test_the_clock_starts_at_the_first_tick_whenever_that_is(world: Holder, clock: Clock) -> None:
    world.hold(500)
    RealTime().tick(world.simulation)
    assert clock.slept == []


def test_a_late_run_catches_up_without_waiting(world: Holder, clock: Clock) -> None:
    pace = RealTime()
    pace.tick(world.simulation)
    clock.now += 0.15
    world.hold(100)
    pace.tick(world.simulation)
    assert clock.slept == []
    world.hold(100)
    pace.tick(world.simulation)
    assert clock.slept == pytest.approx([0.05], abs=1e-9)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells by its environment")
def test_a_viewer_without_a_display_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RenderingError, match="needs a display and neither DISPLAY nor"):
        ViewerWindow(Simulation(PANDA, no_objects))


def test_the_viewer_opens_without_its_side_panels(monkeypatch: pytest.MonkeyPatch) -> None:
    viewer: Any = import_module("mujoco.viewer")
    asked: dict[str, Any] = {}

    def launch_passive(*_: Any, **options: Any) -> None:
        asked.update(options)

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewer, "launch_passive", launch_passive)
    ViewerWindow(Simulation(PANDA, no_objects))
    assert (asked["show_left_ui"], asked["show_right_ui"]) == (False, False)
