"""What planning is given is checked before anything is planned."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from mink import SE3

from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.stream.stream import StreamIk
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.robot import MotionProfile
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.tool_poses import ToolPoses
from robo47_qp.motion.planner import Planner
from robo47_qp.motion.smooth_stream import SmoothStream
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.timing.stopping import stop
from robo47_qp.motion.waypoint import Motion, Waypoint
from robo47_qp.stack import ClassicalStack

ARM, DT = Arm(PANDA), 1e-3
HOME = ARM.pose(ARM.home)
THERE = SE3.from_translation(np.array([0.1, 0.0, -0.1])) @ HOME
THROUGH = HOME.translation() + np.array([0.08, 0.0, -0.02])
STILL = np.zeros(ARM.n)
SIX = MotionProfile.uniform(6, v=1.0, a=1.0, j=1.0)
ONE = MotionProfile.uniform(1, v=1.0, a=1.0, j=1.0)
WAYPOINTS = [
    Waypoint(name="ptp", target=THERE),
    Waypoint(name="lin", target=THERE, motion=Motion.LIN),
    Waypoint(name="circ", target=THERE, motion=Motion.CIRC, through=THROUGH),
]


def planner(profile: MotionProfile = PANDA.profile) -> Planner:
    return Planner(ik=ClassicalStack().solver(), profile=profile)


@pytest.mark.parametrize("dt", [0.0, -1e-3, np.nan, np.inf])
@pytest.mark.parametrize("waypoint", WAYPOINTS, ids=lambda one: one.name)
def test_a_period_is_positive(waypoint: Waypoint, dt: float) -> None:
    with pytest.raises(InvalidValueError, match="dt must be"):
        planner().plan(ARM, waypoint, ARM.home, dt)
    passed = Waypoint(name="passed", target=THERE, stop=False)
    with pytest.raises(InvalidValueError, match="dt must be"):
        planner().plan_chain(ARM, [passed, Waypoint(name="end", target=HOME)], ARM.home, dt)


@pytest.mark.parametrize("profile", [SIX, ONE], ids=["six", "one"])
def test_a_profile_is_of_all_joints(profile: MotionProfile) -> None:
    asked: list[Callable[[], Any]] = [
        *(lambda one=one: planner(profile).plan(ARM, one, ARM.home, DT) for one in WAYPOINTS),
        lambda: plan_ptp(ARM.home, ARM.home + 0.1, profile, DT),
        lambda: stop(ARM, JointReference(ARM.home, STILL, STILL), profile, DT),
    ]
    for ask in asked:
        with pytest.raises(InvalidValueError, match="those of all 7 joints"):
            ask()
    with pytest.raises(InvalidValueError, match="those of all 6 joints"):
        plan_ptp(ARM.home, ARM.home[:6], PANDA.profile, DT)


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (lambda bad: Waypoint(name="w", target=HOME, motion=Motion.LIN, holding=bad), "holding"),
        (lambda bad: ToolPoses([bad]), "a mapping from the names of tools"),  # type: ignore[arg-type]
        (lambda bad: Arm(PANDA, obstacles=[bad]), "a sequence of Obstacle"),
        (lambda _: SmoothStream(StreamIk().build(ARM), 0), "window must be"),
        (lambda _: SmoothStream(StreamIk().build(ARM), 2.5), "window must be"),  # type: ignore[arg-type]
    ],
)
def test_what_is_no_such_thing_is_told(make: Callable[[Any], object], found: str) -> None:
    with pytest.raises(InvalidValueError, match=found):
        make(HOME)
