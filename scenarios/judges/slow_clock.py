"""A clock that goes slower than that of the machine, for all that a process reads and waits by."""

import threading
import time

_LATE = 5e-5
"""Time that a thread may oversleep until the clock stands still for it [s]."""


class SlowClock:
    """Time at a part of its pace, which stands still while threads that it should wake are held up.

    So a process that the machine holds up finds no time to have passed, and its threads wake in
    the order in which they are to.
    """

    def __init__(self, pace: float) -> None:
        """Start at 0; a second takes 1 / pace seconds of the machine, pace in (0, 1]."""
        self._pace, self._lock = pace, threading.Lock()
        self._clock, self._wait = time.perf_counter, time.sleep
        self._now, self._last = 0.0, self._clock()
        self._wakes: dict[int, float] = {}

    def now(self) -> float:
        """Return the time since the start [s]."""
        with self._lock:
            real = self._clock()
            now = self._now + self._pace * (real - self._last)
            if self._wakes:
                now = max(self._now, min(now, min(self._wakes.values()) + _LATE))
            self._now, self._last = now, real
            return now

    def sleep(self, seconds: float) -> None:
        """Wait for some time [s]."""
        wake = self.now() + seconds
        with self._lock:
            self._wakes[threading.get_ident()] = wake
        while (left := wake - self.now()) > 0.0:
            self._wait(left / self._pace)
        with self._lock:
            del self._wakes[threading.get_ident()]


def slow_down(pace: float) -> None:
    """Let `time` go by a slow clock: what its clocks tell, and how long `time.sleep` waits.

    Call it before modules that take functions out of `time` are imported. Time-outs of sockets,
    locks and polls stay those of the machine.
    """
    clock = SlowClock(pace)

    def told(start: float) -> float:
        return start + clock.now()

    for name in ("time", "monotonic", "perf_counter"):
        start: float = getattr(time, name)()
        setattr(time, name, lambda start=start: told(start))
    time.sleep = clock.sleep  # type: ignore[assignment]
