"""A clock at a part of its pace, which stands still while its process is held up."""

import time
from typing import SupportsIndex

import pytest

from scenarios.judges import slow_clock
from scenarios.judges.slow_clock import SlowClock


class Machine:
    """A machine's clock, and waiting that may take longer than it is to."""

    def __init__(self, clock: SlowClock) -> None:
        self.now, self.held_up = 0.0, 0.0
        self.waits: list[float] = []
        clock._clock, clock._wait, clock._last = self.clock, self.wait, 0.0

    def clock(self) -> float:
        return self.now

    def wait(self, seconds: float | SupportsIndex) -> None:
        self.waits.append(float(seconds))
        self.now += float(seconds) + self.held_up


def test_time_goes_at_its_pace() -> None:
    clock = SlowClock(0.1)
    machine = Machine(clock)
    machine.now = 2.0
    assert clock.now() == pytest.approx(0.2)
    clock.sleep(1e-3)
    assert sum(machine.waits) == pytest.approx(1e-2)
    assert clock.now() == pytest.approx(0.201, abs=1e-4)


def test_it_stands_still_while_a_thread_that_it_should_wake_is_held_up() -> None:
    clock = SlowClock(0.25)
    machine = Machine(clock)
    machine.held_up = 0.1
    clock.sleep(1e-3)
    assert 1e-3 <= clock.now() <= 1.1e-3
    # A thread that is to wake later sleeps on by as much as the clock stood still.
    clock._wakes[-1] = clock.now() + 1e-3
    machine.held_up = 0.0
    machine.now += 0.1
    assert clock.now() < 2.2e-3
    del clock._wakes[-1]
    before = clock.now()
    machine.now += 0.1
    assert clock.now() == pytest.approx(before + 0.025)


def test_a_process_reads_it_and_waits_by_it(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, wait = time.perf_counter, time.sleep
    for name in ("time", "monotonic", "perf_counter", "sleep"):
        monkeypatch.setattr(time, name, getattr(time, name))
    slow_clock.slow_down(0.1)
    started, slow = clock(), time.perf_counter()
    time.sleep(2e-3)
    wait(5e-3)
    assert clock() - started >= 25e-3
    assert 2e-3 <= time.perf_counter() - slow <= 0.11 * (clock() - started)
    assert time.time() > 1e9
