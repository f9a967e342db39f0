"""Dry friction that is expected, that is learned, and that holds joints which stick."""

from dataclasses import replace
from itertools import pairwise
from typing import Protocol

import numpy as np
import pytest

from robo47_qp.arrays import Vector
from robo47_qp.control.active import ActiveController
from robo47_qp.control.computed_torque import ComputedTorque
from robo47_qp.control.friction import FrictionLearning, LearnedFriction
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.robot import MotionProfile, Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from tests.controlled import DT
from tests.runs import no_objects

TRUTH = np.full(7, 0.4)
STILL = np.zeros(7)


class Go(Protocol):
    """Leads joints; see `learning`."""

    def __call__(self, speed: float, taken: Vector, updates: int, free: bool = True) -> Vector:
        """Return how friction turned [N·m]."""
        ...


def accelerated(arm: Arm, q: Vector, taken: Vector) -> Vector:
    """What torques that friction takes (7,) [N·m] are as a disturbance (7,) [rad/s²]."""
    return np.asarray(-np.linalg.solve(arm.mass_matrix(q), taken))


def learning(arm: Arm, *, compiled: bool) -> tuple[LearnedFriction, Go]:
    """Friction that is learned, and what leads all joints and tells how it turned [N·m].

    It takes speed [rad/s], the torques that friction takes (7,) [N·m], updates of 10 ms, and
    whether nothing is touched.
    """
    friction, q, held = LearnedFriction(FrictionLearning(), arm, DT), arm.home.copy(), STILL
    if not compiled:
        friction.core = None

    def go(speed: float, taken: Vector, updates: int, free: bool = True) -> Vector:
        nonlocal q, held
        turned = np.zeros(7)
        for _ in range(updates):
            q = q + 0.01 * speed
            arm.inverse_dynamics(q, STILL, STILL)
            change = friction.change(arm, q, held if free else None)
            if change is not None:
                turned -= arm.mass_matrix(q) @ change
            held = accelerated(arm, q, taken)
            friction.learn(arm, held)
        return turned

    return friction, go


@pytest.mark.parametrize("compiled", [True, False])
def test_nothing_is_learned_of_joints_that_may_stick(compiled: bool) -> None:
    friction, go = learning(Arm(PANDA), compiled=compiled)
    for direction in (1.0, -1.0, 1.0):
        go(0.1 * direction, direction * TRUTH, 100)
    known = friction.friction
    assert known == pytest.approx(TRUTH, rel=0.1)
    for _ in range(2):
        go(0.0, TRUTH, 20)
        go(0.001, 0.1 * TRUTH, 29)
        np.testing.assert_array_equal(friction.friction, known)
    go(-0.001, -0.1 * TRUTH, 45)
    np.testing.assert_array_equal(friction.friction, known)
    go(-0.02, -0.1 * TRUTH, 20)
    assert (friction.friction < known).all()


@pytest.mark.parametrize("compiled", [True, False])
def test_of_slow_joints_is_learned_when_they_have_been_led_far_enough(compiled: bool) -> None:
    friction, go = learning(Arm(PANDA), compiled=compiled)
    go(0.001, TRUTH, 35)
    np.testing.assert_array_equal(friction.friction, STILL)
    go(0.001, TRUTH, 60)
    assert (friction.friction[4:] > 0.5 * TRUTH[4:]).all()


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize(("updates", "free"), [(12, True), (12, False), (5, True)])
def test_friction_turns_from_what_holds_the_joints_but_in_contact(
    updates: int, free: bool, compiled: bool
) -> None:
    _, go = learning(Arm(PANDA), compiled=compiled)
    for direction in (1.0, -1.0, 1.0):
        go(0.1 * direction, direction * TRUTH, 100)
    go(0.0, -0.5 * TRUTH, updates, free=free)
    turned = go(0.1, TRUTH, 10, free=free)
    if not free or updates < 10:
        np.testing.assert_array_equal(turned, STILL)
        return
    # Of strong joints few looks, which are as noisy as they are strong, tell less.
    assert (turned > 1.2 * TRUTH).all()
    assert turned[4:] == pytest.approx(1.5 * TRUTH[4:], rel=0.1)


@pytest.mark.parametrize("compiled", [True, False])
def test_joints_that_were_pushed_back_at_rest_start_again_the_way_they_went(compiled: bool) -> None:
    friction, go = learning(Arm(PANDA), compiled=compiled)
    for direction in (1.0, -1.0, 1.0):
        go(0.1 * direction, direction * TRUTH, 100)
    known = friction.friction
    go(0.0, -TRUTH, 100)
    np.testing.assert_array_equal(friction.friction, known)
    assert go(0.1, TRUTH, 20) == pytest.approx(2.0 * known, rel=0.1)
    go(0.0, TRUTH, 100)
    assert np.abs(go(0.1, TRUTH, 20)).max() < 0.1


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


