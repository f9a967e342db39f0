"""Limits, constraints and bad input of a user, through MinkIk and MultiStart."""

import gc
from collections.abc import Sequence
from typing import Any

import mink
import numpy as np
import pytest
from mink.limits import Constraint

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.mink_step import MinkStepper
from robo47_qp.ik.objectives import Objective
from robo47_qp.ik.solver import Reason, Tolerance
from robo47_qp.ik.tool_demand import FreeAxis
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from tests.composed import ARM, elbow_at, several, somewhere, tasks

# Limits and constraints -------------------------------------------------------------------------


class HalfSpace(mink.Limit):
    """The elbow's joint stays above a value."""

    def __init__(self, joint: int, least: float) -> None:
        self.joint, self.least = joint, least

    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> Constraint:
        row = -np.eye(1, configuration.nv, self.joint)
        return Constraint(row, np.array([configuration.q[self.joint] - self.least]))


def test_a_limit_of_a_user_is_kept() -> None:
    rng = np.random.default_rng(11)
    ik = several(limits=[HalfSpace(0, 0.2)])
    kept = 0
    for _ in range(15):
        q = somewhere(rng)
        q[0] = abs(q[0]) + 0.25
        result = ik.solve(ARM, ARM.pose(np.minimum(q, ARM.q_max)), ARM.home)
        if result.converged:
            kept += 1
            assert result.q[0] >= 0.2 - 1e-6
    assert kept >= 14


def test_searches_of_objectives_that_nobody_asks_for_again_are_let_go() -> None:
    """A program may make new ones for every waypoint: each search holds a state of MuJoCo's."""
    arm = Arm(PANDA)

    def searches() -> int:
        gc.collect()
        return sum(isinstance(one, MinkStepper) for one in gc.get_objects())

    before, target = searches(), arm.pose(arm.home + 0.1)
    for _ in range(40):
        posture = mink.PostureTask(arm.model, cost=1e-3)
        posture.set_target(arm.home)
        assert several(objectives=[posture]).solve(arm, target, arm.home).converged
    assert 1 <= searches() - before <= 20
    assert several().solve(arm, target, arm.home).converged


def test_a_limit_that_cannot_be_kept_is_counted_and_named() -> None:
    ik = MinkIk(limits=[HalfSpace(0, 9.0)])
    result = ik.solve(ARM, ARM.pose(ARM.home + 0.1), ARM.home)
    assert result.reason is Reason.NOT_CONVERGED
    assert "limit HalfSpace (violated by" in result.explanation
    assert dict(result.relaxed)["HalfSpace"] > 0


def test_a_constraint_is_met_exactly_or_named() -> None:
    rng = np.random.default_rng(12)
    q = somewhere(rng, 0.3)
    held = mink.FrameTask("link4", "body", 1.0, 0.0)
    held.set_target_from_configuration(mink.Configuration(ARM.model, q=q))

    class Height(mink.Task):
        """Of the elbow's body, in the world."""

        def __init__(self, height: float) -> None:
            super().__init__(np.ones(1))
            self.height = height

        def compute_error(self, configuration: mink.Configuration) -> Vector:
            pose = configuration.get_transform_frame_to_world("link4", "body")
            return pose.translation()[2:] - self.height

        def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
            pose = configuration.get_transform_frame_to_world("link4", "body")
            J = configuration.get_frame_jacobian("link4", "body")
            row: Matrix = (pose.rotation().as_matrix() @ J[:3])[2:]
            return row

    height = mink.Configuration(ARM.model, q=q).get_transform_frame_to_world("link4", "body")
    for asked, reachable in ((float(height.translation()[2]), True), (5.0, False)):
        ik = several(constraints=[Height(asked)])
        result = ik.solve(ARM, ARM.pose(q), q + 0.1)
        assert result.converged == reachable, result.explanation
        if reachable:
            at = mink.Configuration(ARM.model, q=result.q)
            assert abs(Height(asked).compute_error(at)[0]) < 1e-6
        else:
            assert "Height (error" in result.explanation


def test_frozen_joints_stay_at_the_seed_in_every_start() -> None:
    rng = np.random.default_rng(13)
    found = 0
    for _ in range(10):
        q = somewhere(rng)
        q_seed = ARM.home.copy()
        q_seed[2] = q[2]
        ik = several(frozen=["joint3"])
        result = ik.solve(ARM, ARM.pose(q), q_seed)
        assert result.q[2] == q_seed[2]
        found += result.converged
    assert found >= 9


