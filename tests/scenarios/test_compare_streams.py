"""DLS against QP as streams: both keep joint limits, only the QP keeps its distances."""

import json
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from mink import SE3
from rich.console import Console

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.benchmarks.ik.dls_stream import DlsStream
from robo47_qp.ik.stream.stream import StreamIk
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.motion.waypoint import tool_down
from scenarios import compare_streams
from scenarios.compare_streams import CompareOptions, gentle


def test_a_short_comparison_is_printed_and_written(tmp_path: Path) -> None:
    console = Console(width=80, record=True, file=StringIO())
    file = tmp_path / "streams.json"
    assert compare_streams.run(CompareOptions(ticks=60, report=file), console) == 0
    figures = json.loads(file.read_text())["figures"]
    kinds = {(one["robot"], one["targets"], one["stream"]) for one in figures}
    assert len(figures) == len(kinds) == 12
    assert sum(one["limit_violations"] for one in figures) == 0
    assert sum(one["clearance_violations"] for one in figures if one["stream"] == "qp") == 0
    assert all(len(line.rstrip()) <= 80 for line in console.export_text().splitlines()[:13])


def test_dls_reaches_a_target_and_repels_in_its_null_space() -> None:
    arm = Arm(PANDA)
    target = tool_down([0.5, 0.1, 0.4])
    ends = []
    for repulsion in (0.0, 2.0):
        stream = DlsStream(settings=StreamIk(clearance=0.01), repulsion=repulsion).build(arm)
        for _ in range(1500):
            stream.tick(target)
        assert stream.tick(target)[3] < 1e-4
        ends.append(stream.q)
    assert np.abs(ends[0] - ends[1]).max() > 1e-3


def test_gentle_targets_begin_where_the_tools_are_and_move_slowly() -> None:
    arm = Arm(PANDA)
    found = gentle(arm, np.random.default_rng(0))
    p = np.array([next(found).translation() for _ in range(3000)])  # type: ignore[attr-defined]
    np.testing.assert_allclose(p[0], arm.pose(arm.home).translation(), atol=1e-12)
    assert np.linalg.norm(np.diff(p, axis=0), axis=1).max() / 1e-3 < 0.6


def test_no_ticks_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="--ticks must be"):
        CompareOptions(ticks=0)


def test_an_arm_with_a_joint_at_its_limit_waits_and_the_other_goes_on() -> None:
    stream = DlsStream(settings=StreamIk()).build(Arm(panda_pair()))
    wanted, high = np.full(14, 0.5), np.ones(14)
    high[3] = 0.0
    v = stream._scaled(wanted, -np.ones(14), high)
    np.testing.assert_array_equal(v, [0.0] * 7 + [0.5] * 7)


def test_clamped_joints_go_on_where_scaled_ones_wait() -> None:
    """Towards a target that one joint cannot go to any further."""
    arm = Arm(PANDA)
    q = arm.home.copy()
    q[3] = arm.q_max[3] - 1e-4
    target = SE3.from_translation(np.array([0.1, 0.0, 0.0])) @ arm.pose(q)
    went = {}
    for clamped in (False, True):
        stream = DlsStream(settings=StreamIk(), clamped=clamped).build(arm)
        stream.q = q.copy()
        for _ in range(300):
            stream.tick(target)
        assert arm.limit_margin(stream.q) >= 0.0
        went[clamped] = float(np.abs(stream.q - q).max())
    assert went[True] > 10.0 * went[False]
