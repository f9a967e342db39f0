"""Motions of two arms together: synchronous, on their paths, clear of each other."""

from dataclasses import replace

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError, PlanError, RefusalReason
from robo47_qp.model.arm import Arm
from robo47_qp.model.ratings import profile_at_ratings
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.model.tool_poses import ToolPoses
from robo47_qp.motion.collision_check import Collisions
from robo47_qp.motion.paths.segments import Line
from robo47_qp.motion.paths.together import HeldTogether
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.motion.tool_motion import tool_motion, tool_rates
from robo47_qp.motion.waypoint import Motion, Place, Waypoint, tool_down
from robo47_qp.stack import ClassicalStack

DT = 1e-3
LEFT, RIGHT = np.array([0.5, 0.2, 0.3]), np.array([0.5, -0.2, 0.3])
BOTH = ToolPoses({"left": tool_down(LEFT), "right": tool_down(RIGHT)})


@pytest.fixture(scope="module")
def pair() -> Arm:
    return Arm(panda_pair())


@pytest.fixture(scope="module")
def planner() -> Planner:
    return Planner(ik=ClassicalStack(ik="qp").solver(), profile=panda_pair().profile)


@pytest.fixture(scope="module")
def q_both(pair: Arm, planner: Planner) -> Vector:
    leg = planner.plan(pair, Waypoint(name="both", target=BOTH), pair.home, DT)
    end: Vector = leg.trajectory.end.q
    return end


def places(arm: Arm, leg: Leg, tool: int) -> Matrix:
    return np.array([arm.pose(q, tool).translation() for q in leg.trajectory.q])


def shifted(left: Vector, right: Vector) -> ToolPoses:
    return ToolPoses({"left": tool_down(LEFT + left), "right": tool_down(RIGHT + right)})


def off_line(points: Matrix, a: Vector, b: Vector) -> float:
    along = (b - a) / np.linalg.norm(b - a)
    away = (points - a) - np.outer((points - a) @ along, along)
    return float(np.linalg.norm(away, axis=1).max())


def test_both_arms_come_to_their_poses_at_the_same_time(
    pair: Arm, planner: Planner, q_both: Vector
) -> None:
    assert max(pair.pose_distance(BOTH, q_both)) <= 1e-6
    leg = planner.plan(pair, Waypoint(name="both", target=BOTH), pair.home, DT)
    moved = np.abs(np.diff(leg.trajectory.q, axis=0)) > 0.0
    last = [np.flatnonzero(moved[:, half].any(axis=1))[-1] for half in (slice(0, 7), slice(7, 14))]
    assert max(last) - min(last) <= 1


def test_lines_of_both_are_run_at_the_same_share(
    pair: Arm, planner: Planner, q_both: Vector
) -> None:
    ways = np.array([0.0, 0.05, 0.15]), np.array([0.1, -0.05, 0.0])
    goal = Waypoint(name="apart", target=shifted(*ways), motion=Motion.LIN)
    leg = planner.plan(pair, goal, q_both, DT)
    shares = []
    for tool, (start, way) in enumerate(zip((LEFT, RIGHT), ways, strict=True)):
        points = places(pair, leg, tool)
        assert off_line(points, start, start + way) < 1e-5
        shares.append((points - start) @ way / (way @ way))
    np.testing.assert_allclose(shares[0], shares[1], atol=2e-4)
    assert max(pair.pose_distance(shifted(*ways), leg.trajectory.end.q)) <= 2e-6


def test_the_paths_of_a_leg_are_those_of_the_tools_that_it_moves(
    pair: Arm, planner: Planner, q_both: Vector
) -> None:
    """A leg of the right hand alone is not drawn at the left one."""
    further = RIGHT + np.array([0.1, 0.0, 0.0])
    right = ToolPoses({"right": tool_down(further)})
    leg = planner.plan(pair, Waypoint(name="r", target=right, motion=Motion.LIN), q_both, DT)
    paths = leg.tool_paths(pair)
    assert list(paths) == ["right"]
    np.testing.assert_allclose(paths["right"][[0, -1]], [RIGHT, further], atol=1e-5)
    both = planner.plan(pair, Waypoint(name="b", target=BOTH), pair.home, DT).tool_paths(pair)
    assert list(both) == ["left", "right"]
    np.testing.assert_allclose(both["left"][-1], LEFT, atol=1e-5)


def test_arcs_of_both_are_run_together(pair: Arm, planner: Planner, q_both: Vector) -> None:
    goal = Waypoint(
        name="over",
        target=shifted(np.array([0.1, 0.0, 0.0]), np.array([0.1, 0.0, 0.0])),
        motion=Motion.CIRC,
        through_each={
            "left": LEFT + np.array([0.05, 0.0, 0.05]),
            "right": RIGHT + np.array([0.05, -0.05, 0.0]),
        },
    )
    leg = planner.plan(pair, goal, q_both, DT)
    for tool, centre in enumerate((LEFT, RIGHT)):
        points = places(pair, leg, tool)
        radii = np.linalg.norm(points - centre - np.array([0.05, 0.0, 0.0]), axis=1)
        np.testing.assert_allclose(radii, 0.05, atol=1e-5)


