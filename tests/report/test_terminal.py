"""What a run says in the terminal."""

import io
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from robo47_qp.report.audit.audit import audit
from robo47_qp.report.figures_table import FiguresTable
from robo47_qp.report.metrics import metrics
from robo47_qp.report.rerun.viewer import view_command
from robo47_qp.report.terminal import ProgressBar, print_files, print_summary
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.scenario import Run
from tests.runs import Reach, carry_out, picked_and_placed


def printed(run: Run, files: dict[str, Path]) -> str:
    console = Console(file=io.StringIO(), width=120)
    print_summary(console, run, metrics(run), audit(run), files)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_the_summary_tells_outcome_waypoints_promises_and_files(tmp_path: Path) -> None:
    run = picked_and_placed()
    long = tmp_path / ("x" * 200) / "run.rrd"
    text = printed(run, {"recording": long, "report": tmp_path / "run.json"})
    figures = metrics(run)
    for leg in run.legs:
        line = next(x for x in text.splitlines() if x.strip().startswith(leg.waypoint.name))
        assert leg.waypoint.motion.name in line
        assert f"{leg.trajectory.duration:.2f}" in line
    for finding in audit(run):
        line = next(x for x in text.splitlines() if finding.signal in x)
        assert line.split()[-2] == "yes"
    assert "\nsuccess\n" in text
    assert f"place error      {1e3 * figures['place_error_m']:.2f} mm" in text
    assert f"cycle time       {figures['cycle_time_s']:.2f} s" in text
    assert f"joints within {1e3 * figures['max_joint_error_rad']:.3f} mrad" in text
    assert f"{figures['step_us']:.1f} µs per step" in text
    assert f"up to {figures['peak_contact_force_N']:.2f} N on the tool" in text
    assert f"energy           {figures['energy_J']:.1f} J" in text
    assert f"smoothness       {figures['smoothness_ldlj']:.2f} (" in text
    assert f"audit            {len(audit(run))} of {len(audit(run))} limits kept" in text
    assert "violation" not in text
    # Paths are not broken: they are there to be copied.
    assert f"robo47 view {long}\n" in text
    assert f"{tmp_path / 'run.json'}\n" in text


def test_the_summary_tells_a_failure_and_a_broken_promise(tmp_path: Path) -> None:
    failure = Failure(cause=Cause.GRASP, evidence="nothing between the fingers [really]")
    run = replace(picked_and_placed(), failure=failure)
    console = Console(file=io.StringIO(), width=120)
    findings = [replace(finding, ok=False) for finding in audit(run)]
    print_summary(console, run, metrics(run), findings, {})
    assert isinstance(console.file, io.StringIO)
    text = console.file.getvalue()
    assert "failed: grasp  nothing between the fingers [really]" in text
    assert "success" not in text
    assert text.count(" NO") == len(findings)
    assert f"audit            0 of {len(findings)} limits kept" in text
    for finding in findings:
        assert f"violation  {finding}" in " ".join(text.split("\n"))
    assert "Open the recording" not in text


def test_a_task_without_a_place_has_no_place_error(tmp_path: Path) -> None:
    assert "place error" not in printed(carry_out(Reach()), {})


def test_the_bar_follows_phase_and_time() -> None:
    console = Console(file=io.StringIO(), width=100, force_terminal=True)
    bar = ProgressBar(console, expected=0.1)
    try:
        run = carry_out(Reach(), observers=[bar])
        bar._progress.refresh()
        assert isinstance(console.file, io.StringIO)
        shown = console.file.getvalue()
    finally:
        bar.close()
    last = f"{len(run.rows) * 1e-3:.1f}"
    assert "end" in shown
    assert f"{last} of {last} s simulated" in shown


def test_the_bar_leaves_nothing_behind_where_there_is_no_terminal() -> None:
    console = Console(file=io.StringIO(), width=100)
    bar = ProgressBar(console, expected=1.0)
    carry_out(Reach(), observers=[bar])
    bar.close()
    assert isinstance(console.file, io.StringIO)
    assert console.file.getvalue().strip() == ""


@pytest.mark.parametrize("expected", [0.0, 1e3])
def test_any_expectation_will_do(expected: float) -> None:
    bar = ProgressBar(Console(file=io.StringIO()), expected)
    carry_out(Reach(), observers=[bar])
    bar.close()


def test_a_path_is_printed_as_it_is(tmp_path: Path) -> None:
    console = Console(file=io.StringIO(), width=40)
    path = tmp_path / "[old] a long name of a folder" / "run [1].rrd"
    print_files(console, {"recording": path})
    assert console.file.getvalue() == f"  recording  {path}\n"  # type: ignore[attr-defined]


def test_the_command_that_opens_a_recording_can_be_pasted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = Path("my logs") / "it's [1].rrd"
    (tmp_path / path.parent).mkdir()
    monkeypatch.chdir(tmp_path)
    program = tmp_path / "robo47"
    program.write_text('#!/bin/sh\nprintf "%s|" "$@"\n')
    program.chmod(0o755)
    for known in (f"{tmp_path}:{os.environ['PATH']}", "/usr/bin:/bin"):
        monkeypatch.setenv("PATH", known)
        monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
        said = subprocess.run(
            ["/bin/sh", "-c", view_command(path)],
            capture_output=True,
            text=True,
            check=True,
            env={"PATH": known},
        )
        assert said.stdout == f"view|{path}|"


def test_names_may_have_brackets() -> None:
    screen = io.StringIO()
    console = Console(file=screen, width=120, force_terminal=True, color_system=None)
    table = FiguresTable(("waypoint", "time s"), texts=("waypoint",))
    table.add_row("slot [/left] [red]", "1.00")
    console.print(table)
    bar = ProgressBar(console, 1.0)
    bar.phase(0.0, "slot [/left]")
    bar._progress.refresh()
    bar.close()
    assert "slot [/left] [red]  " in screen.getvalue()
    assert screen.getvalue().count("slot [/left]") >= 2
