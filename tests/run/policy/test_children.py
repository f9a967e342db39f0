"""Processes that a policy leaves are found and ended, whatever they look like."""

import subprocess
import sys
import time
from pathlib import Path

from robo47_qp.run.policy.child import end_children

_HALF_DEAD = """
import ctypes, threading, time
threading.Thread(target=time.sleep, args=(60.0,)).start()
ctypes.CDLL(None).pthread_exit(None)
"""
"""Its first thread has ended, another one lives."""
_PARENT = f"""
import subprocess, sys, time
print(subprocess.Popen([sys.executable, "-c", {_HALF_DEAD!r}]).pid, flush=True)
time.sleep(60.0)
"""


def _state(pid: int) -> tuple[str, int]:
    """Return the state of a process that is not waited for, and its number of threads."""
    told = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return told[0], int(told[17])


def test_a_process_whose_first_thread_has_ended_is_ended_though_it_is_told_as_a_zombie() -> None:
    with subprocess.Popen([sys.executable, "-c", _PARENT], stdout=subprocess.PIPE) as parent:
        try:
            assert parent.stdout is not None
            pid, end = int(parent.stdout.readline()), time.monotonic() + 20.0
            while _state(pid) != ("Z", 2):
                assert time.monotonic() < end
                time.sleep(0.01)
            assert end_children(parent.pid)
            assert _state(pid) == ("Z", 1)
            assert not end_children(parent.pid)
        finally:
            parent.kill()
