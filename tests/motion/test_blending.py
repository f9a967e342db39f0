from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.errors import PlanError, RefusalReason
from robo47_qp.evaluation.benchmarks.motion.motion_check import violations
from robo47_qp.evaluation.benchmarks.motion.reference_kinematics import ReferenceKinematics
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.blending import Corner, cut_corners, least_with_stops, quickest
from robo47_qp.motion.paths.segments import PathProfile
from robo47_qp.motion.planner import Planner, split_at
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.waypoint import Motion, Waypoint

ARM, DT, LOOK = Arm(PANDA), 1e-3, ReferenceKinematics(PANDA)
PLANNER = Planner(
    ik=MultiStart(solver=LmIk(max_iterations=30, stall=Stall())), profile=PANDA.profile
)
Times = Callable[[frozenset[int]], float]


def walk(rng: np.random.Generator, motion: Motion, radius: float) -> list[Waypoint]:
    pose, run = ARM.pose(ARM.home), []
    for k in range(3):
        shift, turn = rng.normal(0.0, 0.1, 3), rng.normal(0.0, 0.2, 3)
        rotation = pose.rotation() @ SO3.exp(turn)
        pose = SE3.from_rotation_and_translation(rotation, pose.translation() + shift)
        run.append(
            Waypoint(name=str(k), target=pose, motion=motion, blend=radius if k < 2 else 0.0)
        )
    return run


@pytest.mark.parametrize(("motion", "least"), [(Motion.PTP, 0.05), (Motion.LIN, 0.005)])
def test_blending_never_takes_longer_than_stopping(motion: Motion, least: float) -> None:
    rng, planned, saved = np.random.default_rng(2), 0, 0.0
    for radius in (0.003, 0.01, 0.02, 0.03, 0.04, 0.02):
        run = walk(rng, motion, radius)
        rested = [Waypoint(name=w.name, target=w.target, motion=motion) for w in run]
        try:
            legs = PLANNER.plan_chain(ARM, run, ARM.home, DT)
        except PlanError:
            continue
        stopping = PLANNER.plan_chain(ARM, rested, ARM.home, DT)
        took = [sum(leg.trajectory.steps for leg in one) for one in (legs, stopping)]
        assert took[0] <= took[1]
        saved += 1.0 - took[0] / took[1]
        planned += 1
        assert violations(LOOK, legs, PANDA.profile) == []
        for leg in legs[:-1]:
            assert leg.stops == (not leg.trajectory.v[-1].any())
    assert planned >= 3
    assert saved > least * planned


def plans(times: Times) -> tuple[list[frozenset[int]], Callable[[frozenset[int]], frozenset[int]]]:
    asked: list[frozenset[int]] = []

    def plan(stops: frozenset[int]) -> frozenset[int]:
        asked.append(stops)
        if times(stops) < 0.0:
            raise PlanError("somewhere", "no")
        return stops

    return asked, plan


def test_corners_are_stopped_at_one_by_one_where_that_is_quicker() -> None:
    """Blending costs 3 at the first corner and saves 1 at the second."""

    def time(stops: frozenset[int]) -> float:
        return 10.0 - 3.0 * (0 in stops) + 1.0 * (1 in stops)

    asked, plan = plans(time)
    assert quickest([0, 1], plan, time, 8.0) == {0}
    assert asked[:2] == [frozenset(), frozenset({0, 1})]


def test_what_is_quicker_than_any_stop_is_taken_at_once() -> None:
    asked, plan = plans(lambda _: 5.0)
    assert quickest([0, 1], plan, lambda _: 5.0, 5.0) == frozenset()
    assert asked == [frozenset()]


def test_without_corners_there_is_one_plan() -> None:
    asked, plan = plans(lambda _: 5.0)
    assert quickest([], plan, lambda _: 5.0, 0.0) == frozenset()
    assert len(asked) == 1


def test_a_plan_with_stops_that_is_refused_is_none() -> None:
    def time(stops: frozenset[int]) -> float:
        return 10.0 if not stops else -1.0

    _, plan = plans(time)
    assert quickest([0, 1], plan, time, 1.0) == frozenset()
    with pytest.raises(PlanError):
        quickest([0], plans(lambda _: -1.0)[1], lambda _: 1.0, 0.0)


