"""A run with its recording: row file, Rerun file, figures, audit and report."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from traceback import format_exception
from typing import Any

from robo47_qp.report.audit.audit import audit
from robo47_qp.report.audit.finding import Finding
from robo47_qp.report.metrics import metrics
from robo47_qp.report.rerun.log import RerunLog
from robo47_qp.report.rerun.viewer import viewer_url
from robo47_qp.report.run_plot import Plotter
from robo47_qp.report.run_report import report, summary_markdown
from robo47_qp.report.video import Video
from robo47_qp.run.foreign_code import TaskError
from robo47_qp.run.observers import Observer, RealTime, ViewerWindow
from robo47_qp.run.recording import CHUNK_ROWS
from robo47_qp.run.row_file import ENDING, RowFile
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.teleop.driver import TeleopDriver
from robo47_qp.sim.simulation import Simulation

_LIVE_ROWS = 400
"""Rows that a live viewer gets at once."""


def observers(
    simulation: Simulation,
    driver: TeleopDriver | None,
    video: Path | None,
    window: bool,
    paced: bool,
) -> Iterator[Observer]:
    """Make the observers that were asked for, in their order."""
    if video is not None:
        yield Video(simulation, video)
    if window:
        yield ViewerWindow(simulation, driver)
    if paced:
        yield RealTime()


def recorded(
    runner: Runner,
    simulation: Simulation,
    shown: Sequence[Observer],
    files: Mapping[str, Path],
    plotter: Plotter,
    live: bool = False,
    chunk_rows: int = CHUNK_ROWS,
) -> tuple[Run, dict[str, float], list[Finding], dict[str, Any]]:
    """Run and record; returns the run, its figures, its audit and its report.

    Args:
        runner: What runs.
        simulation: Its world.
        shown: Observers beside the recording.
        files: Where the recording, the report and the plot go, by these names.
        plotter: Takes the run once it has ended.
        live: Whether a viewer shows the recording while it is made.
        chunk_rows: Rows that go to the Rerun file at once.

    Raises:
        RecordingError, RenderingError: The recording cannot be written, or not be shown.
        TaskError: Code of the task raised something; what was recorded is kept, with the traceback.
    """
    viewer = viewer_url() if live else None
    described = simulation.model, simulation.robot, runner.signals
    with (
        closing(RowFile(files["recording"].with_suffix(ENDING), *described)) as rows,
        closing(RerunLog(files["recording"], *described, viewer=viewer, keep=rows.add)) as log,
    ):
        # What is left of an earlier run must not stand beside the beginning of this one.
        for kind in ("report", "plot"):
            files[kind].unlink(missing_ok=True)
        chunk = chunk_rows if viewer is None else _LIVE_ROWS
        try:
            run = runner.run([log], [*shown, log], store=rows, chunk_rows=chunk)
        except KeyboardInterrupt as stopped:
            log.break_off()
            rows.remove()
            begun = simulation.time > 0.0
            kept = "what was recorded so far is kept" if begun else "nothing was recorded yet"
            raise KeyboardInterrupt(kept) from stopped
        except TaskError as error:
            log.note(simulation.time, "".join(format_exception(error)).rstrip(), "ERROR")
            log.break_off()
            rows.remove()
            raise TaskError(f"{error} The traceback is in {files['recording']}.") from error
        plotter.take(run)
        figures, findings = metrics(run), audit(run)
        summary = report(run, figures, findings)
        for finding in findings:
            if not finding.ok:
                log.note(finding.time, f"violation: {finding}", "ERROR")
        log.finish(summary_markdown(summary))
        rows.remove()
    return run, figures, findings, summary
