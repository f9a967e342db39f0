"""The command `robo47`, also `python -m robo47_qp`: run, evaluate, compare, view, recover."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

HELP = """\
usage: robo47 COMMAND [OPTIONS]

Classical manipulation for MuJoCo: QP inverse kinematics, Ruckig motion, impedance control.

commands:
  run TASK         run a task once, record it and say how it went
  evaluate         run many episodes of a task under one policy or several
  compare-ik       compare inverse kinematics on paired targets: DLS, QP, restarts
  view RECORDING   open a recording in the Rerun viewer
  recover ROWS     make the recording of a run that was killed, from the file it left (.rows)

`robo47 COMMAND --help` lists the options of a command; files go to ./logs.
"""


def main(args: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code: 0 success, 1 failure, 2 bad input, 130 Ctrl-C."""
    given = list(sys.argv[1:] if args is None else args)
    if given and given[0] in ("-h", "--help"):
        sys.stdout.write(HELP)
        return 0
    if not given or given[0] not in _COMMANDS:
        what = f"no command is called {given[0]!r}" if given else "a command is missing"
        sys.stderr.write(f"error: {what}; known: {', '.join(_COMMANDS)}.\n")
        return 2
    try:
        return _COMMANDS[given[0]](given[1:])
    except KeyboardInterrupt:  # in the imports: a command that runs says what it keeps
        sys.stderr.write("interrupted; nothing has run\n")
        return 130


def _run(args: Sequence[str]) -> int:
    from robo47_qp.cli import run_command

    return run_command(None, args, "robo47 run TASK")


def _evaluate(args: Sequence[str]) -> int:
    from robo47_qp.evaluation.command import evaluate_command

    return evaluate_command(args, "robo47 evaluate")


def _compare_ik(args: Sequence[str]) -> int:
    from robo47_qp.evaluation.benchmarks.ik.command import compare_command

    return compare_command(args, "robo47 compare-ik")


def _view(args: Sequence[str]) -> int:
    def view(path: Path) -> None:
        from robo47_qp.report.rerun.viewer import open_recording

        open_recording(path)

    return _with_file(args, "view RECORDING.rrd", view)


def _recover(args: Sequence[str]) -> int:
    def recover(path: Path) -> None:
        from robo47_qp.report.rerun.recovery import recover

        recording, seconds = recover(path)
        sys.stdout.write(f"{recording} holds {seconds:.3f} s\n")

    return _with_file(args, "recover RUN.rows", recover)


def _with_file(args: Sequence[str], usage: str, command: Callable[[Path], None]) -> int:
    """Run a command that takes one file and no options; return the exit code."""
    from robo47_qp.cli import guarded

    if len(args) != 1 or args[0].startswith("-"):
        asked = args and args[0] in ("-h", "--help")
        (sys.stdout if asked else sys.stderr).write(f"usage: robo47 {usage}\n")
        return 0 if asked else 2

    def run() -> int:
        command(Path(args[0]))
        return 0

    return guarded(run)


_COMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "run": _run,
    "evaluate": _evaluate,
    "compare-ik": _compare_ik,
    "view": _view,
    "recover": _recover,
}


if __name__ == "__main__":
    sys.exit(main())
