"""The viewer: started for this machine only, and explained where it does not come."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from robo47_qp.errors import RecordingError, RenderingError
from robo47_qp.report.rerun import viewer as live_viewer


def stand_in(folder: Path, program: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put a program in the place of the viewer."""
    viewer = folder / "rerun"
    viewer.write_text(f"#!{sys.executable}\n{program}")
    viewer.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(folder / "python"))


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def test_a_viewer_is_started_for_this_machine_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told, over = tmp_path / "told", tmp_path / "over"
    program = f"""
import pathlib, socket, sys, time
host, port = (sys.argv[sys.argv.index(option) + 1] for option in ("--bind", "--port"))
pathlib.Path({str(told)!r}).write_text(host)
server = socket.create_server((host, int(port)))
server.settimeout(0.05)
end = time.monotonic() + 60.0
while time.monotonic() < end and not pathlib.Path({str(over)!r}).exists():
    try:
        client, _ = server.accept()
    except TimeoutError:
        continue
    client.sendall(bytes([0, 0, 0, 4, 0, 0, 0, 0, 0]))
"""
    stand_in(tmp_path, program, monkeypatch)
    port = free_port()
    try:
        assert live_viewer.viewer_url(port) == f"rerun+http://127.0.0.1:{port}/proxy"
        # It listens now: nothing is started a second time, so the program may go.
        (tmp_path / "rerun").unlink()
        assert live_viewer.viewer_url(port) == f"rerun+http://127.0.0.1:{port}/proxy"
        assert told.read_text() == "127.0.0.1"
    finally:
        over.touch()


def test_a_viewer_that_listens_is_found() -> None:
    """Rerun's own server, which needs no display."""
    port = free_port()
    command = [str(Path(sys.executable).with_name("rerun")), "--serve-grpc"]
    # The program is a script around the server: both are in a session of their own.
    with subprocess.Popen(
        [*command, "--bind", "127.0.0.1", "--port", str(port)],
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ) as server:
        try:
            end = time.monotonic() + 30.0
            while not live_viewer._answers(port) and time.monotonic() < end:
                time.sleep(0.05)
            assert live_viewer.viewer_url(port) == f"rerun+http://127.0.0.1:{port}/proxy"
        finally:
            os.killpg(server.pid, signal.SIGKILL)


@pytest.mark.parametrize("answer", [None, b"", b"HTTP/1.1 400 Bad Request\r\n"])
def test_another_program_at_the_port_is_no_viewer(answer: bytes | None) -> None:
    """It is silent, closes, or speaks otherwise."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def other() -> None:
            server.accept()[0].close()
            with server.accept()[0] as client:
                client.settimeout(5.0)
                if answer is not None:
                    client.sendall(answer)
                while answer is None and client.recv(100):
                    pass

        program = threading.Thread(target=other, daemon=True)
        program.start()
        port = server.getsockname()[1]
        with pytest.raises(RenderingError, match=f"port {port} of .* another program"):
            live_viewer.viewer_url(port)
        program.join()


SHORT_LIVED = """
import socket, sys, time
server = socket.create_server(("127.0.0.1", int(sys.argv[sys.argv.index("--port") + 1])))
end = time.monotonic() + 0.4
while (left := end - time.monotonic()) > 0.0:
    server.settimeout(left)
    try:
        client, _ = server.accept()
    except TimeoutError:
        break
    client.sendall(bytes([0, 0, 0, 4, 0, 0, 0, 0, 0]))
sys.exit("no window")
"""


@pytest.mark.parametrize(
    ("program", "reason"),
    [
        ("import sys; sys.exit('winit: x: DISPLAY is not set.')", "code 1: DISPLAY is not set. It"),
        ("import time; time.sleep(5)", "did not open port"),
        (SHORT_LIVED, "code 1: no window"),
        (None, "cannot be started"),
    ],
)
def test_a_viewer_that_does_not_come_is_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str | None, reason: str
) -> None:
    monkeypatch.setattr(live_viewer, "_PATIENCE", 2.0)
    stand_in(tmp_path, program or "", monkeypatch)
    if program is None:
        (tmp_path / "rerun").unlink()
    with pytest.raises(RenderingError, match=reason) as caught:
        live_viewer.viewer_url(free_port())
    assert "without the live view" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "why"),
    [("missing.rrd", "no such file"), ("folder", "a folder"), ("run.json", "end with .rrd")],
)
def test_what_is_no_recording_is_refused(name: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "run.json").write_text("{}")
    with pytest.raises(RecordingError, match=why):
        live_viewer.open_recording(tmp_path / name)


def test_a_viewer_that_is_not_there_leaves_an_earlier_recording(tmp_path: Path) -> None:
    """In a process of its own: a stream that failed is kept until that ends."""
    path = tmp_path / "run.rrd"
    path.write_bytes(b"earlier")
    program = f"""
import pathlib
import rerun.blueprint as rrb
from robo47_qp.errors import RenderingError
from robo47_qp.report.rerun import stream

stream._PATIENCE = 1.0
try:
    stream.RerunStream(
        pathlib.Path({str(path)!r}), "a", rrb.Blueprint(), "rerun+http://127.0.0.1:{free_port()}/proxy"
    )
except RenderingError as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert "There is no Rerun viewer at" in done.stdout
    assert path.read_bytes() == b"earlier"
