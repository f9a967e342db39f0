"""The command `robo47` and `python -m robo47_qp`: run, evaluate, serve, compare, view, recover."""

import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import TypeAlias

from robo47_qp.errors import RecordingError, RenderingError
from robo47_qp.report.importing import importing
from robo47_qp.report.output import forgiving_output

Command: TypeAlias = Callable[[Sequence[str]], int]
"""Takes what follows its name on the command line, and returns the exit code."""
HELP = """\
usage: robo47 COMMAND [OPTIONS]

Classical manipulation for MuJoCo: QP inverse kinematics, Ruckig motion,
impedance control.

commands:
  run TASK         run a task once, record it and say how it went
  evaluate         run many episodes of a task under one policy or several
  serve-policy     answer a benchmark's observations with actions, by websocket
  compare-ik       compare inverse kinematics on paired targets: DLS, QP, ...
  serve-franka     answer clients of libfranka with a task's simulation
  view RECORDING   open a recording in the Rerun viewer
  recover ROWS     make the recording of a killed run from the .rows it left

`robo47 COMMAND --help` lists the options of a command; files go to ./logs.
"""


def main(args: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code: 0 success, 1 failure, 2 bad input, 130 Ctrl-C."""
    given = list(sys.argv[1:] if args is None else args)
    if given and given[0] in ("-h", "--help"):
        return _told(HELP, 0)
    if not given or given[0] not in _COMMANDS:
        what = f"no command is called {given[0]!r}" if given else "a command is missing"
        return _told(f"error: {what}; known: {', '.join(_COMMANDS)}.\n", 2)
    try:
        with importing():
            _check_renderer()
            command = _COMMANDS[given[0]]()
        return command(given[1:])
    except RenderingError as error:
        return _told(f"error: {error}\n", 2)
    except KeyboardInterrupt:  # Before or after what the command guards.
        return _told("interrupted\n", 130)


def _told(text: str, code: int) -> int:
    """Print a text where its exit code says, and return the code; 2 if nothing can be printed."""
    try:
        with forgiving_output():
            print(text, end="", file=sys.stderr if code else sys.stdout)
    except RecordingError as error:
        return _told(f"error: {error}\n", 2)
    return code


def _check_renderer() -> None:
    """Import MuJoCo, and with it the renderer that MUJOCO_GL names.

    Raises:
        RenderingError: There is no such renderer here.
    """
    if "MUJOCO_GL" not in os.environ:
        return
    try:
        import_module("mujoco")
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        raise RenderingError(
            f"MUJOCO_GL must name a renderer of this machine; found {os.environ['MUJOCO_GL']!r} "
            f"({error}). On Debian or Ubuntu, egl needs libegl1 and libgl1, and osmesa "
            "libosmesa6; without MUJOCO_GL everything but pictures works."
        ) from error


def _run() -> Command:
    from robo47_qp.cli import run_command

    return lambda args: run_command(None, args, "robo47 run TASK")


def _evaluate() -> Command:
    from robo47_qp.evaluation.command import evaluate_command

    return lambda args: evaluate_command(args, "robo47 evaluate")


def _serve_policy() -> Command:
    from robo47_qp.evaluation.serving.command import serve_command

    return lambda args: serve_command(args, "robo47 serve-policy")


def _compare_ik() -> Command:
    from robo47_qp.evaluation.benchmarks.ik.command import compare_command

    return lambda args: compare_command(args, "robo47 compare-ik")


def _serve_franka() -> Command:
    from robo47_qp.evaluation.serve_franka import serve_command

    return lambda args: serve_command(args, "robo47 serve-franka")


def _view() -> Command:
    from robo47_qp.report.rerun import viewer

    return lambda args: _with_file(args, "view RECORDING.rrd", viewer.open_recording)


def _recover() -> Command:
    from robo47_qp.report.rerun import recovery

    def recover(path: Path) -> None:
        recording, seconds = recovery.recover(path)
        sys.stdout.write(f"{recording} holds {seconds:.3f} s\n")

    return lambda args: _with_file(args, "recover RUN.rows", recover)


def _with_file(args: Sequence[str], usage: str, command: Callable[[Path], None]) -> int:
    """Run a command that takes one file and no options; return the exit code."""
    from robo47_qp.cli import guarded

    if len(args) != 1 or args[0].startswith("-"):
        asked = args and args[0] in ("-h", "--help")
        return _told(f"usage: robo47 {usage}\n", 0 if asked else 2)

    def run() -> int:
        command(Path(args[0]))
        return 0

    return guarded(run)


_COMMANDS: dict[str, Callable[[], Command]] = {
    "run": _run,
    "evaluate": _evaluate,
    "serve-policy": _serve_policy,
    "compare-ik": _compare_ik,
    "serve-franka": _serve_franka,
    "view": _view,
    "recover": _recover,
}


if __name__ == "__main__":
    sys.exit(main())
