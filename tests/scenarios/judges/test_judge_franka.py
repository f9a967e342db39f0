"""The motions that franka-sim judges, what is told of them, and the table of a page."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mink import SE3

from robo47_qp.errors import InvalidValueError
from robo47_qp.motion.waypoint import Motion, Waypoint
from robo47_qp.run.failure import Cause, Failure, StepFailed
from scenarios import judge_franka
from scenarios.judge_franka import JudgeOptions, jump, summary, tracked_worse
from scenarios.judges.franka_motions import HIGH, LOW, TILT, RandomMotions
from scenarios.papers import judges

ORIGIN = {"commit": "0123456789abcdef", "date": "2026-01-02"}


class AtHome:
    def tool_pose(self) -> SE3:
        return SE3.from_translation(np.array([0.4, 0.0, 0.4]))


def drawn(count: int, refused: Mapping[int, Cause] = {}) -> tuple[list[Waypoint], Any]:
    """The waypoints that a program yields, and its value; the refused ones by their number."""
    home: Any = AtHome()
    program = RandomMotions(draw=3, count=count).program(home)
    found: list[Waypoint] = []
    failed: StepFailed | None = None
    try:
        while True:
            step = next(program) if failed is None else program.throw(failed)
            cause = refused.get(len(found))
            refusal = Failure(cause=cause or Cause.PLAN, evidence="refused")
            failed = None if cause is None else StepFailed(refusal)
            assert isinstance(step, Waypoint)
            found.append(step)
    except StopIteration as end:
        return found, end.value


def test_goals_are_in_the_box_and_kinds_take_turns() -> None:
    found, failure = drawn(60)
    assert failure is None
    assert [w.motion for w in found] == 20 * [Motion.PTP, Motion.LIN, Motion.CIRC]
    for waypoint in found:
        assert isinstance(waypoint.target, SE3)
        for point in (waypoint.target.translation(), waypoint.through):
            if point is not None:
                assert ((point >= LOW) & (point <= HIGH)).all()
        z = waypoint.target.rotation().as_matrix()[:, 2]
        assert np.arccos(-z[2]) <= TILT + 1e-9
        assert (waypoint.through is not None) == (waypoint.motion is Motion.CIRC)


def test_what_cannot_be_planned_is_drawn_anew_and_what_stops_the_arm_is_not() -> None:
    found, failure = drawn(3, {1: Cause.IK, 2: Cause.PLAN})
    assert failure is None
    assert [w.motion for w in found] == [Motion.PTP, *3 * [Motion.LIN], Motion.CIRC]
    with pytest.raises(StepFailed):
        drawn(3, {1: Cause.TRACK})
    _, failure = drawn(3, dict.fromkeys(range(1, 99), Cause.PLAN))
    assert failure.evidence == "no motion 1 was found"


def test_time_that_has_passed_is_told_by_the_joints() -> None:
    t = np.array([0.0, 1.0, 2.0, 9.0, 10.0]) * 1e-3
    v = np.array([0.5, -1.0])
    q, still = t[:, None] * v, np.zeros((5, 2))
    assert jump(q, still + v) == pytest.approx(7e-3)
    assert jump(still, still) == 0.0


def motion(largest: float, **more: Any) -> dict[str, Any]:
    one = {"kind": "LIN", "largest": largest, "tool": 0.5, "jump": 1e-3}
    return {**one, "rates": np.array([1.0, 0.9]), "squares": np.array([[1.0, 9.0]]), **more}


MOTIONS = [motion(1.0), motion(3.0), motion(5.0, jump=8e-3, rates=np.array([0.8]))]


def test_figures_of_some_motions() -> None:
    row = summary("LIN", MOTIONS)
    assert (row["done"], row["within"], row["even"], row["even_within"]) == (3, 1, 2, 1)
    assert (row["rate_min"], row["rate_median"], row["largest"]) == (0.8, 0.9, 5.0)
    assert row["rms"] == pytest.approx(np.sqrt(5.0))
    assert row["jump"] == pytest.approx(8.0)
    assert summary("LIN", [])["largest"] is None


def test_motions_that_are_tracked_worse_than_asked_for_are_told() -> None:
    more = {"motion": 2, "joint": 5, "at": 0.2, "seconds": 1.5, "lost": 0}
    found = tracked_worse(7, [motion(2.0, **more), motion(2.1, **more)])
    assert found == [{"seed": 7, "kind": "LIN", "largest": 2.1, "jump": 1e-3, **more}]


def test_the_table_has_a_row_for_each_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {
        **ORIGIN,
        "rows": [summary("PTP", []), summary("LIN", MOTIONS)],
        "reflexes": 1,
        "stops": ["7: joint_reflex: told", "8: gone"],
        "pace": 0.5,
        "clock": 0.25,
        "worse": [
            {"seed": 7, "motion": 2, "kind": "LIN", "largest": 3.0}
            | {"joint": 5, "jump": 2e-3, "lost": 4}
        ],
        "real_time": {"server": True, "client": False},
        "seeds": [7, 8],
    }
    monkeypatch.setattr(judges, "is_kept", lambda name: name == "judge_franka")
    monkeypatch.setattr(judges, "kept", {"judge_franka": found}.__getitem__)
    only, _, told, _, worse = judges.franka().splitlines()[2:]
    cells = [cell.strip() for cell in only.split("|")][1:-1]
    assert cells[:5] == ["LIN", "3", "0.80, 0.90", "5.00 mrad", "2.24 mrad"]
    assert cells[5:] == ["1", "2", "1", "8.0 ms"]
    assert told.startswith("Reflexes: 1; runs that stopped: 2. Pace 0.5, without real-time")
    assert "; the clock of franka-sim at 0.25 of its pace. " in told
    assert worse == (
        "Tracked worse: motion 2 of seed 7 (LIN, joint 5: 3.00 mrad, longest period 2.0 ms, "
        "4 commands late)."
    )


def test_what_cannot_be_judged_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(judge_franka, "JUDGE", tmp_path / "python")
    with pytest.raises(InvalidValueError, match="make judges"):
        JudgeOptions()


@pytest.mark.parametrize("kinds", [(), ("FOO",), ("PTP", "FOO")])
def test_kinds_of_motion_that_there_are_not_are_refused(kinds: tuple[str, ...]) -> None:
    with pytest.raises(InvalidValueError, match="kinds must be some of PTP, LIN, CIRC"):
        RandomMotions(kinds=kinds)
