"""Progress and summary of a run in the terminal."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import ceil
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from robo47_qp.report.audit.finding import Finding
from robo47_qp.report.figures_table import FiguresTable
from robo47_qp.report.progress import Steps
from robo47_qp.report.rerun.viewer import view_command
from robo47_qp.run.observers import Observer
from robo47_qp.run.scenario import Run
from robo47_qp.sim.simulation import Simulation

_NOTHING = "  cycle time       nothing is recorded: it ended in its first control period"


class ProgressBar(Observer):
    """Bar over simulated time; with retries, a run takes longer than expected."""

    def __init__(self, console: Console, expected: float) -> None:
        """Show an empty bar for a run with an expected duration [s]."""
        self._progress = Progress(
            TextColumn("{task.description:<14}", markup=False),
            BarColumn(bar_width=40),
            TextColumn("{task.completed:5.1f} of {task.total:.1f} s simulated"),
            TimeElapsedColumn(),
            console=console,
            refresh_per_second=5,
            transient=True,
            disable=not console.is_terminal,
        )
        self._lines = Steps(console, ceil(expected), "seconds simulated", bar=False)
        self._lines.__enter__()
        self._phase = "start"
        self._expected = expected
        self._bar = self._progress.add_task("start", total=expected)
        self._progress.start()

    def phase(self, time: float, name: str) -> None:
        """Show the name of the phase."""
        self._phase = name
        self._progress.update(self._bar, description=name)

    def tick(self, simulation: Simulation) -> None:
        """Move the bar."""
        now = simulation.time
        self._progress.update(self._bar, completed=now, total=max(now, self._expected))
        self._lines.show(int(now), self._phase)

    def close(self) -> None:
        """Remove the bar."""
        self._progress.stop()


@contextmanager
def nothing_yet(log: Path) -> Iterator[None]:
    """Let Ctrl-C say that nothing was recorded, where that is so."""
    try:
        yield
    except KeyboardInterrupt as stopped:
        nothing = "" if log.exists() else "nothing was recorded yet"
        raise KeyboardInterrupt(str(stopped) or nothing) from stopped


def print_summary(
    console: Console,
    run: Run,
    metrics: Mapping[str, float],
    findings: Sequence[Finding],
    files: Mapping[str, Path],
) -> None:
    """Print the outcome, the metrics and the files of a run."""
    if run.legs:
        console.print(_waypoints(run))
    console.print(_audit(findings))
    violations = [finding for finding in findings if not finding.ok]
    for finding in violations:
        console.print(f"[bold red]violation[/]  {escape(str(finding))}", highlight=False)
    if run.failure is None:
        console.print("[bold green]success[/]")
    else:
        cause, evidence = run.failure.cause.value, escape(run.failure.evidence)
        console.print(f"[bold red]failed: {cause}[/]  {evidence}", highlight=False)
    if "place_error_m" in metrics:
        console.print(f"  place error      {1e3 * metrics['place_error_m']:.2f} mm")
    if "median_target_error_m" in metrics:
        median, largest, last = (
            1e3 * metrics[f"{which}_target_error_m"] for which in ("median", "max", "final")
        )
        told = f"median {median:.2f} mm, largest {largest:.1f} mm, at the end {last:.3f} mm"
        console.print(f"  from the target  {told}", highlight=False)
    kept = f"{len(findings) - len(violations)} of {len(findings)} limits kept"
    console.print(_told(metrics, kept) if len(run.rows) else _NOTHING, highlight=False)
    print_files(console, files, 16)
    if "recording" in files:
        told = f"Open the recording with: {view_command(files['recording'])}"
        console.print(told, highlight=False, soft_wrap=True, markup=False)


def _told(metrics: Mapping[str, float], kept: str) -> str:
    return (
        f"  cycle time       {metrics['cycle_time_s']:.2f} s{_bound(metrics)}\n"
        f"  tracking         joints within {1e3 * metrics['max_joint_error_rad']:.3f} mrad, "
        f"{_slides(metrics)}"
        f"tool within {1e3 * metrics['max_tool_error_m']:.3f} mm, settled within "
        f"{metrics['settle_time_s']:.3f} s\n"
        f"  contact          up to {metrics['peak_contact_force_N']:.2f} N on the tool, "
        f"{metrics['mean_contact_force_N']:.2f} N mean while in contact\n"
        f"{_friction(metrics)}"
        f"  energy           {metrics['energy_J']:.1f} J\n"
        f"{_smooth(metrics)}"
        f"  audit            {kept}\n"
        f"  control loop     {metrics['step_us']:.1f} µs per step, "
        f"{metrics['real_time_factor']:.0f} times real time"
    )


def _bound(metrics: Mapping[str, float]) -> str:
    least = metrics.get("cycle_bound_s")
    return (
        "" if least is None else f"; no motion along the same paths takes less than {least:.2f} s"
    )


def print_files(console: Console, files: Mapping[str, Path], width: int = 10) -> None:
    """Print what was written, a line each that is never broken.

    Args:
        console: Where to print.
        files: The files by what they are.
        width: Characters for what they are.
    """
    for name, path in files.items():
        console.print(f"  {name:<{width}} {path}", highlight=False, soft_wrap=True, markup=False)


def _friction(metrics: Mapping[str, float]) -> str:
    if "max_friction_use" not in metrics:
        return ""
    share, worst = metrics["max_friction_use"], metrics["max_contact_friction_use"]
    return (
        f"  slip margin      {1.0 - share:.2f} of the fingers' friction while something is "
        f"carried; one contact uses up to {worst:.2f}\n"
    )


def _slides(metrics: Mapping[str, float]) -> str:
    if "max_slide_error_m" not in metrics:
        return ""
    return f"slides within {1e3 * metrics['max_slide_error_m']:.3f} mm, "


def _smooth(metrics: Mapping[str, float]) -> str:
    if "smoothness_ldlj" not in metrics:
        return ""
    value = metrics["smoothness_ldlj"]
    return f"  smoothness       {value:.2f} (log dimensionless jerk; minimum jerk has -5.32)\n"


def _waypoints(run: Run) -> FiguresTable:
    numbers = ("time s", "IK its", "starts", "IK ms", "left µm", "to limit rad")
    texts = ("waypoint", "motion")
    table = FiguresTable((*texts, *numbers), texts=texts, title="Waypoints")
    for leg in run.legs:
        ik = leg.ik
        table.add_row(
            leg.waypoint.name,
            leg.waypoint.motion.name,
            f"{leg.trajectory.duration:.2f}",
            str(ik.iterations),
            str(1 + ik.restarts),
            f"{1e3 * ik.seconds:.1f}",
            f"{1e6 * ik.position_error:.2f}",
            f"{ik.limit_margin:.2f}",
        )
    return table


def _kept(finding: Finding) -> Text:
    if finding.exempt:
        return Text(f"not judged ({100 * finding.share:.0f} %)")
    return Text("yes", "green") if finding.ok else Text("NO", "bold red")


def _audit(findings: Sequence[Finding]) -> FiguresTable:
    texts = ("signal", "unit", "kept")
    headings = ("signal", "limit", "extreme", "unit", "kept", "at s")
    table = FiguresTable(headings, texts=texts, title="Audit")
    for finding in findings:
        table.add_row(
            finding.signal,
            f"{finding.limit:.4g}",
            f"{finding.extreme:.4g}",
            finding.unit,
            _kept(finding),
            f"{finding.time:.3f}",
        )
    return table