def test_a_run_falls_apart_at_its_stops() -> None:
    assert split_at(3, frozenset()) == [slice(0, 3)]
    assert split_at(3, frozenset({1})) == [slice(0, 2), slice(2, 3)]
    assert split_at(3, frozenset({0, 1})) == [slice(0, 1), slice(1, 2), slice(2, 3)]


@pytest.mark.parametrize("motion", [Motion.PTP, Motion.LIN])
def test_the_time_with_stops_is_never_overstated(motion: Motion) -> None:
    rng = np.random.default_rng(4)
    for pace in (1.0, 0.5):
        run = walk(rng, motion, 0.0)
        planner = Planner(ik=PLANNER.ik, profile=PANDA.profile, pace=pace)
        legs = planner.plan_chain(ARM, run, ARM.home, DT)
        requests = [
            waypoint.request(ARM, planner.ik, pace, leg.ik)
            for waypoint, leg in zip(run, legs, strict=True)
        ]
        least = least_with_stops(ARM, ARM.home, requests, PANDA.profile, PathProfile())
        took = sum(leg.trajectory.duration for leg in legs)
        assert 0.4 * took < least <= took + 1e-6
        if motion is Motion.PTP:
            assert least > took - 3 * DT


def test_a_ptp_waypoint_where_the_motion_already_is_is_refused() -> None:
    here = ARM.pose(ARM.home)
    there = SE3.from_rotation_and_translation(
        here.rotation(), here.translation() + np.array([0.0, 0.1, 0.0])
    )
    run = [
        Waypoint(name="first", target=there, blend=0.02),
        Waypoint(name="again", target=there, blend=0.02),
        Waypoint(name="goal", target=here),
    ]
    with pytest.raises(PlanError, match=r"'again'.* it is where the motion already is") as caught:
        PLANNER.plan_chain(ARM, run, ARM.home, DT)
    assert caught.value.rejection is not None
    assert caught.value.rejection.reason is RefusalReason.SHAPE


def test_corners_that_are_blended_again_stay_blended() -> None:
    """Blending costs 3 at the first corner and saves 1 at each of the others."""

    def time(stops: frozenset[int]) -> float:
        return 10.0 - 3.0 * (0 in stops) + 1.0 * (1 in stops) + 1.0 * (2 in stops)

    assert quickest([0, 1, 2], plans(time)[1], time, 9.0) == {0}


def test_a_cut_may_be_as_fast_as_the_faster_of_its_sides() -> None:
    pose = ARM.pose(ARM.home)
    there = pose @ SE3.from_translation(np.array([0.0, 0.3, 0.0]))
    onward = there @ SE3.from_translation(np.array([0.0, 0.25, 0.1]))
    run = [
        Waypoint(name="slow", target=there, blend=0.08, pace=0.3),
        Waypoint(name="fast", target=onward),
    ]
    slow, fast = PLANNER.plan_chain(ARM, run, ARM.home, DT)
    assert not slow.stops
    shares = [np.abs(leg.trajectory.a / PANDA.profile.a_max).max() for leg in (slow, fast)]
    assert shares[0] > 1.1 * 0.3**2
    assert max(shares) <= 1.0 + 1e-9


def test_a_cut_leaves_the_corner_before_it_alone() -> None:
    rng, profile = np.random.default_rng(29), PANDA.profile
    q = [np.clip(ARM.home + rng.normal(0.0, 0.3, 7), ARM.q_min, ARM.q_max) for _ in range(4)]
    places = [ARM.pose(one).translation() for one in q]
    far = [float(np.linalg.norm(b - a)) for a, b in pairwise(places)]
    radii = [0.9 * min(sides) for sides in pairwise(far)]
    motions = [plan_ptp(a, b, profile, 4e-3) for a, b in pairwise(q)]
    whole, passes = cut_corners(ARM, motions, [Corner(radius, profile) for radius in radii])
    assert 0 < passes[0] < passes[1] < whole.steps
    for row, place, radius in zip(passes, places[1:3], radii, strict=True):
        assert np.linalg.norm(ARM.pose(whole.q[row]).translation() - place) <= radius
