"""What cannot be printed: the job goes on, and is told where it matters."""

import os
import subprocess
import sys
from io import BytesIO, TextIOWrapper
from pathlib import Path

import pytest

from robo47_qp.errors import RecordingError
from robo47_qp.report.output import forgiving_output

ROBO47 = [sys.executable, "-m", "robo47_qp"]
posix = pytest.mark.skipif(sys.platform == "win32", reason="files and signals of POSIX")


def test_what_the_encoding_lacks_becomes_a_question_mark(monkeypatch: pytest.MonkeyPatch) -> None:
    taken = BytesIO()
    monkeypatch.setattr(sys, "stdout", TextIOWrapper(taken, encoding="ascii"))
    with forgiving_output():
        print("12 µs")
    assert taken.getvalue() == b"12 ?s\n"


@posix
def test_a_reader_that_has_enough_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = False
    with open(writer, "w", encoding="utf-8") as stream:  # noqa: PTH123
        monkeypatch.setattr(sys, "stdout", stream)
        with forgiving_output():
            print("to nobody", flush=True)
            print("and more", flush=True)
            done = True
    assert done


@posix
def test_a_full_output_is_told_after_the_job(monkeypatch: pytest.MonkeyPatch) -> None:
    done = []

    @forgiving_output()
    def job() -> None:
        print("nowhere", flush=True)
        done.append(True)

    with open("/dev/full", "w", encoding="utf-8") as stream:  # noqa: PTH123
        monkeypatch.setattr(sys, "stdout", stream)
        with pytest.raises(RecordingError, match="No space left on device"):
            job()
    assert done


@posix
@pytest.mark.parametrize("arguments", [["--help"], ["recover", "--help"], ["evaluate", "--help"]])
def test_the_command_says_what_its_output_cannot_take(arguments: list[str], tmp_path: Path) -> None:
    with open("/dev/full", "wb") as full:  # noqa: PTH123
        done = subprocess.run(
            [*ROBO47, *arguments], stdout=full, stderr=-1, text=True, check=False, cwd=tmp_path
        )
    assert done.returncode == 2
    assert done.stderr.count("error:") == 1
    assert "Traceback" not in done.stderr
    piped = subprocess.run(
        ["sh", "-c", f"{' '.join([*ROBO47, *arguments])} 2>err | true; cat err"],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert piped.stdout == ""


@pytest.mark.parametrize("name", ["nonsense", "osmesa"])
def test_a_renderer_that_is_not_there_is_one_message(name: str, tmp_path: Path) -> None:
    if name == "osmesa" and any(Path("/usr/lib").rglob("libOSMesa.so*")):
        pytest.skip("osmesa is installed")
    environment = {**os.environ, "MUJOCO_GL": name}
    # Set by MuJoCo where an earlier test has drawn something.
    environment.pop("PYOPENGL_PLATFORM", None)
    done = subprocess.run(
        [*ROBO47, "run", "reach"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 2
    assert done.stderr.startswith(
        f"error: MUJOCO_GL must name a renderer of this machine; found '{name}'"
    )
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