@pytest.mark.parametrize("motion", [Motion.LIN, Motion.CIRC])
def test_tools_that_hold_a_body_keep_their_relative_pose(
    pair: Arm, planner: Planner, q_both: Vector, motion: Motion
) -> None:
    # Tilted, so that what holds it is no half turn, which would be its own inverse.
    middle, turned = 0.5 * (LEFT + RIGHT), SO3.from_x_radians(0.2)
    T_world_body = SE3.from_rotation_and_translation(turned, middle)
    holding = BOTH.each(lambda _, pose: T_world_body.inverse() @ pose)
    rotation = SO3.from_z_radians(0.4) @ turned
    goal = SE3.from_rotation_and_translation(rotation, np.array([0.5, 0.05, 0.36]))
    through = None if motion is Motion.LIN else np.array([0.54, 0.02, 0.34])
    waypoint = Waypoint(name="turn", target=goal, holding=holding, motion=motion, through=through)
    leg = planner.plan(pair, waypoint, q_both, DT)
    asked = BOTH["left"].inverse() @ BOTH["right"]
    for q in leg.trajectory.q[::25]:
        off = asked.inverse() @ pair.pose(q, 0).inverse() @ pair.pose(q, 1)
        assert np.linalg.norm(off.translation()) < 2e-5
        assert np.linalg.norm(off.rotation().log()) < 2e-5
    end = pair.pose(leg.trajectory.end.q, 0) @ holding["left"].inverse()
    assert np.linalg.norm((goal.inverse() @ end).log()) < 1e-5


def test_a_wrong_grasp_is_mended_on_the_way() -> None:
    T_world_body = SE3.from_translation(0.5 * (LEFT + RIGHT))
    holding = BOTH.each(lambda _, pose: T_world_body.inverse() @ pose)
    start = ToolPoses(
        {"left": BOTH["left"], "right": tool_down(RIGHT + np.array([0.0, 0.001, 0.0]))}
    )
    waypoint = Waypoint(name="up", target=T_world_body, holding=holding, motion=Motion.LIN)
    path = waypoint.path(start, BOTH)
    assert isinstance(path, HeldTogether)
    for s, off in ((0.0, 0.001), (0.5, 0.0005), (1.0, 0.0)):
        poses = path.at(s)
        apart = poses["right"].translation() - RIGHT
        np.testing.assert_allclose(apart, [0.0, off, 0.0], atol=1e-12)


@pytest.mark.parametrize("moved", [0.15, 0.25])
def test_a_hand_that_changes_its_grasp_on_the_way_is_no_faster_than_it_may(
    pair: Arm, planner: Planner, q_both: Vector, moved: float
) -> None:
    """The body moves by 10 mm, one hand along it by more."""
    T_world_body = SE3.from_translation(0.5 * (LEFT + RIGHT))
    holding = BOTH.each(lambda _, pose: T_world_body.inverse() @ pose)
    other = SE3.from_translation(np.array([moved, 0.0, 0.0])) @ holding["right"]
    goal = SE3.from_translation(np.array([0.0, 0.0, 0.01])) @ T_world_body
    asked = ToolPoses({"left": holding["left"], "right": other})
    waypoint = Waypoint(name="shift", target=goal, holding=asked, motion=Motion.LIN)
    quick = replace(planner, profile=profile_at_ratings(pair.robot.rated))
    leg = quick.plan(pair, waypoint, q_both, DT)
    assert leg.lower_bound <= leg.trajectory.duration
    speeds = np.linalg.norm(np.diff(places(pair, leg, 1), axis=0), axis=1) / DT
    v, a, _ = quick.lin.profile.linear
    assert 0.8 * v < speeds.max() <= v * (1.0 + 1e-3)
    assert np.abs(np.diff(speeds)).max() / DT <= a * (1.0 + 1e-2)


@pytest.mark.parametrize("motion", [Motion.PTP, Motion.LIN])
@pytest.mark.parametrize(("name", "still"), [("left", slice(7, 14)), ("right", slice(0, 7))])
def test_a_tool_that_is_not_named_stands_still(
    pair: Arm, planner: Planner, q_both: Vector, motion: Motion, name: str, still: slice
) -> None:
    up = np.array([0.0, 0.0, 0.1])
    target = ToolPoses({name: shifted(up, up)[name]})
    leg = planner.plan(pair, Waypoint(name="up", target=target, motion=motion), q_both, DT)
    # A spline through equal numbers rounds.
    np.testing.assert_allclose(
        leg.trajectory.q[:, still],
        np.tile(q_both[still], (leg.trajectory.steps + 1, 1)),
        atol=1e-14,
    )
    assert max(pair.pose_distance(target, leg.trajectory.end.q)) <= 2e-6


