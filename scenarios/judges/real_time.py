"""Real-time priority, where the machine lets a process have it; needs nothing but Python."""

import os


def real_time(core: int, priority: int) -> bool:
    """Let this process run at once, on a core of its own; return whether that was permitted.

    Args:
        core: Number of the core.
        priority: Of SCHED_FIFO, 1 to 99.
    """
    if (os.cpu_count() or 1) < 2:
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        os.sched_setaffinity(0, {core})
    except OSError:
        return False
    return True
