"""Imports of a command: what Ctrl-C does meanwhile."""

import ast
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


@contextmanager
def interrupted(child: str, block: str, then: str = "") -> Iterator[subprocess.Popen[str]]:
    """Give a process that gets SIGINT in a block of imports, once its child has begun.

    The code of the block comes after the start of the child, and the last code after the block.
    """
    began = "import time; print('began', flush=True); "
    code = (
        "import subprocess, sys, time\n"
        "from robo47_qp.report.importing import importing\n"
        "with importing():\n"
        f"    begun = [sys.executable, '-c', {began + child!r}]\n"
        "    child = subprocess.Popen(begun, stdin=-1, text=True)\n"
        f"    {block}\n"
        f"{then}\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=-1, stderr=-1, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "began\n"
        process.send_signal(signal.SIGINT)
        try:
            yield process
        finally:
            process.kill()


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
    with interrupted("time.sleep(1); print('done')", "time.sleep(30)") as process:
        assert process.wait(timeout=20) == 130
        # A child that was left alone would have told nothing yet.
        assert process.stdout is not None
        os.set_blocking(process.stdout.fileno(), False)
        assert process.stdout.read() == "done\n"


@posix
def test_ctrl_c_before_such_a_process_was_told_what_it_waits_for_does_not_hang() -> None:
    tells = "time.sleep(1); child.communicate('told'); time.sleep(30)"
    with interrupted("print(input())", tells) as process:
        said = process.communicate(timeout=20)
    assert process.returncode == 130
    assert said == ("told\n", "interrupted; nothing has run\n")


@posix
def test_a_second_ctrl_c_in_the_imports_ends_at_once() -> None:
    with interrupted("time.sleep(9)", "time.sleep(30)") as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "interrupted; nothing has run\n"
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=5) == -signal.SIGINT


@posix
def test_after_ctrl_c_in_the_imports_nothing_runs() -> None:
    """Even where a process that they have started stays."""
    with interrupted("time.sleep(2)", "time.sleep(1)", "print('runs')") as process:
        said, _ = process.communicate(timeout=20)
    assert process.returncode == 130
    assert said == ""
