"""Command line of one run, and what every command shares: options, messages, exit codes."""

import json
import os
import sys
from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, make_dataclass
from inspect import getdoc
from pathlib import Path
from signal import SIGTERM, default_int_handler, signal
from threading import current_thread, main_thread
from typing import Annotated, Any, Literal, TypeVar

import tyro
from rich.console import Console
from rich.markup import escape
from threadpoolctl import threadpool_limits

from robo47_qp.arrays import CheckedOptions, CountOrZero, Suffix, check_once, read_number
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError, Robo47Error
from robo47_qp.files import check_writable, claimed, write_text
from robo47_qp.model.cell import in_cell
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots import load_robot, robot_names
from robo47_qp.report.importing import importing
from robo47_qp.report.output import forgiving_output
from robo47_qp.report.run_plot import Plotter
from robo47_qp.report.terminal import ProgressBar, nothing_yet, print_summary
from robo47_qp.run.foreign_code import Blamed
from robo47_qp.run.observers import Observer
from robo47_qp.run.recording import CHUNK_ROWS
from robo47_qp.run.registry import load_task, task_names
from robo47_qp.run.runner import Runner
from robo47_qp.run.start import check_clear
from robo47_qp.run.task import Task, own_options, task_of_options
from robo47_qp.run.teleop.driver import TeleopDriver
from robo47_qp.sim.franka.driven_arm import DrivenArm, driven, uncollected
from robo47_qp.sim.simulation import Simulation
from robo47_qp.sim.visuals import with_menagerie_looks
from robo47_qp.stack import CONTROLLERS, IK_SOLVERS, PROFILES, QP_SOLVERS, ClassicalStack

OK, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit codes: success, the robot tried and failed, bad input, Ctrl-C or SIGTERM."""
LOGS = Path("logs")
"""Folder for recordings and reports, in the working directory."""
DEFAULT_TASK = "pick_place"
ARM_ROWS = 120_000
"""Rows of a real arm that go to the Rerun file at once at most; a row file has them before."""
Options = TypeVar("Options")


def one_of(names: Sequence[str]) -> Any:
    """Annotate an option that is one of several names."""
    return tyro.conf.arg(metavar="{" + ",".join(names) + "}", help_behavior_hint=_default)


def unset(metavar: str) -> Any:
    """Annotate an option that may be left out, and takes a value of this kind."""
    number = {"INT": int, "FLOAT": float}.get(metavar)
    spec = tyro.constructors.PrimitiveConstructorSpec(
        1,
        metavar,
        lambda words: read_number(number, words[0]),
        lambda _: True,
        lambda it: [str(it)],
    )
    read: Any = None if number is None else Annotated[number, spec]
    return tyro.conf.arg(metavar=metavar, help_behavior_hint=_default, constructor=read)


def _default(value: str) -> str:
    """Return what the help says of a default; nothing of an option that is left out."""
    return "" if "None" in value else f"(default: {value})"


@dataclass(frozen=True, kw_only=True)
class TaskOption:
    """The option that comes first."""

    task: str = DEFAULT_TASK
    """Name of a task, or file.py:Class."""


@dataclass(frozen=True, kw_only=True)
class StackOptions:
    """Options of the robot and of the classical stack."""

    robot: Annotated[str | None, one_of(robot_names())] = None
    """Robot that does the task; without it, the one that the task is made for: panda, or
    panda_pair for tasks of two arms. iiwa14 and xarm7 take their model from MuJoCo Menagerie."""
    ik: Annotated[str, one_of([*IK_SOLVERS])] = ClassicalStack.ik
    """Inverse kinematics: mink, the same QP without mink's overhead (qp), the faster
    Levenberg-Marquardt inside the joint limits (lm), or damped least squares clamped to them. Each
    starts from home and is restarted from other configurations where it gets stuck; the names with
    -single start from home alone, with the more patient settings of a solver without restarts (100
    QPs, 200 steps of dls), and offer one configuration per goal where the others offer several.
    Among obstacles mink, qp and lm step around what is in the way; with dls, answers that are too
    close to an obstacle are refused. Straight lines are followed from one start per point with any
    of them; where one fails, a slower search helps."""
    qp_solver: Annotated[str, one_of(QP_SOLVERS)] = ClassicalStack.qp_solver
    """QP solver for --ik mink and qp, also with -single."""
    controller: Annotated[str, one_of([*CONTROLLERS])] = ClassicalStack.controller
    """Controller that tracks the planned motion."""
    observer: bool = True
    """Take the measured state as it is. Without this, an observer estimates the joints' state and
    compensates what disturbs them: heavier links, an unknown payload, dry friction."""
    profile: Annotated[str, one_of(PROFILES)] = ClassicalStack.profile
    """Bounds of all motions: gentle, or rated, as fast as the arm's ratings and motors allow."""
    speed: float = ClassicalStack.pace
    """Pace, 0.01 to 1: at 0.5 the motions take twice the time."""

    def robot_for(self, task: Task | type[Task]) -> Robot:
        """Return the robot that was chosen, or the one that a task is made for, in its cell.

        Raises:
            Robo47Error: See `load_robot`.
        """
        robot = load_robot(task.default_robot if self.robot is None else self.robot)
        # A class tells its name where that is a field.
        return in_cell(robot, task.name if isinstance(task.name, str) else None)

    @property
    def stack(self) -> ClassicalStack:
        """The stack that was chosen.

        Raises:
            InvalidValueError: A number is out of range.
            UnknownNameError: No solver or controller has the name.
        """
        try:
            return ClassicalStack(
                ik=self.ik,
                qp_solver=self.qp_solver,
                controller=self.controller,
                observer=ClassicalStack.observer if self.observer else None,
                profile=self.profile,
                pace=self.speed,
            )
        except InvalidValueError as error:
            option = {"pace": "--speed", "qp_solver": "--qp-solver"}[error.name]
            raise InvalidValueError(option, error.found, error.expected) from error


