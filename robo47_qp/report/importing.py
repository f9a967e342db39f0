"""Imports of a command, of which those of other packages take most of its start."""

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from signal import SIGINT, signal
from threading import current_thread, main_thread


@contextmanager
def importing() -> Iterator[None]:
    """Import without garbage collection; what is imported stays, and is not looked at again.

    Ctrl-C ends the process at once: extension modules turn it into errors of their own.
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

    def leave(*_: object) -> None:
        os.write(2, b"interrupted; nothing has run\n")
        # GLFW is looked for in a process of its own, which would complain that nobody listens.
        with suppress(OSError):
            while True:
                os.waitpid(-1, 0)
        os._exit(130)

    before = signal(SIGINT, leave)
    try:
        yield
    finally:
        signal(SIGINT, before)
