"""The picture of a run."""

import struct
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from robo47_qp.errors import RecordingError
from robo47_qp.model.robot import Tool
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.drawing import Picture, draw
from robo47_qp.report.run_plot import Plotter, picture_of, plot_run
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.phase import Phase
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


def test_curves_have_the_units_of_their_labels() -> None:
    run = picked_and_placed()
    figure = draw(Picture.unpacked(picture_of(run).packed()))
    curves = {axes.get_ylabel(): axes.get_lines() for axes in figure.axes}
    assert len(run.rows) > 1000
    for label, signal, scale in (
        ("joint error [mrad]", "errors/q", 1e3),
        ("tool error [mm]", "errors/tool_position", 1e3),
        ("torque [% of limit]", "joints/tau", 100.0 / PANDA.tau_max),
    ):
        expected = run.rows[signal] * scale
        shown = [np.asarray(line.get_ydata()) for line in curves[label]][: expected.shape[1]]
        np.testing.assert_allclose(np.transpose(shown), expected, rtol=1e-12)


def test_all_tools_are_drawn() -> None:
    """Each with its own path and error, in the colour that its name has."""
    one = picked_and_placed()
    other = Tool(name="right", tcp=PANDA.tcp)
    pair = replace(one.scenario.robot, tool_name="left", more_tools=(other,))
    more = {
        "tool/right_pose": one.rows["tool/pose"] + 0.1,
        "tool/right_pose_ref": one.rows["tool/pose_ref"] + 0.2,
        "errors/right_tool_position": one.rows["errors/tool_position"] + 1e-3,
    }
    like = {signal.name.replace("tool/", "tool/right_"): signal for signal in one.rows.signals}
    like |= {name.replace("errors/", "errors/right_"): signal for name, signal in like.items()}
    signals = (*one.rows.signals, *(replace(like[name], name=name) for name in more))
    rows = Rows(signals, np.hstack([one.rows.values, *more.values()]))
    run = replace(one, rows=rows, scenario=replace(one.scenario, robot=pair))
    figure = draw(Picture.unpacked(picture_of(run).packed()))
    above, *_ = figure.axes
    found = {str(line.get_label()): line for line in above.get_lines()}
    for name, signal in (("left", "tool/pose"), ("right", "tool/right_pose")):
        at = found[f"{name}, measured"].get_xydata()
        np.testing.assert_allclose(np.asarray(at), run.rows[signal][:, :2], rtol=1e-12)
    asked = [line for line in above.get_lines() if line.get_color() == "#c2410c"]
    for line, signal in zip(asked, ("tool/pose_ref", "tool/right_pose_ref"), strict=True):
        np.testing.assert_allclose(np.asarray(line.get_xydata()), run.rows[signal][:, :2])
    errors = next(axes for axes in figure.axes if axes.get_ylabel() == "tool error [mm]")
    lines = errors.get_lines()[:2]
    assert [line.get_label() for line in lines] == ["left", "right"]
    for line, label in zip(lines, ("", "right_"), strict=True):
        expected = 1e3 * run.rows[f"errors/{label}tool_position"][:, 0]
        np.testing.assert_allclose(np.asarray(line.get_ydata()), expected, rtol=1e-12)
        assert line.get_color() == found[f"{line.get_label()}, measured"].get_color()
    assert lines[0].get_color() != lines[1].get_color()
    for axes, entries in ((above, 4), (errors, 2)):
        legend = axes.get_legend()
        assert legend is not None
        assert len(legend.get_texts()) == entries
    assert picture_of(one).words["tools"] == ["tool"]


def test_a_phase_that_ended_in_its_first_period_is_drawn_without_a_row() -> None:
    """As of a motion that a real arm refuses, or whose first torque is no number."""
    run = picked_and_placed()
    last = Phase(name="refused", start=len(run.rows), leg=None)
    found = picture_of(replace(run, phases=[*run.phases, last]))
    assert found.words["phases"][-1] == "refused"
    figure = draw(found)
    axes = next(axes for axes in figure.axes if axes.get_ylabel() == "tool error [mm]")
    marks = [line for line in axes.get_lines() if line.get_linestyle() == ":"]
    assert len(marks) == len(run.phases) - 1


