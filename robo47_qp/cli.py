"""Command: a scenario as a script, from its options to its exit code."""

import json
import sys
from collections.abc import Callable
from contextlib import ExitStack
from signal import SIGTERM, default_int_handler, signal
from threading import current_thread, main_thread
from typing import Any, TypeVar

import tyro
from rich.console import Console
from rich.markup import escape

from robo47_qp.errors import Robo47Error
from robo47_qp.files import claim, write_text
from robo47_qp.model.robot import Robot
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.metrics import metrics
from robo47_qp.report.rerun.log import RerunLog
from robo47_qp.report.run_plot import plot_run
from robo47_qp.report.run_report import report, summary_markdown
from robo47_qp.report.terminal import ProgressBar, print_summary
from robo47_qp.report.video import Video
from robo47_qp.run.observers import Observer, RealTime, ViewerWindow
from robo47_qp.run.runner import Runner
from robo47_qp.run.task import Task
from robo47_qp.sim.scene import BuildScene
from robo47_qp.sim.simulation import Simulation
from robo47_qp.sim.visuals import with_menagerie_looks
from robo47_qp.stack import RunOptions

OK, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
Options = TypeVar("Options")
ObserverT = TypeVar("ObserverT", bound=Observer)


def main(
    options: type[Options],
    run: Callable[[Options, Console], int],
    description: str,
    *,
    repeated: bool = False,
) -> int:
    """Parse the command line, run, and turn errors into one message and an exit code.

    Args:
        options: What can be chosen.
        run: Runs what was chosen.
        description: What the help begins with.
        repeated: An option with several values is given once for each, and not once for all.

    Returns:
        0 for success, 1 where the robot tried and failed, 2 for bad input, 130 for Ctrl-C and
        for SIGTERM.
    """
    if current_thread() is main_thread():
        # So that files are closed and what is temporary is put away.
        signal(SIGTERM, default_int_handler)
    flags: tuple[Any, ...] = (tyro.conf.FlagCreatePairsOff,)
    if repeated:
        flags += (tyro.conf.UseAppendAction,)
    try:
        chosen = tyro.cli(options, description=description, config=flags)
        return run(chosen, Console(stderr=bool(getattr(chosen, "json", False))))
    except Robo47Error as error:
        Console(stderr=True).print(f"[bold red]error:[/] {escape(str(error))}", highlight=False)
        return BAD_INPUT
    except KeyboardInterrupt:
        Console(stderr=True).print("interrupted; what was recorded so far is kept")
        return INTERRUPTED


def run_task(task: Task, robot: Robot, options: RunOptions, console: Console) -> int:
    """Run one task once, record it, and say how it went.

    Raises:
        Robo47Error: Something that was asked for cannot be had; nothing has moved, or, for
            a `RecordingError`, what was recorded before is in the file.
    """
    scenario = options.scenario(robot, task)
    looks: BuildScene = task.build_scene
    if options.visuals == "menagerie":
        looks = with_menagerie_looks(robot, looks)
    simulation = Simulation(robot, looks)
    runner = Runner(scenario, simulation)
    foreseen = sum(leg.trajectory.duration for leg in runner.rehearse())
    files = {
        "recording": options.log,
        "report": options.log.with_suffix(".json"),
        "plot": options.plot or options.log.with_suffix(".png"),
    }
    if options.video is not None:
        files["video"] = options.video
    for path in files.values():
        claim(path)
    with ExitStack() as stack:

        def joined(observer: ObserverT) -> ObserverT:
            stack.callback(observer.close)
            return observer

        observers: list[Observer] = []
        if options.video is not None:
            observers.append(joined(Video(simulation, options.video)))
        if options.viewer:
            observers.append(joined(ViewerWindow(simulation)))
        if options.paced:
            observers.append(RealTime())
        log = joined(
            RerunLog(options.log, simulation.model, robot, runner.signals, live=options.live)
        )
        observers += [log, joined(ProgressBar(console, foreseen))]
        run = runner.run(sinks=[log], observers=observers)
        figures, findings = metrics(run), audit(run)
        summary = report(run, figures, findings)
        for finding in findings:
            if not finding.ok:
                log.note(finding.time, f"broken promise: {finding.told}", "ERROR")
        log.finish(summary_markdown(summary))
    plot_run(run, files["plot"])
    write_text(files["report"], json.dumps(summary, indent=2))
    if options.json:
        sys.stdout.write(json.dumps(summary, indent=2) + "\n")
    else:
        print_summary(console, run, figures, findings, files)
    return OK if run.failure is None else FAILED
