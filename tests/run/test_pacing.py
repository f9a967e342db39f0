"""Pace: simulated time does not pass faster than the clock, and it is not delayed twice."""

import sys
from importlib import import_module
from time import perf_counter, sleep
from typing import Any

import pytest

from robo47_qp.errors import RenderingError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.observers import RealTime, ViewerWindow
from robo47_qp.sim.simulation import Simulation
from tests.runs import Holder, no_objects


@pytest.fixture
def world() -> Holder:
    return Holder(Simulation(PANDA, no_objects))


def test_simulated_time_passes_like_the_clock(world: Holder) -> None:
    pace = RealTime()
    pace.tick(world.simulation)
    started = perf_counter()
    for _ in range(10):
        world.hold(20)
        pace.tick(world.simulation)
        assert perf_counter() - started >= world.simulation.time - 2e-3
    assert perf_counter() - started < 1.0


def test_the_clock_starts_at_the_first_tick_whenever_that_is(world: Holder) -> None:
    world.hold(500)
    pace = RealTime()
    started = perf_counter()
    pace.tick(world.simulation)
    assert perf_counter() - started < 0.1


def test_a_late_run_catches_up_without_waiting(world: Holder) -> None:
    pace = RealTime()
    pace.tick(world.simulation)
    sleep(0.15)
    world.hold(100)
    started = perf_counter()
    pace.tick(world.simulation)
    assert perf_counter() - started < 0.02


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
