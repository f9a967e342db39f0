"""Commands, run as a user runs them or here, and what they say."""

import os
import runpy
import signal
import subprocess
import sys
import warnings
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

SCRIPT = Path(__file__).resolve().parents[1] / "scenarios" / "pickplace.py"

posix = pytest.mark.skipif(sys.platform == "win32", reason="signals and limits of POSIX")


def run_script(
    *arguments: str,
    cwd: Path,
    script: Path = SCRIPT,
    file_limit: int | None = None,
    terminal: bool = False,
) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "COLUMNS": "1000"}
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        environment.pop(name, None)
    if terminal:
        environment["FORCE_COLOR"] = "1"
    limited: list[str] = []
    if file_limit is not None:
        limited = [
            "-c",
            "import resource, runpy, sys\n"
            f"resource.setrlimit(resource.RLIMIT_FSIZE, ({file_limit}, {file_limit}))\n"
            "del sys.argv[0]\n"
            "runpy.run_path(sys.argv[0], run_name='__main__')",
        ]
    return subprocess.run(
        [sys.executable, *limited, str(script), *arguments],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def run_here(
    *arguments: str, cwd: Path, script: Path = SCRIPT, terminal: bool = False
) -> subprocess.CompletedProcess[str]:
    """The same in this process, which saves the imports: for what is no matter of a process."""
    stdout, stderr = StringIO(), StringIO()
    on_terminate = signal.getsignal(signal.SIGTERM)
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(stdout), redirect_stderr(stderr):
        patch.chdir(cwd)
        patch.setenv("COLUMNS", "1000")
        for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
            patch.delenv(name, raising=False)
        if terminal:
            patch.setenv("FORCE_COLOR", "1")
        patch.setattr(sys, "argv", [str(script), *arguments])
        with pytest.raises(SystemExit) as ended:
            runpy.run_path(str(script), run_name="__main__")
    signal.signal(signal.SIGTERM, on_terminate)
    assert isinstance(ended.value.code, int)
    return subprocess.CompletedProcess(
        sys.argv, ended.value.code, stdout.getvalue(), stderr.getvalue()
    )


def _whole_messages(path: Path) -> Path:
    """A copy without what a kill cut in two: 12 bytes of header, then kind, length, payload."""
    data = path.read_bytes()
    assert data[:4] == b"RRF2"
    end = 12
    while end + 16 <= len(data):
        length = int.from_bytes(data[end + 8 : end + 16], "little")
        if end + 16 + length > len(data):
            break
        end += 16 + length
    copy = path.with_suffix(".whole.rrd")
    copy.write_bytes(data[:end])
    return copy


def recorded(path: Path) -> list[float]:
    """Times of all rows of signals in a file, with or without its end [s]."""
    times: list[float] = []
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="RRD file has no footer")
        reader = RrdReader(_whole_messages(path))
        for chunk in reader.stream():
            if str(chunk.entity_path).strip("/") == "signals" and not chunk.is_static:
                column = chunk.to_record_batch().column("time")
                times += [time.total_seconds() for time in column.to_pylist()]
    return sorted(times)


def assert_one_message(done: subprocess.CompletedProcess[str], *words: str) -> None:
    """Bad input: exit code 2 and one message on the standard error."""
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout.strip() == ""
    own, library = done.stderr.count("error:"), done.stderr.count("╭─")
    assert own + library == 1, done.stderr
    for word in words:
        assert word in done.stderr