def test_names_of_short_phases_do_not_run_into_each_other() -> None:
    found = picture_of(picked_and_placed())
    rows = len(found.numbers["time"])
    names = ["descend", "follow", "descend", "follow", "descend", "a long way", "no", "home"]
    starts = (np.array([0.0, 0.06, 0.12, 0.18, 0.24, 0.3, 0.7, 0.72]) * rows).astype(int)
    figure = draw(
        Picture({**found.words, "phases": names}, {**found.numbers, "starts": starts}),
    )
    axes = next(axes for axes in figure.axes if axes.get_ylabel() == "tool error [mm]")
    figure.draw_without_rendering()
    assert [text.get_text() for text in axes.texts] == [name for name in names if name != "no"]
    boxes = [text.get_window_extent() for text in axes.texts]
    assert [(i, j) for i, a in enumerate(boxes) for j in range(i) if a.overlaps(boxes[j])] == []


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


@pytest.fixture
def apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Matplotlib is not loaded, as far as a `Plotter` sees."""
    monkeypatch.delitem(sys.modules, "matplotlib.figure")


@pytest.mark.usefixtures("apart")
def test_a_process_of_its_own_draws_the_same(tmp_path: Path) -> None:
    run = picked_and_placed()
    with closing(Plotter(tmp_path / "one.png")) as plotter:
        plotter.take(run)
        plotter.finish()
    plot_run(run, tmp_path / "two.png")
    np.testing.assert_array_equal(imread(tmp_path / "one.png"), imread(tmp_path / "two.png"))


@pytest.mark.usefixtures("apart")
def test_a_process_of_its_own_tells_what_it_cannot_write(tmp_path: Path) -> None:
    with closing(Plotter(tmp_path / "none" / "run.png")) as plotter:
        plotter.take(picked_and_placed())
        with pytest.raises(RecordingError, match=r"The plot .*run\.png cannot be written: .*none"):
            plotter.finish()


@pytest.mark.usefixtures("apart")
def test_a_plotter_without_a_run_writes_nothing_and_ends(tmp_path: Path) -> None:
    plotter = Plotter(tmp_path / "run.png")
    plotter.close()
    assert plotter._process is not None
    assert plotter._process.returncode is not None
    assert not list(tmp_path.iterdir())


def test_objects_are_told_apart_and_the_legend_lies_over_none() -> None:
    found = picture_of(picked_and_placed())
    two = np.repeat(found.numbers["objects"], 2, axis=1)
    picture = Picture({**found.words, "objects": ["one", "two"]}, {**found.numbers, "objects": two})
    figure = draw(picture)
    figure.draw_without_rendering()
    axes = next(axes for axes in figure.axes if axes.get_ylabel() == "y [m]")
    marks = {str(line.get_label()): line.get_marker() for line in axes.get_lines()}
    assert marks["one"] != marks["two"]
    legend = axes.get_legend()
    assert legend is not None
    box = legend.get_window_extent()
    path = axes.transData.transform(found.numbers["at"][:, 0, :2])
    assert not box.count_contains(path)


@pytest.mark.parametrize("count", [7, 14])
def test_the_names_of_all_joints_have_room_in_their_panel(count: int) -> None:
    """Those of two arms do not fit into a row; what shares a colour differs in its dashes."""
    found = picture_of(picked_and_placed())
    names = [f"right_joint{i}" for i in range(count)]
    wide = {
        name: np.resize(found.numbers[name], (len(found.numbers["time"]), count))
        for name in ("q", "tau")
    }
    figure = draw(Picture({**found.words, "joints": names}, {**found.numbers, **wide}))
    axes = next(axes for axes in figure.axes if axes.get_ylabel().startswith("joint error"))
    figure.draw_without_rendering()
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == names
    box, panel = legend.get_window_extent(), axes.get_window_extent()
    assert panel.x0 <= box.x0 < box.x1 <= panel.x1
    looks = {(line.get_color(), line.get_linestyle()) for line in axes.get_lines()[:count]}
    assert len(looks) == count
