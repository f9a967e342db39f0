"""The contract of every controller, discovered: what one owes on every robot that ships."""

import importlib
import inspect
import pkgutil
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from robo47_qp import control
from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.control.active import ActiveController
from robo47_qp.control.controller import Controller
from robo47_qp.control.pressing import Presser, Pressing
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.model.robot import Robot

FELT = np.array([0.0, 0.0, 8.0])
"""What a surface below does to a tool that presses on it with 8 N."""
MADE: dict[type, Callable[[Arm], tuple[Controller, Vector]]] = {
    Presser: lambda arm: (Pressing(force=8.0).build(arm, FELT.copy), FELT)
}
"""Controllers that are not made from settings alone, with the force that acts on the tool."""
SETTINGS: dict[type, Any] = {Presser: Pressing(force=8.0)}


def discovered() -> list[type]:
    """Classes of the room with `torque(arm, reference, state)`, the protocol itself left out."""
    found = []
    for module in pkgutil.iter_modules(control.__path__, f"{control.__name__}."):
        for member in vars(importlib.import_module(module.name)).values():
            if inspect.isclass(member) and member.__module__ == module.name:
                torque = getattr(member, "torque", None)
                if torque is not None and member is not Controller:
                    names = list(inspect.signature(torque).parameters)
                    if names == ["self", "arm", "reference", "state"]:
                        found.append(member)
    return found


FOUND = discovered()
every = pytest.mark.parametrize("kind", FOUND, ids=lambda kind: kind.__name__)


def made(kind: type, arm: Arm) -> tuple[Controller, Vector]:
    """A new controller, and the contact force on the tool (3,) that it knows of [N]."""
    return MADE[kind](arm) if kind in MADE else (kind(), np.zeros(3))


def at_rest(q: Vector) -> tuple[JointReference, JointState]:
    still = np.zeros(len(q))
    return JointReference(q, still, still), JointState(q.copy(), still)


def in_motion(arm: Arm, seed: int) -> tuple[JointReference, JointState]:
    """A reference near home that moves, and a state that is off a little."""
    rng = np.random.default_rng(seed)
    q, v, a, dq, dv = rng.uniform(-1.0, 1.0, (5, arm.n))
    wanted = JointReference(arm.home + 0.05 * q, 0.3 * v, 0.5 * a)
    return wanted, JointState(wanted.q + 0.01 * dq, wanted.v + 0.02 * dv)


def gravity(arm: Arm, q: Vector) -> Vector:
    still = np.zeros(arm.n)
    return arm.inverse_dynamics(q, still, still)


def test_the_controllers_are_found() -> None:
    assert {"JointImpedance", "CartesianImpedance", "OperationalSpace", "Presser"} <= {
        kind.__name__ for kind in FOUND
    }


@every
def test_the_torque_is_finite_new_and_of_the_arms_size(kind: type, robot: Robot) -> None:
    arm = Arm(robot)
    controller, _ = made(kind, arm)
    taus = []
    for seed in range(3):
        tau = controller.torque(arm, *in_motion(arm, seed))
        assert tau.shape == (arm.n,)
        assert tau.dtype == np.float64
        assert np.isfinite(tau).all()
        taus.append((tau, tau.copy()))
    for tau, before in taus:
        assert tau.tobytes() == before.tobytes(), "a later call has changed it"
        assert sum(np.shares_memory(tau, other) for other, _ in taus) == 1


@every
def test_what_it_is_given_is_left_alone(kind: type, robot: Robot) -> None:
    arm = Arm(robot)
    reference, state = in_motion(arm, 0)
    before = [column.tobytes() for column in (*reference, *state)]
    tau = made(kind, arm)[0].torque(arm, reference, state)
    tau += 1.0
    assert [column.tobytes() for column in (*reference, *state)] == before


@every
def test_the_same_question_has_the_same_answer(kind: type, robot: Robot) -> None:
    """Two controllers on two arms, the second of which did something else before."""
    one, other = Arm(robot), Arm(robot)
    first, second = made(kind, one)[0], made(kind, other)[0]
    if kind not in MADE:
        second.torque(other, *in_motion(other, 5))
    for seed in range(3):
        tau = first.torque(one, *in_motion(one, seed))
        assert tau.tobytes() == second.torque(other, *in_motion(other, seed)).tobytes()


@every
def test_at_rest_the_arm_is_held_against_gravity_and_contact(kind: type, robot: Robot) -> None:
    arm = Arm(robot)
    controller, felt = made(kind, arm)
    tau = controller.torque(arm, *at_rest(arm.home))
    J_world = arm.pose(arm.home).rotation().as_matrix() @ arm.jacobian(arm.home)[:3]
    balance = tau + J_world.T @ felt - gravity(arm, arm.home)
    np.testing.assert_allclose(balance, 0.0, atol=1e-9 * max(1.0, np.abs(tau).max()))


@every
@pytest.mark.parametrize("seed", range(4))
def test_it_pushes_back_towards_the_reference(kind: type, seed: int, robot: Robot) -> None:
    arm = Arm(robot)
    controller, _ = made(kind, arm)
    away = np.random.default_rng(seed).uniform(-0.01, 0.01, arm.n)
    reference, still = at_rest(arm.home)[0], np.zeros(arm.n)
    pushes = []
    for q in (arm.home + away, arm.home - away):
        tau = controller.torque(arm, reference, JointState(q, still))
        pushes.append((tau - gravity(arm, q)) @ away)
    assert pushes[0] < pushes[1]


@every
@pytest.mark.parametrize("seed", range(4))
def test_it_takes_energy_out_of_a_motion(kind: type, seed: int, robot: Robot) -> None:
    arm = Arm(robot)
    controller, _ = made(kind, arm)
    v = np.random.default_rng(seed).uniform(-0.1, 0.1, arm.n)
    reference, powers = at_rest(arm.home)[0], []
    for speed in (v, -v):
        tau = controller.torque(arm, reference, JointState(arm.home.copy(), speed))
        powers.append((tau - gravity(arm, arm.home)) @ speed)
    assert sum(powers) < 0.0


@every
def test_the_motors_limits_are_kept_whatever_it_asks_for(kind: type, robot: Robot) -> None:
    arm = Arm(robot)
    active = ActiveController(made(kind, arm)[0], arm, dt=TIMESTEP)
    last = np.clip(gravity(arm, arm.home), -robot.tau_max, robot.tau_max)
    for k in range(300):
        reference, state = in_motion(arm, k)
        # Long enough on one side for the torque to come to its limit.
        off = 0.5 if k < 150 else -0.5
        tau = active.torque(reference, JointState(state.q + off, state.v))
        assert (np.abs(tau) <= robot.tau_max * (1.0 + 1e-12)).all()
        step = robot.tau_rate_max * TIMESTEP
        assert (np.abs(tau - last) <= step * (1.0 + 1e-9) + 1e-12).all()
        last = tau


@every
@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_settings_out_of_range_are_refused_by_name(kind: type, bad: float) -> None:
    settings = SETTINGS[kind] if kind in SETTINGS else kind()
    tried = 0
    for field in fields(settings):
        value = getattr(settings, field.name)
        if field.name == "axis" and bad == -1.0:
            continue  # a direction may be negative
        if isinstance(value, float | tuple | np.ndarray):
            wrong = np.full(np.shape(value), bad) if np.shape(value) else bad
            with pytest.raises(InvalidValueError, match=field.name):
                replace(settings, **{field.name: wrong})
            tried += 1
    assert tried
