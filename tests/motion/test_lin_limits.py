"""LIN near the limits of joints: away from them where it can, and the joint named where not."""

from dataclasses import dataclass

import numpy as np
import pytest

from robo47_qp.arrays import Vector
from robo47_qp.errors import RefusalReason
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import IkResult, Tolerance
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.tool_poses import Target
from robo47_qp.motion.following.lin import Lin
from robo47_qp.motion.following.tracking import _away
from robo47_qp.motion.paths.segments import Line
from robo47_qp.motion.refusals import PathError
from tests.examples import shifted, turned
from tests.motion.test_lin import DT, IK, check_joints, off_line
from tests.plain_arm import PlainArm


def test_a_line_through_a_joint_limit_fails_there(robot: Robot, arm: Arm) -> None:
    """Turning on the spot about the tool's axis ends where the last joint does."""
    q = arm.home.copy()
    q[-1] = arm.q_max[-1] - 0.5
    goal = turned(arm.pose(q), 2, 1.5)
    with pytest.raises(PathError, match="the path fails") as caught:
        Lin().plan(arm, IK, q, goal, robot.profile, DT)
    assert 0.0 < caught.value.fraction < 0.9


def test_the_way_from_the_limits_does_not_move_the_tool(rng: np.random.Generator) -> None:
    arm, plain = Arm(PANDA), PlainArm(PANDA)
    half = 0.5 * (arm.q_max - arm.q_min)
    for q in arm.q_min + 2.0 * half * rng.uniform(0.0, 1.0, (20, arm.n)):
        way = _away(arm, IK, q, arm.pose(q))
        assert np.abs(plain.jacobian(q) @ way).max() < 1e-9
        # Against the fourth power of the distances from the middle.
        assert way @ ((q - arm.q_min - half) / half) ** 3 < 0.0


def test_a_joint_that_leaves_its_limits_is_named(robot: Robot, arm: Arm) -> None:
    """A solver that does not look at the limits is not believed."""
    narrow = Arm(robot)
    narrow.q_max[3] = arm.home[3] + 0.05

    @dataclass(frozen=True)
    class Careless:
        tolerance: Tolerance = Tolerance()

        def solve(self, _: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
            return IK.solve(arm, T_world_target, q_seed)

    goal = shifted(arm.pose(arm.home), np.array([0.2, 0.0, 0.0]))
    assert arm.pose(arm.home).translation()[0] + 0.2 < 0.6
    message = rf"fails \d+ % of the way: {robot.joints[3]} leaves its limits"
    with pytest.raises(PathError, match=message) as caught:
        Lin().plan(narrow, Careless(), arm.home, goal, robot.profile, DT)
    assert 0.0 < caught.value.fraction < 1.0


def test_a_joint_is_led_away_from_its_limit_where_the_arm_is_redundant() -> None:
    """With the least motion at each step, a joint would run into its limit."""
    arm, plain = Arm(PANDA), PlainArm(PANDA)
    rng = np.random.default_rng(59)
    q = rng.uniform(0.8 * arm.q_min + 0.2 * arm.q_max, 0.2 * arm.q_min + 0.8 * arm.q_max)
    start = arm.pose(q)
    goal = shifted(start, rng.normal(size=3) * 0.12)
    ik = MultiStart(solver=LmIk(max_iterations=20, stall=Stall()))
    q_start = ik.solve(arm, start, arm.home).q
    with pytest.raises(PathError) as caught:
        Lin(retreat=0.0).plan(arm, ik, q_start, goal, PANDA.profile, DT)
    assert caught.value.reason is RefusalReason.JOINT_LIMIT
    trajectory, result = Lin().plan(arm, ik, q_start, goal, PANDA.profile, DT)
    assert result.converged
    assert all(plain.inside(row) for row in trajectory.q)
    assert off_line(plain, trajectory.q[::7], start, goal)[0] < 1e-5
    check_joints(trajectory, PANDA.profile)


@pytest.mark.parametrize("over", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize(
    ("joint", "side", "ends"),
    [
        (3, -1.0, ([0.0, -0.2, 0.0], [0.0, 0.17, 0.0])),
        (4, 1.0, ([0.1, 0.05, 0.0], [0.1, 0.3, 0.0])),
    ],
)
def test_a_joint_that_passes_its_limit_between_two_samples_is_seen(
    joint: int, side: float, ends: tuple[list[float], list[float]], over: float
) -> None:
    """Past the robot from side to side, or on one side, a joint turns most on the way."""
    arm, narrow = Arm(PANDA), Arm(PANDA)
    start, goal = (shifted(arm.pose(arm.home), np.array(end)) for end in ends)
    q, way = IK.solve(arm, start, arm.home).q, Line(start, goal)

    @dataclass(frozen=True)
    class Careless:
        tolerance: Tolerance = Tolerance()

        def solve(self, _: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
            return IK.solve(arm, T_world_target, q_seed)

    lin = Lin(retreat=0.0)
    bend = side * lin.follow(arm, IK, q, way)[1](np.linspace(0.0, 1.0, 100_001))[:, joint]
    assert 0.3 < bend.argmax() / 1e5 < 0.7
    limit = narrow.q_max if side > 0.0 else narrow.q_min
    limit[joint] = side * (bend.max() + 1e-9)
    lin.follow(narrow, Careless(), q, way)
    limit[joint] = side * (bend.max() - over)
    with pytest.raises(PathError, match=f"{PANDA.joints[joint]} leaves its limits") as caught:
        lin.follow(narrow, Careless(), q, way)
    assert bend[round(1e5 * caught.value.fraction)] > bend.max() - over - 1e-9
