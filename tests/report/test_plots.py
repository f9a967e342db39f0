"""The picture of a run."""

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from robo47_qp.errors import RecordingError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report import run_plot
from robo47_qp.report.run_plot import plot_run
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.recording import Rows
from tests.runs import picked_and_placed


def test_a_picture_of_the_promised_size_is_drawn(tmp_path: Path) -> None:
    path = tmp_path / "run.png"
    plot_run(picked_and_placed(), path)
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", data[16:24]) == (1320, 792)
    picture = imread(path)
    # Something is drawn in each quarter.
    for half in (picture[:396], picture[396:]):
        for quarter in (half[:, :660], half[:, 660:]):
            assert (quarter[..., :3].min(axis=2) < 0.8).mean() > 0.005


def test_another_run_is_another_picture(tmp_path: Path) -> None:
    run = picked_and_placed()
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows["errors/q"][1000:1500] += 0.01
    plot_run(run, tmp_path / "one.png")
    plot_run(replace(run, rows=rows), tmp_path / "two.png")
    one, two = imread(tmp_path / "one.png"), imread(tmp_path / "two.png")
    assert np.abs(one - two).max() > 0.5


def test_curves_have_the_units_of_their_labels(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(run_plot, "_save", lambda figure, _: drawn.append(figure))
    run = picked_and_placed()
    plot_run(run, Path("unused.png"))
    curves = {axes.get_ylabel(): axes.get_lines() for axes in drawn[0].axes}
    assert len(run.rows) > 1000
    for label, signal, scale in (
        ("joint error [mrad]", "errors/q", 1e3),
        ("tool error [mm]", "errors/tool_position", 1e3),
        ("torque [% of limit]", "joints/tau", 100.0 / PANDA.tau_max),
    ):
        expected = run.rows[signal] * scale
        shown = [np.asarray(line.get_ydata()) for line in curves[label]][: expected.shape[1]]
        np.testing.assert_allclose(np.transpose(shown), expected, rtol=1e-12)


def test_a_failure_is_drawn_too(tmp_path: Path) -> None:
    failure = Failure(cause=Cause.PLACE, evidence="far away")
    plot_run(replace(picked_and_placed(), failure=failure), tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 10_000


def test_a_place_that_cannot_be_written_to_is_told(tmp_path: Path) -> None:
    path = tmp_path / "file" / "run.png"
    path.parent.write_text("not a folder")
    with pytest.raises(RecordingError, match=r"The plot .*run\.png cannot be written"):
        plot_run(picked_and_placed(), path)


def test_a_kind_of_picture_that_nobody_can_draw_is_told(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"The plot .*run\.foo cannot be written"):
        plot_run(picked_and_placed(), tmp_path / "run.foo")
