"""A local Rerun viewer, which listens to this machine only."""

import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import IO

from robo47_qp.errors import RecordingError, RenderingError

_HOST, _PORT = "127.0.0.1", 9876
_PATIENCE = 10.0
"""Time limit until a viewer opens its port [s]."""
_SETTLED, _PAUSE = 1.0, 0.05
"""Time a viewer must listen before it counts as started, and period of the check [s]."""
_ANSWER = 0.5
"""Time limit for an answer on this machine [s]."""
_GREETING = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, 4, 0, 0, 0, 0, 0])
"""With which a client of HTTP/2, which gRPC needs, begins: preface and empty settings."""
_SETTINGS = 4
"""Type of the frame with which a server of HTTP/2 begins (RFC 9113, section 3.4)."""
_STARTED: list[subprocess.Popen[bytes]] = []
"""Started viewers: Python warns of a running process without a reference."""


def viewer_url(port: int = _PORT) -> str:
    """Return the URL of a viewer at a port; one is started if none listens.

    Raises:
        RenderingError: No viewer listens and none can be started, or another program has the port.
    """
    with socket.socket() as probe:
        probe.settimeout(_ANSWER)
        taken = probe.connect_ex((_HOST, port)) == 0
    if not taken:
        _start(port)
    elif not _answers(port):
        raise RenderingError(
            f"No Rerun viewer: port {port} of {_HOST}, where it listens, has another program that "
            "does not answer as one. Close that program, or record without the live view."
        )
    return f"rerun+http://{_HOST}:{port}/proxy"


def open_recording(path: Path) -> None:
    """Show a recording in the Rerun viewer, and wait until its window is closed.

    Raises:
        RecordingError: There is no such file, or it is no recording by its name.
        RenderingError: The viewer cannot be started.
    """
    if path.is_dir():
        raise RecordingError(f"{path} cannot be opened: it is a folder. Name a recording in it.")
    if not path.is_file():
        raise RecordingError(f"{path} cannot be opened: there is no such file. Run a task first.")
    if path.suffix != ".rrd":
        raise RecordingError(f"{path} cannot be opened: its name must end with .rrd.")
    with tempfile.TemporaryFile() as log:
        try:
            done = subprocess.run([_program(), "--bind", _HOST, str(path)], stderr=log, check=False)
        except OSError as error:
            raise _failed(f"{_program()} cannot be started ({error.strerror})") from error
        if done.returncode not in (0, -signal.SIGINT):
            raise _ended(done.returncode, log)


def view_command(path: Path) -> str:
    """Return what to type in this folder's shell to see a recording, wherever the package is."""
    beside = Path(sys.executable).with_name("robo47")
    if shutil.which("robo47"):
        program = ["robo47"]
    elif beside.is_file():
        near = beside.is_relative_to(Path.cwd())
        program = [f"./{beside.relative_to(Path.cwd())}" if near else str(beside)]
    else:
        program = [sys.executable, "-m", "robo47_qp"]
    return shlex.join([*program, "view", str(path)])


def _program() -> str:
    return str(Path(sys.executable).parent / "rerun")


def _answers(port: int) -> bool:
    """Whether a server of HTTP/2 answers."""
    begun = b""
    try:
        with socket.create_connection((_HOST, port), timeout=_ANSWER) as probe:
            probe.sendall(_GREETING)
            while len(begun) < 4 and (more := probe.recv(4 - len(begun))):
                begun += more
    except OSError:
        return False
    return begun[3:] == bytes([_SETTINGS])


def _start(port: int) -> None:
    program = _program()
    command = [program, "--bind", _HOST, "--port", str(port), "--hide-welcome-screen"]
    # A file and not a pipe: nobody empties a pipe once the viewer runs.
    with tempfile.TemporaryFile() as log:
        try:
            viewer = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
                start_new_session=True,  # the viewer outlives the run that it shows
            )
        except OSError as error:
            raise _failed(f"{program} cannot be started ({error.strerror})") from error
        _STARTED.append(viewer)
        deadline, listening = time.monotonic() + _PATIENCE, 0.0
        while time.monotonic() < deadline:
            if viewer.poll() is not None:
                raise _ended(viewer.returncode, log)
            # It opens its port before its window, and ends if there can be no window.
            listening = listening + _PAUSE if _answers(port) else 0.0
            if listening >= _SETTLED:
                return
            time.sleep(_PAUSE)
        # The program is a script around the viewer: both are in the session made above.
        os.killpg(viewer.pid, signal.SIGKILL)
        viewer.wait()
    raise _failed(f"it did not open port {port} within {_PATIENCE:.0f} s")


def _ended(code: int, log: IO[bytes]) -> RenderingError:
    log.seek(0)
    lines = log.read().decode(errors="replace").strip().splitlines()
    reason = f": {lines[-1].rsplit(': ')[-1].rstrip('.')}" if lines else ""
    return _failed(f"it ended with code {code}{reason}")


def _failed(reason: str) -> RenderingError:
    return RenderingError(
        f"No Rerun viewer: {reason}. It needs a display (DISPLAY or WAYLAND_DISPLAY set) with "
        "OpenGL or Vulkan; without one, record without the live view and open the file on a "
        "machine with a display."
    )
