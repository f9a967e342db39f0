"""Detours: free by MuJoCo's own word, within the limits, and the same every time."""

import subprocess
import sys
from dataclasses import replace
from functools import cache
from hashlib import sha256

import mujoco
import numpy as np
import pytest
from mink import SE3
from scipy.interpolate import CubicSpline

from robo47_qp.errors import InvalidValueError, PlanError, RefusalReason
from robo47_qp.evaluation.benchmarks.motion.motion_check import violations
from robo47_qp.evaluation.benchmarks.motion.reference_kinematics import ReferenceKinematics
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.model import obstacle
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.collision_check import Collisions
from robo47_qp.motion.detour import Detour
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.motion.waypoint import Waypoint
from tests.motion.test_collisions import ARM, BALL, DT, RADIUS, ball, gap, turned
from tests.runs import no_objects

CLEARANCE = 0.01
START, GOAL = turned(-0.3), turned(1.8)
AMONG = Arm(
    PANDA,
    obstacles=(
        obstacle.Obstacle(
            name="ball",
            shape=obstacle.Shape.SPHERE,
            size=(RADIUS,),
            T_world_obstacle=SE3.from_translation(BALL),
        ),
    ),
)


@cache
def collisions() -> Collisions:
    return Collisions(PANDA, ball, clearance=CLEARANCE)


def detour(searches: int = 1, seed: int = 1, roomy: Collisions | None = None) -> Detour:
    return Detour(roomy=roomy or wider(), searches=searches, seed=seed)


@cache
def wider() -> Collisions:
    return Collisions(PANDA, ball, clearance=CLEARANCE + 0.004)


def planned(around: Detour | None, q_goal: np.ndarray = GOAL) -> Leg:
    planner = Planner(
        ik=MultiStart(solver=LmIk()), profile=PANDA.profile, collisions=collisions(), detour=around
    )
    goal = Waypoint(name="over there", target=ARM.pose(q_goal))
    return planner.plan(AMONG, goal, START, DT)


def searched(searches: int = 1, seed: int = 1) -> Trajectory:
    found = detour(searches, seed).plan(ARM, collisions(), (START, GOAL), PANDA.profile, DT)
    assert found is not None
    return found


@cache
def around(searches: int = 2, seed: int = 1) -> Trajectory:
    return searched(searches, seed)


def fingerprint(motion: Trajectory) -> str:
    return sha256(motion.q.tobytes() + motion.a.tobytes()).hexdigest()


def test_the_straight_way_is_blocked() -> None:
    with pytest.raises(PlanError, match="come within"):
        collisions().check("swing", plan_ptp(START, GOAL, PANDA.profile, DT))


def test_a_detour_keeps_its_distance_and_the_limits() -> None:
    motion = around()
    np.testing.assert_allclose(motion.q[[0, -1]], [START, GOAL], atol=1e-9)
    assert min(gap(q) for q in motion.q[::5]) >= CLEARANCE
    leg = Leg.__new__(Leg)
    object.__setattr__(leg, "trajectory", motion)
    assert violations(ReferenceKinematics(PANDA), [leg], PANDA.profile) == []


def test_the_planner_goes_around_and_arrives() -> None:
    leg = planned(detour())
    assert ARM.pose_distance(leg.T_world_goal, leg.trajectory.end.q)[0] < 1e-3
    assert min(gap(q) for q in leg.trajectory.q[::5]) >= CLEARANCE
    with pytest.raises(PlanError, match="come within") as caught:
        planned(None)
    assert caught.value.rejection is not None
    assert caught.value.rejection.reason is RefusalReason.COLLISION


def test_what_is_not_blocked_takes_the_straight_way() -> None:
    leg = planned(detour(), turned(-0.6))
    straight = plan_ptp(START, leg.trajectory.end.q, PANDA.profile, DT)
    np.testing.assert_array_equal(leg.trajectory.q, straight.q)


def test_the_same_question_has_the_same_answer_in_every_process() -> None:
    assert fingerprint(searched()) == fingerprint(around(1))
    code = (
        "from tests.motion.test_detour import fingerprint, searched; print(fingerprint(searched()))"
    )
    fresh = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.strip()
    assert fresh == fingerprint(around(1))


def test_another_seed_finds_another_way_and_more_searches_none_that_is_slower() -> None:
    ways = [around(1, seed) for seed in (1, 2)]
    assert fingerprint(ways[0]) != fingerprint(ways[1])
    assert around().steps == min(way.steps for way in ways)


