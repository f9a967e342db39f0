"""Real-time priority, where the machine lets a process have it; needs nothing but Python."""

import os


def own_core(core: int) -> bool:
    """Keep this process to a core, and return whether it may have real-time priority."""
    os.sched_setaffinity(0, {core % (os.cpu_count() or 1)})
    permitted = real_time(1)
    if permitted:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return permitted


def real_time(priority: int) -> bool:
    """Let this process come before all others, by SCHED_FIFO; return whether that was permitted."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        return False
    return True