def test_motions_of_one_arm_and_of_both_follow_each_other(pair: Arm, planner: Planner) -> None:
    up = np.array([0.0, 0.0, 0.1])
    waypoints = [
        Waypoint(name="left there", target=ToolPoses({"left": BOTH["left"]})),
        Waypoint(name="right there", target=ToolPoses({"right": BOTH["right"]})),
        Waypoint(name="up", target=shifted(up, up), motion=Motion.LIN),
        Waypoint(name="home", target=Place.HOME),
    ]
    legs = planner.plan_chain(pair, waypoints, pair.home, DT)
    assert (legs[0].trajectory.q[:, 7:] == pair.home[7:]).all()
    assert max(pair.pose_distance(BOTH, legs[1].trajectory.end.q)) <= 2e-6
    assert legs[-1].trajectory.end.q.tolist() == pair.home.tolist()


def test_a_motion_into_the_other_arm_is_refused(pair: Arm, planner: Planner) -> None:
    checked = replace(planner, collisions=Collisions(pair.robot, lambda _: None, clearance=0.01))
    where = np.array([0.5, 0.0, 0.3])
    crossed = ToolPoses(
        {"left": tool_down(where), "right": tool_down(where + np.array([0.02, 0.0, 0.0]))}
    )
    with pytest.raises(PlanError) as refused:
        checked.plan(pair, Waypoint(name="crossed", target=crossed), pair.home, DT)
    assert refused.value.rejection is not None
    assert refused.value.rejection.reason is RefusalReason.COLLISION
    assert "left_" in str(refused.value)
    assert "right_" in str(refused.value)


def test_the_motion_of_each_tool_agrees_with_differences(pair: Arm) -> None:
    rng, h = np.random.default_rng(5), 1e-4
    q = rng.uniform(0.5 * pair.q_min, 0.5 * pair.q_max)
    v, a, j = rng.uniform(-1.0, 1.0, (3, pair.n))
    t = h * np.arange(-2, 3)[:, None]
    path = q + v * t + a * t**2 / 2 + j * t**3 / 6
    for tool in (0, 1):
        motion = tool_motion(pair, q[None], v[None], a[None], j[None], tool)
        points = np.array([pair.pose(row, tool).translation() for row in path])
        np.testing.assert_allclose(motion.v[0], (points[3] - points[1]) / (2 * h), atol=1e-6)
        second = (points[3] - 2 * points[2] + points[1]) / h**2
        np.testing.assert_allclose(motion.a[0], second, atol=1e-5)


def test_the_rates_are_those_of_the_faster_tool(pair: Arm) -> None:
    q = np.tile(pair.home, (6, 1))
    q[:, 7] += 0.01 * np.arange(6)
    right = tool_rates(pair, q, DT).v[:, 0]
    arc = np.linalg.norm(pair.jacobian(pair.home, 1)[:3, 7]) * 0.01 / DT
    np.testing.assert_allclose(right.max(), arc, rtol=1e-3)


def test_several_tools_stop_at_every_waypoint() -> None:
    with pytest.raises(InvalidValueError, match="several tools"):
        Waypoint(name="corner", target=BOTH, motion=Motion.LIN, blend=0.02)
    with pytest.raises(InvalidValueError, match="several tools"):
        Waypoint(name="by", target=BOTH, stop=False)


def test_arcs_of_several_tools_have_a_point_for_each() -> None:
    with pytest.raises(InvalidValueError, match="CIRC"):
        Waypoint(name="arc", target=BOTH, motion=Motion.CIRC)
    with pytest.raises(InvalidValueError, match="LIN"):
        Waypoint(name="line", target=BOTH, motion=Motion.LIN, through_each={"left": LEFT})
    for each, told in (
        ({"left": LEFT + 0.1}, "one each"),
        ({"left": LEFT + 0.1, "right": RIGHT[:2]}, "point of 'right'"),
    ):
        with pytest.raises(InvalidValueError, match=told):
            Waypoint(name="arc", target=BOTH, motion=Motion.CIRC, through_each=each)


def test_a_body_that_is_held_has_one_target() -> None:
    with pytest.raises(InvalidValueError, match="the body held"):
        Waypoint(name="tray", target=BOTH, holding=BOTH, motion=Motion.LIN)


def test_a_body_that_is_held_moves_on_a_path() -> None:
    with pytest.raises(InvalidValueError, match="LIN or CIRC"):
        Waypoint(name="tray", target=SE3.identity(), holding=BOTH)


def test_no_tool_on_a_body_goes_further_than_is_told() -> None:
    """By the sum of small steps along random paths, on which grasps change, too."""
    rng, share = np.random.default_rng(4), []

    def pose(away: float) -> SE3:
        turn = SO3.exp(rng.uniform(-1.0, 1.0, 3))
        return SE3.from_rotation_and_translation(turn, away * rng.uniform(-1.0, 1.0, 3))

    for _ in range(40):
        start, goal = pose(0.05), pose(0.05)
        near, far = rng.permutation([0.0, 0.5])
        holding = ToolPoses({name: pose(far) for name in ("left", "right")})
        held = ToolPoses({name: start @ pose(near) for name in holding})
        path = HeldTogether(Line(start, goal), held, holding)
        points = [path.at(s) for s in np.linspace(0.0, 1.0, 200)]
        for name in holding:
            steps = np.diff([one[name].translation() for one in points], axis=0)
            way = np.linalg.norm(steps, axis=1).sum()
            assert way <= path.length
            share.append(way / path.length)
    assert max(share) > 0.6