def test_where_no_spline_is_free_it_stops_at_the_corners(monkeypatch: pytest.MonkeyPatch) -> None:
    stopping = replace(detour(), refinements=1)
    monkeypatch.setattr(Detour, "_amiss", lambda *_: [0])
    motion = stopping.plan(ARM, collisions(), (START, GOAL), PANDA.profile, DT)
    corners = stopping.corners(ARM, (START, GOAL), 1)
    assert motion is not None
    assert corners is not None
    assert len(corners) > 2
    for corner in corners:
        (k, *_) = np.flatnonzero(np.abs(motion.q - corner).max(axis=1) < 1e-9)
        assert not motion.v[k].any()
    # And nowhere else.
    assert np.count_nonzero(~motion.v.any(axis=1)) == len(corners)
    assert min(gap(q) for q in motion.q[::5]) >= CLEARANCE


def test_a_search_without_result_is_none_and_the_refusal_stands() -> None:
    def shell(spec: mujoco.MjSpec) -> None:
        ball(spec)
        at = ARM.pose(GOAL).translation()
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.05, 0, 0], pos=at)

    inside = Collisions(PANDA, shell, clearance=CLEARANCE)
    buried = detour(roomy=inside)
    assert buried.plan(ARM, inside, (START, GOAL), PANDA.profile, DT) is None
    few = replace(detour(), iterations=1, stride=0.05)
    assert few.plan(ARM, collisions(), (START, GOAL), PANDA.profile, DT) is None
    with pytest.raises(PlanError, match="come within"):
        planned(few)


def test_the_way_stays_off_the_joint_limits_but_where_it_ends() -> None:
    start = START.copy()
    start[3] = ARM.q_max[3] - 0.001
    motion = detour().plan(ARM, collisions(), (start, GOAL), PANDA.profile, DT)
    assert motion is not None
    room = np.minimum(motion.q - ARM.q_min, ARM.q_max - motion.q)
    assert room.min() >= 0.001 - 1e-9
    assert np.delete(room, 3, axis=1).min() >= 0.02 - 1e-9


def test_what_the_search_did_not_see_is_seen_in_the_end() -> None:
    """A search that looks at an empty world finds the straight way, which hits the ball."""
    blind = detour(roomy=Collisions(PANDA, no_objects, clearance=CLEARANCE))
    assert blind.corners(ARM, (START, GOAL), 1) is not None
    assert blind.plan(ARM, collisions(), (START, GOAL), PANDA.profile, DT) is None


def test_where_limits_are_narrow_the_way_keeps_its_margin() -> None:
    """Three joints have hardly more room than the margins of both their limits."""
    narrow, few = Arm(PANDA), [2, 4, 6]
    narrow.q_min[few] = START[few] - 0.0205
    narrow.q_max[few] = START[few] + 0.0205
    motion = detour().plan(narrow, collisions(), (START, GOAL), PANDA.profile, DT)
    assert motion is not None
    room = np.minimum(motion.q - narrow.q_min, narrow.q_max - motion.q)
    assert room.min() >= 0.02 - 1e-9
    # What there is is made use of.
    assert room[:, few].min() < 0.0205 - 1e-5


def test_a_spline_that_would_swing_into_the_margin_is_not_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Between two corners on the edge of the margin a natural spline is beyond them."""
    corners = np.tile(START, (4, 1))
    corners[:, 0] += [0.0, 0.5, 1.0, 1.5]
    corners[1:3, 6] = ARM.q_max[6] - 0.02
    monkeypatch.setattr(Detour, "corners", lambda *_: corners)
    empty = Collisions(PANDA, no_objects, clearance=CLEARANCE)
    ends = (corners[0], corners[-1])
    motion = detour(roomy=empty).plan(ARM, empty, ends, PANDA.profile, DT)
    assert motion is not None
    # Between two looks it may bulge a little.
    assert (ARM.q_max - motion.q)[:, 6].min() >= 0.02 - 5e-5
    spline = CubicSpline([0.0, 0.5, 1.0, 1.5], corners, bc_type="natural")
    assert (ARM.q_max - spline(0.75))[6] < 0.0


@pytest.mark.parametrize("name", ["iterations", "step", "stride", "searches", "seed"])
def test_numbers_that_are_not_positive_are_refused(name: str) -> None:
    with pytest.raises(
        InvalidValueError, match=rf"{name} must be .*(above 0|1 or more).*; found 0"
    ):
        replace(detour(), **{name: 0})  # type: ignore[arg-type]