@pytest.mark.parametrize("compiled", [True, False])
def test_joints_do_not_turn_where_the_reference_jumps_to_them(compiled: bool) -> None:
    arm = Arm(PANDA)
    friction, go = learning(arm, compiled=compiled)
    for direction in (1.0, -1.0, 1.0):
        go(0.1 * direction, direction * TRUTH, 100)
    there = arm.home - 0.01
    friction.jump(there)
    assert friction.change(arm, there) is None
    assert friction.change(arm, there + 1e-3) is None
    assert friction.change(arm, there) is not None


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("free", [True, False])
def test_friction_turns_at_once_where_joints_start_from_rest_but_in_contact(
    free: bool, compiled: bool
) -> None:
    friction, go = learning(Arm(PANDA), compiled=compiled)
    for direction in (1.0, -1.0, 1.0):
        go(0.1 * direction, direction * TRUTH, 100)
    go(0.0, TRUTH, 50)
    turned = go(-1e-4, TRUTH, 2, free=free)
    if free:
        assert turned == pytest.approx(-2.0 * friction.friction, rel=0.05)
        return
    assert (turned <= 0.0).all()
    assert (turned > -0.1 * friction.friction).all()


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


def test_joints_that_go_back_from_rest_are_hardly_left_behind() -> None:
    def error(start: float) -> float:
        """The largest error in the motion back [rad]."""
        learning = FrictionLearning(start=start)
        observer = DisturbanceObserver(noise_q=0.0, friction=learning)
        active = ActiveController(ComputedTorque(), Arm(PANDA), dt=DT, observer=observer)
        sim = DisturbedSimulation(PANDA, no_objects, Disturbance(dry_friction=0.5))
        errors: list[float] = []
        ends = [PANDA.home + 0.05 * x for x in (0.0, 1.0, 0.0, 1.0, 0.0)]
        for q0, q1 in pairwise(ends):
            way = plan_ptp(q0, q1, PANDA.profile, DT)
            errors.clear()  # The last motion counts: friction is learned before.
            q, v, a = (np.vstack([np.repeat(x[:1], 200, axis=0), x]) for x in (way.q, way.v, way.a))
            for reference in zip(q, v, a, strict=True):
                errors.append(np.abs(reference[0] - sim.true_state().q).max())
                sim.step(active.torque(JointReference(*reference), sim.state()))
        return float(max(errors))

    assert error(FrictionLearning().start) < 0.4 * error(FrictionLearning().displacement)


def test_a_joint_that_crept_is_not_left_behind_as_it_goes_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    creeping = MotionProfile.uniform(7, v=1e-3, a=2e-3, j=0.02)
    there = PANDA.home + 7e-4 * (np.arange(7) == 6)
    back = PANDA.home - 0.5 * (np.arange(7) == 6)

    def error() -> float:
        """The largest error of the last joint on its way back [rad]."""
        observer = DisturbanceObserver(noise_q=0.0)
        active = ActiveController(ComputedTorque(), Arm(PANDA), dt=DT, observer=observer)
        sim = DisturbedSimulation(PANDA, no_objects, Disturbance(dry_friction=0.3))
        errors: list[float] = []
        for way in (
            plan_ptp(PANDA.home, there, creeping, DT),
            plan_ptp(there, back, PANDA.profile, DT),
        ):
            errors.clear()
            q, v, a = (np.vstack([np.repeat(x[:1], 500, axis=0), x]) for x in (way.q, way.v, way.a))
            for reference in zip(q, v, a, strict=True):
                errors.append(abs(reference[0][6] - sim.true_state().q[6]))
                sim.step(active.torque(JointReference(*reference), sim.state()))
        return max(errors)

    known = error()
    monkeypatch.setattr("robo47_qp.control.friction._LOOSE", np.inf)
    assert known < 0.3 * error()


def test_what_is_expected_is_within_what_may_be_learned() -> None:
    robot = replace(PANDA, dry_friction=np.full(7, 3.0))
    friction = LearnedFriction(FrictionLearning(), Arm(robot), DT).friction
    assert friction == pytest.approx([3.0] * 4 + [1.2] * 3)
    with pytest.raises(InvalidValueError, match="dry_friction"):
        replace(PANDA, dry_friction=np.zeros(6))
