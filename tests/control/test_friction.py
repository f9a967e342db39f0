"""Dry friction that is expected, that is learned, and that holds joints which stick."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from robo47_qp.arrays import Vector
from robo47_qp.control.active import ActiveController
from robo47_qp.control.computed_torque import ComputedTorque
from robo47_qp.control.friction import FrictionLearning, LearnedFriction
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from tests.controlled import DT
from tests.runs import no_objects

TRUTH = np.full(7, 0.4)
STILL = np.zeros(7)
Go = Callable[[float, Vector, int], Vector]


def accelerated(arm: Arm, q: Vector, taken: Vector) -> Vector:
    """What torques that friction takes (7,) [N·m] are as a disturbance (7,) [rad/s²]."""
    return np.asarray(-np.linalg.solve(arm.mass_matrix(q), taken))


def learning(arm: Arm, *, compiled: bool) -> tuple[LearnedFriction, Go]:
    """Friction that is learned, and what leads all joints and tells how it turned [N·m].

    It takes speed [rad/s], the torques that friction takes (7,) [N·m], and updates of 10 ms.
    """
    friction, q = LearnedFriction(FrictionLearning(), arm, DT), arm.home.copy()
    if not compiled:
        friction.core = None

    def go(speed: float, taken: Vector, updates: int) -> Vector:
        nonlocal q
        turned = np.zeros(7)
        for _ in range(updates):
            q = q + 0.01 * speed
            arm.inverse_dynamics(q, STILL, STILL)
            change = friction.change(arm, q)
            if change is not None:
                turned -= arm.mass_matrix(q) @ change
            friction.learn(arm, accelerated(arm, q, taken))
        return turned

    return friction, go


@pytest.mark.parametrize("compiled", [True, False])
def test_nothing_is_learned_of_joints_that_may_stick(compiled: bool) -> None:
    friction, go = learning(Arm(PANDA), compiled=compiled)
    for direction in (1.0, -1.0, 1.0):
        go(0.1 * direction, direction * TRUTH, 100)
    known = friction.friction
    assert known == pytest.approx(TRUTH, rel=0.1)
    go(0.005, 0.1 * TRUTH, 100)
    np.testing.assert_array_equal(friction.friction, known)
    go(0.02, 0.1 * TRUTH, 100)
    assert (friction.friction < known).all()


@pytest.mark.parametrize("compiled", [True, False])
def test_friction_turns_from_what_is_commanded_where_something_else_has_held_the_joints(
    compiled: bool,
) -> None:
    arm = Arm(PANDA)
    friction, go = learning(arm, compiled=compiled)
    for direction in (1.0, -1.0, 1.0):
        go(0.1 * direction, direction * TRUTH, 100)
    friction.stick(arm, accelerated(arm, arm.home, -0.5 * TRUTH))
    # Of strong joints a single look, which is as noisy as they are strong, tells less.
    turned = go(0.1, TRUTH, 10)
    assert (turned > 1.2 * TRUTH).all()
    assert turned[4:] == pytest.approx(1.5 * TRUTH[4:], rel=0.1)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize(
    ("told", "speed", "share"),
    [(False, 4e-3, 1.0), (False, 5e-4, 0.5), (True, 0.02, 1.0), (True, 4e-3, 0.4)],
)
def test_a_reversal_turns_friction_at_once_unless_the_joint_creeps(
    told: bool, speed: float, share: float, compiled: bool
) -> None:
    robot = replace(PANDA, dry_friction=TRUTH) if told else PANDA
    friction, go = learning(Arm(robot), compiled=compiled)
    for direction in (1.0, -1.0, 1.0):
        go(0.1 * direction, direction * TRUTH, 100)
    turned = go(-speed, -TRUTH, 50)
    # From one direction to the other: friction turns by twice its size.
    assert turned == pytest.approx(-2.0 * share * friction.friction, rel=0.05)


def first_error(robot: Robot) -> float:
    """The largest error of a first motion of joints with dry friction [rad]."""
    arm = Arm(robot)
    observer = DisturbanceObserver(noise_q=0.0)
    active = ActiveController(ComputedTorque(), arm, dt=DT, observer=observer)
    sim = DisturbedSimulation(PANDA, no_objects, Disturbance(dry_friction=0.5))
    way = plan_ptp(PANDA.home, PANDA.home + 0.1, PANDA.profile, DT)
    errors = []
    for q, v, a in zip(way.q, way.v, way.a, strict=True):
        errors.append(np.abs(q - sim.true_state().q).max())
        sim.step(active.torque(JointReference(q, v, a), sim.state()))
    return float(max(errors))


def test_the_first_motion_is_met_with_friction_that_is_expected() -> None:
    expected = replace(PANDA, dry_friction=np.full(7, 0.5))
    assert first_error(expected) < 0.75 * first_error(PANDA)


def test_what_is_expected_is_within_what_may_be_learned() -> None:
    robot = replace(PANDA, dry_friction=np.full(7, 3.0))
    friction = LearnedFriction(FrictionLearning(), Arm(robot), DT).friction
    assert friction == pytest.approx([3.0] * 4 + [1.2] * 3)
    with pytest.raises(InvalidValueError, match="dry_friction"):
        replace(PANDA, dry_friction=np.zeros(6))
