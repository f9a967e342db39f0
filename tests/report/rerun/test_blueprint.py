"""The layout of a recording: each plot shows what is recorded, of every tool."""

from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from robo47_qp.ik.stream.settings import Event
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.report.rerun import blueprint
from robo47_qp.report.rerun.columns import component
from robo47_qp.report.rerun.log import RerunLog
from robo47_qp.run.recording import Rows
from robo47_qp.run.signals import all_signals
from robo47_qp.sim.signal import POSE
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.robots import hinge6

ROBOTS = {"one": PANDA, "several": panda_pair(), "bare": hinge6()}


def sizes(path: Path, shown: Iterable[str]) -> dict[str, int]:
    """How many numbers the columns of a recording have in a row."""
    found: dict[str, set[int]] = defaultdict(set)
    for chunk in RrdReader(path).stream().to_chunks():
        if str(chunk.entity_path) in ("/signals", "/limits"):
            batch = chunk.to_record_batch()
            for name in batch.schema.names:
                if name in shown:
                    found[name] |= {len(row) for row in batch.column(name).to_pylist()}
    return {name: size for name, (size,) in found.items()}


def lines_of(robot: Robot, monkeypatch: pytest.MonkeyPatch, **options: bool) -> list[Any]:
    shown: list[Any] = []
    lines = blueprint._lines

    def spy(*arguments: Any) -> Any:
        shown.append(arguments)
        return lines(*arguments)

    monkeypatch.setattr(blueprint, "_lines", spy)
    blueprint.blueprint(robot, **options)
    return shown


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_plots_show_what_is_recorded(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = Simulation(robot, PickPlace().build_scene)
    signals = all_signals(world)
    rows = Rows(signals, np.zeros((3, sum(len(signal.labels) for signal in signals))))
    rows["time"][:, 0] = [0.0, 1e-3, 2e-3]
    for signal in signals:
        if signal.labels == POSE:
            rows[signal.name][:, 3] = 1.0
    log = RerunLog(tmp_path / "run.rrd", world.model, robot, signals)
    log.write(rows)
    log.finish("done")
    shown = lines_of(robot, monkeypatch)
    held = sizes(tmp_path / "run.rrd", {component(name) for name, *_ in shown})
    for name, labels, colours, _ in shown:
        assert held[component(name)] == len(labels) == len(colours)
    kinds = ("errors/", "gripper/", "contact/")
    unshown = {
        signal.name for signal in signals if signal.shown and signal.name.startswith(kinds)
    } - {name for name, *_ in shown}
    assert all(name.endswith(("friction_use", "fixed")) for name in unshown)


def test_lines_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """By tool where there are several, and in colours of their own; what is under, has those."""
    shown = {
        name: ([*labels], colours)
        for name, labels, colours, _ in lines_of(ROBOTS["several"], monkeypatch)
    }
    assert shown["errors/tool_angle"][0] == ["left"]
    assert shown["errors/right_tool_angle"][0] == ["right"]
    assert shown["gripper/right_width_command"][0] == ["right command"]
    assert shown["contact/right_tool"][0] == ["right x", "right y", "right z"]
    forces = [shown[name][1] for name in ("contact/tool", "contact/right_tool", "contact/links")]
    assert len({colour for colours in forces for colour in colours}) == 7
    widths = [shown[f"gripper/{label}width"][1][0] for label in ("", "right_")]
    commands = [shown[f"gripper/{label}width_command"][1][0] for label in ("", "right_")]
    assert widths[0] != widths[1]
    for width, commanded in zip(widths, commands, strict=True):
        np.testing.assert_array_equal(np.array(width) // 2, commanded)
    one = {name: [*labels] for name, labels, *_ in lines_of(PANDA, monkeypatch)}
    assert (one["gripper/width"], one["contact/tool"][2]) == (["width"], "tool z")


def test_a_stream_shows_what_it_follows(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = {name: labels for name, labels, *_ in lines_of(PANDA, monkeypatch, followed=True)}
    assert {"target/position_error", "target/angle_error"} <= set(shown)
    assert len(shown["target/events"]) == len(Event)
    assert not any(name.startswith("gripper") for name in shown)
