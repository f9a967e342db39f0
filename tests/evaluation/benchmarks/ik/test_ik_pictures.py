"""Plot, tables and recording of a comparison: what people look at says what was judged."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader
from rich.console import Console

from robo47_qp.errors import RecordingError
from robo47_qp.evaluation.benchmarks.ik import failure_log
from robo47_qp.evaluation.benchmarks.ik.answers import COLOURS, GOOD, Answers, Outcome, outcomes
from robo47_qp.evaluation.benchmarks.ik.comparison import Comparison, Field
from robo47_qp.evaluation.benchmarks.ik.failure_log import FailureLog, figures_markdown, legend, why
from robo47_qp.evaluation.benchmarks.ik.judge import Judge
from robo47_qp.evaluation.benchmarks.ik.plots import comparison_figure, plot_comparison
from robo47_qp.evaluation.benchmarks.ik.summary import summary
from robo47_qp.evaluation.benchmarks.ik.targets import near_limits
from robo47_qp.evaluation.benchmarks.ik.terminal import field_table, paired_table, reasons_table
from robo47_qp.evaluation.benchmarks.ik.unreachable import hostile, unreachable
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.solver import IkSolver
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA

ARM = Arm(PANDA)
SOLVERS: dict[str, IkSolver] = {
    "dls": DlsIk(clip=False, max_iterations=40),
    "lm": LmIk(),
    "lm-multi": LmIk(),
}


@pytest.fixture(scope="module")
def compared() -> tuple[Comparison, list[Sequence[Answers]]]:
    judge = Judge(PANDA)
    makes = (near_limits, unreachable, hostile)
    fields = {make.__name__: Field(make=make, judge=judge) for make in makes}
    comparison = Comparison(arm=ARM, solvers=SOLVERS, fields=fields, n=20)
    return comparison, list(comparison.run(lambda _field, _done: None))


def test_every_outcome_has_a_colour_of_its_own_and_is_explained() -> None:
    assert set(COLOURS) == set(Outcome)
    assert len(set(COLOURS.values())) == len(Outcome)
    for outcome in Outcome:
        assert outcome.value in legend()


def test_the_plot_is_a_picture(
    compared: tuple[Comparison, list[Sequence[Answers]]], tmp_path: Path
) -> None:
    plot_comparison(ARM, compared[1], tmp_path / "ik.png")
    assert (tmp_path / "ik.png").read_bytes()[:4] == b"\x89PNG"
    plot_comparison(ARM, compared[1][2:], tmp_path / "hostile.png")
    with pytest.raises(RecordingError, match=r"nowhere.*cannot be written"):
        plot_comparison(ARM, compared[1][:1], tmp_path / "nowhere" / "ik.png")


@pytest.mark.parametrize("count", [8, 15])
def test_no_title_of_many_solvers_covers_another(
    compared: tuple[Comparison, list[Sequence[Answers]]], count: int
) -> None:
    one = compared[1][0][0]
    names = [f"dls-position-multi{k}" for k in range(count)]
    figure = comparison_figure(ARM, [[replace(one, solver=name) for name in names]])
    figure.canvas.draw()
    titles = [axes.title for part in figure.subfigs for axes in part.axes if axes.get_visible()]
    boxes = [title.get_window_extent() for title in titles if title.get_text()]
    assert len(boxes) == count + 1
    assert not [(a, b) for a, b in combinations(boxes, 2) if a.overlaps(b)]


def test_the_tables_say_what_the_rows_say(
    compared: tuple[Comparison, list[Sequence[Answers]]],
) -> None:
    found = summary(compared[0], compared[1], {("dls", "lm")}, {}, {}, complete=True)
    console = Console(width=200, record=True, quiet=False, file=None)
    with console.capture() as capture:
        console.print(field_table(found["rows"][:3]))
        console.print(paired_table([t for t in found["paired"] if t["planned"]]))
        console.print(reasons_table(found["reasons"]))
    text = capture.get()
    row = found["rows"][1]
    line = next(line for line in text.splitlines() if line.startswith("lm "))
    assert f"{100 * row['success']:.2f}" in line
    assert f"{row['p99_ms']:.3f}" in line
    assert "near_limits: 20 targets" in text
    assert "turned away" in text
    assert "100.0" in text
    markdown = figures_markdown(found)
    assert f"| lm | {100 * row['success']:.2f} |" in markdown


def test_a_failure_is_told_in_words(compared: tuple[Comparison, list[Sequence[Answers]]]) -> None:
    answers = compared[1][0][0]
    results = outcomes(answers)
    k = next(k for k, outcome in enumerate(results) if outcome is Outcome.OUTSIDE)
    text = why(answers, k, results[k], place="3 of 9")
    assert "Failure 3 of 9" in text
    assert f"target {k} of `near_limits`" in text
    assert "JOINT_LIMITS" in text
    assert f"{answers.items[k].verdict.limit_excess:.3g} rad" in text


def test_the_recording_shows_each_failure_once_and_no_more_than_asked(
    compared: tuple[Comparison, list[Sequence[Answers]]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fields = compared[1]
    bad = sum(outcome not in GOOD for field in fields[:2] for outcome in outcomes(field[0]))
    assert bad > 5
    for most, expected in ((200, bad), (5, 5)):
        monkeypatch.setattr(failure_log, "MOST", most)
        path = tmp_path / f"{most}.rrd"
        log = FailureLog(path, PANDA, list(SOLVERS))
        log.write(fields, "# Figures")
        log.close()
        rows = dict.fromkeys(("/dls/why", "/dls/gap", "/dls/arm/link7"), 0)
        points = 0
        for chunk in RrdReader(path).stream():
            entity = str(chunk.entity_path).replace("\\", "")
            if entity in rows and not chunk.is_static:
                rows[entity] += chunk.num_rows
            if entity.startswith("/dls/targets/"):
                batch = chunk.to_record_batch()
                column = next(name for name in batch.schema.names if "positions" in name)
                points += sum(len(row) for row in batch.column(column).to_pylist())
        assert set(rows.values()) == {expected}
        assert points == 40


def test_the_arm_is_drawn_where_the_answer_was(
    compared: tuple[Comparison, list[Sequence[Answers]]], tmp_path: Path
) -> None:
    answers = compared[1][0][0]
    first = next(k for k, outcome in enumerate(outcomes(answers)) if outcome not in GOOD)
    log = FailureLog(tmp_path / "ik.rrd", PANDA, ["dls"])
    log.write([[answers]], "")
    log.close()
    for chunk in RrdReader(tmp_path / "ik.rrd").stream():
        if str(chunk.entity_path) == "/dls/gap" and not chunk.is_static:
            batch = chunk.to_record_batch()
            column = next(name for name in batch.schema.names if "strips" in name)
            tool, target = batch.column(column).to_pylist()[0][0]
            np.testing.assert_allclose(
                tool, ARM.pose(answers.items[first].q).translation(), atol=1e-6
            )
            wanted = answers.targets.targets[first].translation()
            np.testing.assert_allclose(target, wanted, atol=1e-6)
            return
    pytest.fail("no gap is drawn")
