"""Lines that one spot would slow down as a whole: a joint comes to its limit, others take over."""

from typing import Any

import numpy as np
import pytest

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError, RefusalReason
from robo47_qp.ik.qp import QpIk
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.following.lin import Lin
from robo47_qp.motion.paths.segments import PathProfile
from robo47_qp.motion.refusals import PathError
from robo47_qp.motion.timing.rest_to_rest import Quintic
from robo47_qp.motion.timing.retiming import Timing
from robo47_qp.motion.trajectory import Trajectory
from tests.examples import shifted
from tests.motion.test_lin import check_joints, off_line
from tests.plain_arm import PlainArm

DT = 1e-3
IK = QpIk()
STARTS = {
    "the limit is met": np.array([-0.544, -0.056, 1.171, -2.479, 0.082, 2.455, 2.667]),
    "it is met soon": np.array([-0.52, -0.12, 1.30, -2.57, 0.29, 2.39, 2.56]),
}
DOWN = np.array([0.0, 0.0, -0.16])


@pytest.fixture
def arm() -> Arm:
    return Arm(PANDA)


def planned(arm: Arm, q: Vector, pace: float = 1.0, lin: Lin | None = None) -> Trajectory:
    goal, profile = shifted(arm.pose(q), DOWN), PANDA.profile.slowed(pace)
    return (lin or Lin()).plan(arm, IK, q, goal, profile, DT, pace)[0]


def stretched(arm: Arm, q: Vector, monkeypatch: pytest.MonkeyPatch) -> Trajectory:
    """The same line, slowed as a whole."""
    with monkeypatch.context() as patch:
        patch.setattr("robo47_qp.motion.following.lin._UNEVEN", np.inf)
        return planned(arm, q)


def tool(trajectory: Trajectory) -> Matrix:
    plain = PlainArm(PANDA)
    return np.array([plain.tool(q)[0] for q in trajectory.q])


@pytest.mark.parametrize("start", STARTS)
def test_only_around_the_spot_is_it_slow(
    arm: Arm, start: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    q = STARTS[start]
    slow, uneven = stretched(arm, q, monkeypatch), planned(arm, q)
    assert slow.duration > 10.0
    assert uneven.duration < 0.5 * slow.duration
    assert 0.97 < check_joints(uneven, PANDA.profile) <= 1.02
    goal = shifted(arm.pose(q), DOWN)
    away, askew = off_line(PlainArm(PANDA), uneven.q[::7], arm.pose(q), goal)
    assert away < 1e-5
    assert askew < 1e-5
    assert ((uneven.q >= arm.q_min) & (uneven.q <= arm.q_max)).all()
    np.testing.assert_array_equal(uneven.q[0], q)
    np.testing.assert_allclose(uneven.q[-1], slow.q[-1], atol=1e-12)
    for rate in (uneven.v, uneven.a):
        np.testing.assert_array_equal(rate[[0, -1]], 0.0)


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("pace", [1.0, 0.4])
def test_the_tool_keeps_its_own_bounds(arm: Arm, start: str, pace: float) -> None:
    profile = PathProfile(linear=(0.08, 0.75, 5.0))
    place = tool(planned(arm, STARTS[start], pace, Lin(profile=profile)))
    for order, bound in enumerate(profile.slowed(pace).linear, start=1):
        rate = np.linalg.norm(np.diff(place, order, axis=0), axis=1) / DT**order
        # What the spline leaves of the line, some micrometres, shows in the higher ones.
        assert rate.max() <= bound * (1.02 if order < 3 else 1.1)
        assert rate.max() > 0.95 * bound or order > 1


def test_at_half_the_pace_it_takes_twice_as_long(arm: Arm) -> None:
    q = STARTS["the limit is met"]
    assert planned(arm, q, 0.5).duration == pytest.approx(2.0 * planned(arm, q).duration, rel=1e-2)


def test_a_law_that_was_asked_for_is_kept(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    q = STARTS["the limit is met"]
    slow = stretched(arm, q, monkeypatch).duration
    assert planned(arm, q, lin=Lin(law=Quintic())).duration > 0.9 * slow


def test_an_even_line_is_the_same_as_ever(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Slowed everywhere alike there is nothing to save."""
    goal = shifted(arm.pose(arm.home), np.array([0.1, -0.2, -0.1]))
    profile = PANDA.profile.slowed(0.3)
    plans = [Lin().plan(arm, IK, arm.home, goal, profile, DT)[0]]
    monkeypatch.setattr("robo47_qp.motion.following.lin._UNEVEN", np.inf)
    plans.append(Lin().plan(arm, IK, arm.home, goal, profile, DT)[0])
    assert plans[0].duration > 2.0 * Lin().profile.least_time(0.25, 0.0)
    assert plans[0].q.tobytes() == plans[1].q.tobytes()


def test_where_no_timing_by_sections_is_found_the_even_one_is_kept(
    arm: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    q = STARTS["the limit is met"]
    even = stretched(arm, q, monkeypatch)

    def none(*_: object) -> Trajectory:
        raise PathError(0.0, "the bounds leave next to no motion", RefusalReason.PACE)

    monkeypatch.setattr(Timing, "timed", none)
    np.testing.assert_array_equal(planned(arm, q).q, even.q)


@pytest.mark.parametrize("bad", [{"shares": ()}, {"shares": (0.5, np.nan)}, {"rounds": 0}])
def test_a_timing_without_sense_is_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(InvalidValueError, match=next(iter(bad))):
        Timing(**bad)
