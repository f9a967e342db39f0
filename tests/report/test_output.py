"""What cannot be printed: the job goes on, and is told where it matters."""

import ast
import os
import signal
import subprocess
import sys
import time
from io import BytesIO, TextIOWrapper
from pathlib import Path

import pytest

from robo47_qp.errors import RecordingError
from robo47_qp.report.output import forgiving_output

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
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


@posix
@pytest.mark.parametrize(
    ("name", "after"),
    [("evaluate", 0.1), ("evaluate", 0.4), ("evaluate", 0.8), ("settling", 0.1), ("settling", 0.3)],
)
def test_ctrl_c_in_the_imports_is_one_line(name: str, after: float, tmp_path: Path) -> None:
    script = SCENARIOS / f"{name}.py"
    chosen = ["--task", "reach"] if name == "evaluate" else []
    # Began to import: the interpreter itself cannot be taught before.
    code = (
        "import sys, runpy; import robo47_qp.__main__; print('began', flush=True); "
        f"sys.argv = {[script.name, *chosen]}; runpy.run_path({str(script)!r}, "
        "run_name='__main__')"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=-1, stderr=-1, text=True, cwd=tmp_path
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "began\n"
    time.sleep(after)
    process.send_signal(signal.SIGINT)
    # On a fast machine episodes have begun after the last delay: told on the standard output.
    said = "".join(process.communicate(timeout=60))
    assert "Traceback" not in said
    assert said.count("interrupted") == 1
    assert process.returncode == 130


@pytest.mark.parametrize("script", sorted(SCENARIOS.glob("*.py")), ids=lambda path: path.stem)
def test_a_script_imports_no_package_where_ctrl_c_would_leave_a_trace(script: Path) -> None:
    light = {"robo47_qp.__main__", "robo47_qp.report.importing"}
    for node in ast.parse(script.read_text(encoding="utf-8")).body:
        names = [one.name for one in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom):
            names = [str(node.module)]
        heavy = [name for name in names if name.split(".")[0] not in sys.stdlib_module_names]
        assert set(heavy) <= light, f"{script.name}:{node.lineno}: in a block of `importing`"


@posix
def test_ctrl_c_in_the_imports_waits_for_processes_that_packages_have_started() -> None:
    """GLFW's tells the process that looks for it what it found, and would complain."""
    code = (
        "import subprocess, sys, time\n"
        "from robo47_qp.report.importing import importing\n"
        "with importing():\n"
        "    late = \"import time; print('began', flush=True); time.sleep(1); print('done')\"\n"
        "    child = subprocess.Popen([sys.executable, '-c', late])\n"
        "    time.sleep(30)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=-1, stderr=-1) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"began\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 130
        # A child that was left alone would have told nothing yet.
        os.set_blocking(process.stdout.fileno(), False)
        assert process.stdout.read() == b"done\n"


@posix
def test_ctrl_c_before_such_a_process_was_told_what_it_waits_for_does_not_hang() -> None:
    code = (
        "import subprocess, sys, time\n"
        "from robo47_qp.report.importing import importing\n"
        "with importing():\n"
        "    asks = \"print('began', flush=True); print(input())\"\n"
        "    child = subprocess.Popen([sys.executable, '-c', asks], stdin=-1, text=True)\n"
        "    time.sleep(1)\n"
        "    child.communicate('told')\n"
        "    time.sleep(30)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=-1, stderr=-1, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "began\n"
        process.send_signal(signal.SIGINT)
        try:
            said, complaints = process.communicate(timeout=20)
        finally:
            process.kill()
    assert process.returncode == 130
    assert (said, complaints) == ("told\n", "interrupted; nothing has run\n")


@posix
def test_a_second_ctrl_c_in_the_imports_ends_at_once() -> None:
    code = (
        "import subprocess, sys, time\n"
        "from robo47_qp.report.importing import importing\n"
        "with importing():\n"
        "    stays = \"import time; print('began', flush=True); time.sleep(9)\"\n"
        "    child = subprocess.Popen([sys.executable, '-c', stays])\n"
        "    time.sleep(30)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=-1, stderr=-1) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == b"began\n"
        process.send_signal(signal.SIGINT)
        assert process.stderr.readline() == b"interrupted; nothing has run\n"
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=5) == -signal.SIGINT


@posix
def test_after_ctrl_c_in_the_imports_nothing_runs() -> None:
    """Even where a process that they have started stays."""
    code = (
        "import subprocess, sys, time\n"
        "from robo47_qp.report.importing import importing\n"
        "with importing():\n"
        "    stays = \"import time; print('began', flush=True); time.sleep(2)\"\n"
        "    child = subprocess.Popen([sys.executable, '-c', stays])\n"
        "    time.sleep(1)\n"
        "print('runs')\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=-1, stderr=-1) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"began\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 130
        assert process.stdout.read() == b""