@dataclass(frozen=True, kw_only=True)
class RunOptions(CheckedOptions, StackOptions):
    """Options of one run."""

    seed: Annotated[CountOrZero | None, unset("INT")] = None
    """Draw what the task leaves open, as starts and goals, at random from this seed; without it,
    the default ones are used."""
    log: Annotated[Path, Suffix(".rrd")] = LOGS / "run.rrd"
    """Recording to write; the report goes beside it, with the ending .json."""
    plot: Annotated[Annotated[Path, Suffix(".png")] | None, unset("PATH")] = None
    """Picture of path and errors to write (PNG); by default beside the recording."""
    video: Annotated[Annotated[Path, Suffix(".mp4")] | None, unset("PATH")] = None
    """Video to write (mp4); needs the extra "video" and OpenGL."""
    live: bool = False
    """Also show the recording in a viewer while it runs, at the pace of real time."""
    realtime: bool = False
    """Run no faster than real time."""
    viewer: bool = False
    """Open MuJoCo's interactive viewer and run no faster than real time; needs a display."""
    visuals: Literal["primitives", "menagerie"] = "primitives"
    """Looks of the robot: its own simple shapes, or the meshes of MuJoCo Menagerie (needs the
    extra "visuals"). The physics is the same."""
    at: Annotated[str | None, unset("HOST")] = None
    """Address of a real FR3 with its hand, which moves in the place of the simulation (needs the
    extra "franka"). Read docs/real_arm.md first. Objects are taken to be where the task puts them
    at its start: nothing looks."""
    dry_run: bool = False
    """With --at: read the arm, plan, say what would move, and move nothing."""
    json: bool = False
    """Print the report as JSON on the standard output and nothing else."""

    def __post_init__(self) -> None:
        """Check every option.

        Raises:
            InvalidValueError: A number is out of range, or a file has the wrong ending.
            UnknownNameError: No solver or controller has the name.
        """
        super().__post_init__()
        self.stack  # noqa: B018  # checks its settings
        if self.at is None and self.dry_run:
            raise InvalidValueError("--dry-run", "no --at", "given with --at")
        if self.at is not None and (self.live or self.viewer or self.video is not None):
            expected = "without --live, --viewer and --video, which take time from control"
            raise InvalidValueError("--at", "one of them", expected)

    @property
    def paced(self) -> bool:
        """True where the run must not go faster than real time."""
        return self.realtime or self.live or self.viewer


