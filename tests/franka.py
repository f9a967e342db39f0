"""A server for libfranka in a process of its own: a client holds Python while it waits."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count

_NUMBERS = count(1)


def address() -> str:
    """An address of this machine that no other test has: libfranka's ports are fixed."""
    return f"127.{1 + (os.getpid() >> 8) % 254}.{os.getpid() % 256}.{1 + next(_NUMBERS) % 254}"


@contextmanager
def served(*options: str) -> Iterator[tuple[str, "subprocess.Popen[str]"]]:
    """The address of a server that is ready, and its process; it ends with the context."""
    host = address()
    command = [sys.executable, "-u", "-m", "robo47_qp", "serve-franka", "--host", host, *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            told = process.stdout.readline()
            assert host in told, told
            yield host, process
        finally:
            process.terminate()
