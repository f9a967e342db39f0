"""The wheel in an environment of its own: `python -m tests.wheel PYTHON...` tries real ones.

For every interpreter that is named, it makes a virtual environment, installs the locked
dependencies and the wheel into it, and runs the commands from an empty folder.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from zipfile import ZipFile

ROOT = Path(__file__).resolve().parents[1]
BAD_INPUT = """
from robo47_qp.__main__ import main
print(main(["run", "juggle"]), main(["run", "pick_place", "--speed", "2"]))
print(main(["evaluate", "--task", "juggle"]), main(["compare-ik", "--n", "0"]))
print(main(["view", "missing.rrd"]), main(["dance"]))
# No display: there is nothing to view it on.
print(main(["view", "logs/run.rrd"]))
"""
GOOD_INPUT = """
from contextlib import redirect_stdout
from io import StringIO
from robo47_qp.__main__ import main
with redirect_stdout(StringIO()):
    for line in (
        "compare-ik --n 5 --targets uniform --solvers dls default",
        "evaluate --task pick_place --episodes 1 --workers 1",
    ):
        ended = main(line.split())
        assert ended == 0, (line, ended)
"""
GYM = """
import gymnasium
import robo47_qp
made = gymnasium.make("robo47/pick_place-v0")
made.reset(seed=0)
made.step(made.action_space.sample())
"""


def build(folder: Path) -> Path:
    """Build the wheel of this checkout."""
    # A copy: setuptools leaves its work in the folder that it builds.
    source = folder / "source"
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in listed.stdout.split("\0"):
        if name.startswith(("robo47_qp", "tasks/", "setup.py", "pyproject", "README", "LICENSE")):
            target = source / name
            target.parent.mkdir(parents=True, exist_ok=True)
            if (ROOT / name).is_symlink():
                target.symlink_to((ROOT / name).readlink())
            else:
                target.write_bytes((ROOT / name).read_bytes())
    # As pip does it, without asking twice for requirements and metadata.
    make = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
    subprocess.run(
        [sys.executable, "-c", make, str(folder)], cwd=source, check=True, stdout=subprocess.DEVNULL
    )
    (wheel,) = folder.glob("*.whl")
    return wheel


def top_level(wheel: Path) -> set[str]:
    """Names that a wheel puts into site-packages, its metadata aside."""
    with ZipFile(wheel) as archive:
        names = {name.partition("/")[0] for name in archive.namelist()}
    return {name for name in names if not name.endswith(".dist-info")}


def environment(folder: Path, python: str) -> Path:
    """Make a bare virtual environment, and return its interpreter."""
    subprocess.run([python, "-m", "venv", "--without-pip", str(folder)], check=True)
    return folder / "bin" / "python"


def install(python: Path, *arguments: str) -> None:
    """Install into an environment by the pip of this one."""
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
    subprocess.run([*pip, "--disable-pip-version-check", *arguments], check=True)


def run(folder: Path, *command: str, code: int = 0) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder and check its exit code; no traceback whatever it is."""
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "DISPLAY")}
    done = subprocess.run(
        command, cwd=folder, env=clean, capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == code, (command, done.returncode, done.stdout, done.stderr)
    assert "Traceback" not in done.stderr, done.stderr
    return done


def try_commands(python: Path, folder: Path) -> None:
    """Run what an installed package offers from an empty folder."""
    robo47, where = str(python.parent / "robo47"), str(python)
    found = run(folder, where, "-c", "import robo47_qp; print(robo47_qp.__file__)").stdout
    assert Path(found.strip()).is_relative_to(python.parents[1]), found
    assert "known: " not in run(folder, robo47, "run", "pick_place").stderr
    assert json.loads((folder / "logs" / "run.json").read_text(encoding="utf-8"))["success"]
    assert "evaluate" in run(folder, where, "-m", "robo47_qp", "--help").stdout
    # The imports of one process serve for all the rest.
    told = run(folder, where, "-c", GYM + GOOD_INPUT + BAD_INPUT)
    assert {path.name for path in folder.iterdir()} == {"logs"}
    logs = {path.name for path in (folder / "logs").iterdir()}
    assert {"run.rrd", "run.json", "run.png", "eval.json", "ik.json"} <= logs
    assert told.stdout.split() == ["2"] * 7
    assert told.stderr.count("error") == 7, told.stderr
    assert "error: No Rerun viewer" in told.stderr


def main() -> None:
    """Try the wheel in a real environment of every interpreter that is named."""
    for python in sys.argv[1:]:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            own = environment(folder / "env", python)
            install(own, "--require-hashes", "-r", str(ROOT / "requirements.lock"))
            install(own, "--no-deps", "--no-index", str(build(folder)))
            (folder / "empty").mkdir()
            try_commands(own, folder / "empty")
            version = run(folder, str(own), "-V").stdout.strip()
            print(f"{version}: the wheel works from an empty folder")


if __name__ == "__main__":
    main()