def guarded(command: Callable[[], int]) -> int:
    """Run a command and turn errors into one message and an exit code.

    Linear algebra takes one thread, as workers do: matrices are small, and more threads would only
    wait for each other.

    Returns:
        What the command returns; 2 for bad input, 130 for Ctrl-C and for SIGTERM.
    """
    try:
        if current_thread() is main_thread():
            # So that files are closed and temporary files are removed.
            signal(SIGTERM, default_int_handler)
        with forgiving_output(), threadpool_limits(1, user_api="blas"):
            return command()
    except Robo47Error as error:
        Console(stderr=True).print(f"[bold red]error:[/] {escape(str(error))}", highlight=False)
        return BAD_INPUT
    except KeyboardInterrupt as stopped:
        told = f"interrupted; {stopped}" if str(stopped) else "interrupted"
        Console(stderr=True).print(told, highlight=False)
        return INTERRUPTED


def main(
    options: type[Options],
    run: Callable[[Options, Console], int],
    description: str | None,
    *,
    repeated: bool = False,
    args: Sequence[str] | None = None,
    prog: str | None = None,
) -> int:
    """Parse the command line, run, and return the exit code; see `guarded`.

    Args:
        options: What can be chosen.
        run: Runs what was chosen.
        description: What the help begins with.
        repeated: An option with several values is given once for each, and not once for all.
        args: The command line; None takes that of the process.
        prog: Name of the command in the help; None takes the script's.
    """

    def parsed_and_run() -> int:
        kinds: tuple[Any, ...] = (tyro.conf.FlagCreatePairsOff, tyro.conf.UseAppendAction)
        tyro._experimental_options["ansi_codes"] = not os.environ.get("NO_COLOR")
        if not repeated:
            check_once(options, sys.argv[1:] if args is None else args)
        chosen = tyro.cli(
            options, description=description, config=kinds[: 1 + repeated], args=args, prog=prog
        )
        return run(chosen, Console(stderr=bool(getattr(chosen, "json", False))))

    return guarded(parsed_and_run)


def run_command(
    name: str | None = None, args: Sequence[str] | None = None, prog: str | None = None
) -> int:
    """Run a task from the command line, and return the exit code; see `guarded`.

    Args:
        name: Name of the task; None takes it from `--task`, or from the first argument.
        args: The command line; None takes that of the process.
        prog: Name of the command in the help; None takes the script's.
    """
    rest, late = list(sys.argv[1:] if args is None else args), None
    if name is None and rest and not rest[0].startswith("-"):
        name = rest.pop(0)
    if name is None:
        parser = ArgumentParser(prog=prog, add_help=False, allow_abbrev=False)
        parser.add_argument("--task")
        chosen, rest = parser.parse_known_args(rest)
        late = None if chosen.task else next((one for one in rest if one in task_names()), None)
        name = str(chosen.task or DEFAULT_TASK)

    def run() -> int:
        if late is not None:
            others = [one for one in rest if one != late]
            raise Robo47Error(" ".join(["the task comes first: robo47 run", late, *others]))
        kind = load_task(name)
        told = (getdoc(kind) or "").partition("\n\n")[0]
        text = f"{told}\n\nTasks: {', '.join(task_names())} (the default: {DEFAULT_TASK})."
        return main(task_options(kind), _run_chosen(kind), text, args=rest, prog=prog)

    return guarded(run)


def task_options(kind: type[Task]) -> type[RunOptions]:
    """Return the options of a run with those that the task offers of its own.

    A task offers the fields that it declares with `robo47_qp.run.task.option`.
    """
    own: list[Any] = [
        (
            one.name,
            Annotated[one.type, tyro.conf.arg(help=one.metadata["help"])],
            field(default=one.default),
        )
        for one in own_options(kind)
    ]
    name = f"{kind.__name__}Options"
    return make_dataclass(name, own, bases=(RunOptions,), frozen=True, kw_only=True)