def test_dear_joints_move_less() -> None:
    rng = np.random.default_rng(14)
    dear, plain = MinkIk(joint_cost=[10.0, 1, 1, 1, 1, 1, 1]), MinkIk()
    ways = []
    for _ in range(20):
        q = somewhere(rng, 0.3)
        target = ARM.pose(np.clip(q + rng.uniform(-0.3, 0.3, 7), ARM.q_min, ARM.q_max))
        ends = [ik.solve(ARM, target, q) for ik in (dear, plain)]
        if all(end.converged for end in ends):
            ways.append([abs(end.q[0] - q[0]) for end in ends])
    less, more = np.mean(ways, axis=0)
    assert len(ways) >= 15
    assert less < 0.6 * more


# Bad input --------------------------------------------------------------------------------------


class Rowless(mink.Limit):
    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> Constraint:
        return Constraint(np.zeros((0, configuration.nv)), np.zeros(0))


class Wide(Rowless):
    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> Constraint:
        return Constraint(np.zeros((1, 9)), np.zeros(1))


def with_cost(cost: Any) -> mink.Task:
    task = elbow_at(ARM.home)
    task.cost = np.asarray(cost, dtype=float)
    return task


@pytest.mark.parametrize(
    ("composition", "message"),
    [
        ({"objectives": [mink.FrameTask("nobody", "body", 1.0, 1.0)]}, "nobody"),
        ({"objectives": [mink.FrameTask("hand", "body", 1.0, 1.0)]}, "target"),
        ({"objectives": [with_cost([1.0, 2.0])]}, r"cost of PostureTask must be shape \(7,\)"),
        ({"objectives": [with_cost([np.nan] * 7)]}, "cost of PostureTask must be finite"),
        ({"objectives": [with_cost([-1.0] * 7)]}, "cost of PostureTask must be finite and not"),
        ({"objectives": ["hand"]}, "an objective must be"),
        ({"objectives": [lambda arm: mink.PostureTask(arm.model, [1.0, 2.0])]}, "an objective"),
        ({"objectives": [lambda arm: arm.model.body("nobody")]}, "nobody"),
        ({"limits": [Rowless()]}, "limit Rowless must be one with rows"),
        ({"limits": [Wide()]}, r"G and h of limit Wide must be \(k, 7\)"),
        ({"limits": [mink.VelocityLimit(ARM.model, {})]}, "limit VelocityLimit must be one with"),
        ({"limits": [elbow_at(ARM.home)]}, "a limit must be a mink.Limit"),
        ({"constraints": [Rowless()]}, "a constraint must be a mink.Task"),
        ({"joint_cost": [1.0]}, "joint_cost must be 7 finite numbers above 0"),
        ({"joint_cost": [np.nan] * 7}, "joint_cost must be 7 finite numbers above 0"),
        ({"objectives": "hand"}, "objectives must be a list"),
        (
            {"objectives": [Objective(elbow_at(ARM.home), tolerance=1.0)], "frozen": "joint1"},
            "frozen",
        ),
    ],
)
def test_bad_input_is_one_message(composition: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        MinkIk(**composition).solve(ARM, ARM.pose(ARM.home + 0.1), ARM.home)


def test_a_joint_that_is_not_there_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="No joint is called 'elbow'; known: joint1"):
        MinkIk(frozen=["elbow"]).solve(ARM, ARM.pose(ARM.home), ARM.home)


@pytest.mark.parametrize("values", [{"priority": -1}, {"tolerance": -1.0}, {"tolerance": np.nan}])
def test_objectives_are_checked(values: dict[str, Any]) -> None:
    with pytest.raises(InvalidValueError):
        Objective(elbow_at(ARM.home), **values)


def test_nan_from_a_task_on_the_way_is_a_result() -> None:
    class Broken(mink.Task):
        def __init__(self) -> None:
            super().__init__(np.ones(1))
            self.calls = 0

        def compute_error(self, configuration: mink.Configuration) -> Vector:
            self.calls += 1
            return np.array([np.nan if self.calls > 3 else 0.0])

        def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
            return np.ones((1, configuration.nv))

    for priority in (0, 1):
        result = MinkIk(objectives=[Objective(Broken(), priority, 1.0)]).solve(
            ARM, ARM.pose(ARM.home + 0.2), ARM.home
        )
        assert result.reason is Reason.NOT_CONVERGED
        assert np.isfinite(result.q).all()


def test_the_same_question_has_the_same_answer_to_the_bit() -> None:
    def ask() -> Sequence[float]:
        ik = several(objectives=[tasks()["com"]], tolerance=Tolerance(demand=FreeAxis()))
        arm = Arm(PANDA)
        found: list[float] = ik.solve(arm, arm.pose(arm.home + 0.3), arm.home).q.tolist()
        return found

    assert ask() == ask()
