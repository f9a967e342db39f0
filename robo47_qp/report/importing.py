"""Imports of a command, of which those of other packages take most of its start."""

import gc
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread

_INTERRUPTED = 130
"""Exit code of a process that Ctrl-C has ended."""
_AGAIN = 0.02
"""Time until it is looked again whether a process still runs [s]."""


@contextmanager
def importing() -> Iterator[None]:
    """Import without garbage collection; what is imported stays, and is not looked at again.

    Ctrl-C ends the process as soon as those that imports have started are through; extension
    modules turn it into errors of their own. A second Ctrl-C ends it at once.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        with _interrupted():
            yield
    finally:
        gc.freeze()
        if enabled:
            gc.enable()


@contextmanager
def _interrupted() -> Iterator[None]:
    if current_thread() is not main_thread():
        yield
        return

    left = False

    def leave(*_: object) -> None:
        nonlocal left
        if not left:
            os.write(2, b"interrupted; nothing has run\n")
        left = True
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        if sys.platform == "win32" or not _children_run():
            os._exit(_INTERRUPTED)
        # GLFW is looked for in a process of its own, which still has to be told where, and would
        # complain if nobody listened.
        signal.signal(signal.SIGALRM, leave)
        signal.setitimer(signal.ITIMER_REAL, _AGAIN)

    before = signal.signal(signal.SIGINT, leave)
    try:
        yield
    finally:
        if left:
            os._exit(_INTERRUPTED)
        signal.signal(signal.SIGINT, before)


def _children_run() -> bool:
    """Return whether a process that this one has started still runs."""
    try:
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    except ChildProcessError:
        return False
    return True