def _run_chosen(kind: type[Task]) -> Callable[[RunOptions, Console], int]:
    def run(options: RunOptions, console: Console) -> int:
        with Blamed(kind), nothing_yet(options.log):
            robot = options.robot_for(kind)
            task = task_of_options(kind, vars(options), options.seed, robot)
            return run_task(task, robot, options, console)

    return run


def run_task(
    task: Task,
    robot: Robot,
    options: RunOptions,
    console: Console,
    driver: TeleopDriver | None = None,
) -> int:
    """Run one task once, record it, and say how it went.

    Args:
        task: The task.
        robot: Robot that does it.
        options: What else was chosen.
        console: Where to say how it went.
        driver: Moves the arm in place of the task's program, after a target.

    Raises:
        Robo47Error: Something that was asked for cannot be had; nothing has moved, or, for
            a `RecordingError`, what was recorded before is in the file.
    """
    # Rerun takes a third of the time of a start, and help or bad input does not need it.
    with importing():
        import robo47_qp.report.recorded  # noqa: F401
    robot = robot if options.at is None else driven(robot)
    scenario = options.stack.scenario(robot, task, options.seed)
    dressed = options.visuals == "menagerie"
    looks = with_menagerie_looks(robot, task.build_scene) if dressed else task.build_scene
    with ExitStack() as held:
        arm = None
        if options.at is not None:
            arm = held.enter_context(closing(DrivenArm(robot, looks, options.at)))
        simulation = arm or Simulation(robot, looks)
        runner = Runner(scenario, simulation, driver, extra=driver.signals if driver else ())
        if arm is None:
            check_clear(simulation, task.name)
        seconds = [leg.trajectory.duration for leg in runner.rehearse()]
        foreseen = sum(seconds, start=0.0 if driver is None else driver.seconds)
        if arm is not None:
            planned = f"planned: {foreseen:.1f} s of motion"
            console.print("\n".join([*arm.report(), planned]), highlight=False, soft_wrap=True)
            if options.dry_run:
                return OK
            arm.get_ready()
        held.enter_context(claimed(options.log))
        return _recorded(runner, arm, driver, options, foreseen, console)


def _recorded(
    runner: Runner,
    arm: DrivenArm | None,
    driver: TeleopDriver | None,
    options: RunOptions,
    foreseen: float,
    console: Console,
) -> int:
    """Run with all that looks on and records; return the exit code."""
    from robo47_qp.report.recorded import observers, recorded

    files = {"recording": options.log, "report": options.log.with_suffix(".json")}
    files["plot"] = options.plot or options.log.with_suffix(".png")
    if options.video is not None:
        files["video"] = options.video
    for path in files.values():
        check_writable(path)
    with closing(Plotter(files["plot"])) as plotter:
        with ExitStack() as stack:
            made = observers(runner.loop.sim, driver, options.video, options.viewer, options.paced)
            shown: list[Observer] = [stack.enter_context(closing(one)) for one in made]
            chunk_rows = CHUNK_ROWS
            if arm is not None:
                # Nothing but control has time while an arm moves.
                chunk_rows = min(ARM_ROWS, round(runner.scenario.time_limit / TIMESTEP))
                stack.enter_context(uncollected())
                stack.callback(arm.close)
            else:
                shown.append(stack.enter_context(closing(ProgressBar(console, foreseen))))
            run, figures, findings, summary = recorded(
                runner, runner.loop.sim, shown, files, plotter, options.live, chunk_rows
            )
        write_text(files["report"], json.dumps(summary, indent=2))
        if options.json:
            sys.stdout.write(json.dumps(summary, indent=2) + "\n")
        else:
            print_summary(console, run, figures, findings, files)
        plotter.finish()
    return OK if run.failure is None else FAILED
