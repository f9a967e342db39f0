"""The world keeps what it promises: at the motors, at the fingers, and about time."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.model.arm import Arm
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.robots import GRIPPER
from tests.runs import ZEROS, Holder, no_objects
from tests.sim.shelf import N, cube_on_a_shelf, grasp, start_again

ARM_DOFS = slice(0, N)


COMMANDS = st.lists(
    st.lists(
        st.one_of(
            st.floats(-200.0, 200.0),
            st.floats(-1e9, 1e9),
            st.sampled_from([0.0, 1e6, -1e6, 87.0, -87.0, 12.0, -12.0]),
        ),
        min_size=N,
        max_size=N,
    ),
    min_size=1,
    max_size=40,
)


@given(COMMANDS)
@example([[1e6] * N, [-1e6] * N] * 10)
@example([[1e6] * N] * 100)
@example([[-1e6] * N] * 200)
@example([[87.5] * N] * 100)
@settings(max_examples=25, deadline=None)
def test_motors_give_the_torque_closest_to_the_command_within_limit_and_rate(
    commands: list[list[float]],
) -> None:
    simulation = start_again()
    data, limit = simulation.data, PANDA.tau_max
    step = PANDA.tau_rate_max * TIMESTEP
    before = data.ctrl[:N].copy()
    for command in commands:
        simulation.step(np.array(command))
        low = np.maximum(before - step, -limit)
        high = np.minimum(before + step, limit)
        delivered = data.ctrl[:N].copy()
        assert (np.abs(delivered) <= limit).all()
        assert (np.abs(delivered - before) <= step * (1 + 1e-9)).all()
        np.testing.assert_allclose(delivered, np.clip(command, low, high), atol=1e-9)
        before = delivered


def test_the_torque_in_the_joints_is_the_one_that_the_motors_deliver(
    arm_alone: Simulation,
) -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        arm_alone.step(rng.uniform(-40.0, 40.0, N))
        ctrl = arm_alone.data.ctrl[:N].copy()
        np.testing.assert_array_equal(arm_alone.data.qfrc_actuator[ARM_DOFS], ctrl)
        np.testing.assert_array_equal(arm_alone.last_torque(), ctrl)


def test_the_full_torque_is_reached_and_held(arm_alone: Simulation) -> None:
    for _ in range(120):
        arm_alone.step(np.full(N, 1e6))
    np.testing.assert_array_equal(arm_alone.last_torque(), PANDA.tau_max)
    for _ in range(180):
        arm_alone.step(np.full(N, -1e6))
    np.testing.assert_array_equal(arm_alone.last_torque(), -PANDA.tau_max)


def test_a_command_in_reach_is_delivered_at_once(arm_alone: Simulation) -> None:
    start = arm_alone.data.ctrl[:N].copy()
    wanted = start + np.array([0.9, -0.9, 0.1, -0.1, 0.99, -0.99, 0.0])
    arm_alone.step(wanted)
    np.testing.assert_array_equal(arm_alone.last_torque(), wanted)


def test_the_commanded_array_is_not_touched(arm_alone: Simulation) -> None:
    command = np.full(N, 1e6)
    arm_alone.step(command)
    np.testing.assert_array_equal(command, np.full(N, 1e6))


def test_the_arm_starts_held_against_gravity(arm_alone: Simulation) -> None:
    gravity = Arm(PANDA).inverse_dynamics(PANDA.home, ZEROS, ZEROS)
    np.testing.assert_allclose(arm_alone.data.ctrl[:N], gravity, atol=1e-6)
    for _ in range(100):
        arm_alone.step(gravity)
    np.testing.assert_allclose(arm_alone.state().q, PANDA.home, atol=1e-4)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_what_is_read_after_a_step_belongs_to_one_instant(seed: int) -> None:
    simulation, arm = start_again(), Arm(PANDA)
    rng = np.random.default_rng(seed)
    for k in range(1, 61):
        simulation.step(rng.uniform(-60.0, 60.0, N))
        assert simulation.time == pytest.approx(k * TIMESTEP, abs=1e-12)
        off = arm.pose(simulation.state().q).as_matrix() - simulation.tool_pose().as_matrix()
        assert np.abs(off).max() < 1e-12


def test_acceleration_is_the_change_of_velocity_in_the_last_period(
    arm_alone: Simulation,
) -> None:
    for _ in range(30):
        before = arm_alone.state()
        arm_alone.step(np.array([5.0, -30.0, 4.0, 20.0, 2.0, 1.0, 1.0]))
        after = arm_alone.state()
        change = (after.v - before.v) / TIMESTEP
        # The implicit integrator moves with a slightly damped acceleration.
        np.testing.assert_allclose(arm_alone.last_acceleration(), change, rtol=0.05, atol=0.05)
        np.testing.assert_allclose(after.q, before.q + TIMESTEP * after.v, atol=1e-12)


def test_what_was_read_does_not_change_any_more(shelved: Simulation) -> None:
    grasp(shelved, 30.0)
    reads: list[Callable[[], Vector]] = [
        lambda: shelved.state().q,
        lambda: shelved.state().v,
        lambda: shelved.tool_pose().wxyz_xyz,
        shelved.last_acceleration,
        shelved.last_torque,
        shelved.last_finger_forces,
        lambda: shelved.object_pose("cube").wxyz_xyz,
        lambda: shelved.object_twist("cube"),
        lambda: shelved.marker_pose("shelf").wxyz_xyz,
    ]
    first = [read() for read in reads]
    kept = [value.copy() for value in first]
    shelved.place_marker("shelf", SE3.from_translation(np.array([1.0, 2.0, 0.0])))
    for _ in range(50):
        shelved.step(np.full(N, 3.0))
    for value, copy, read in zip(first, kept, reads, strict=True):
        np.testing.assert_array_equal(value, copy)
        assert (read() != copy).any()


def test_objects_and_markers_are_listed(shelved: Simulation) -> None:
    assert shelved.objects == ("cube",)
    assert shelved.markers == ("shelf",)


def test_a_placed_object_is_there_at_rest(shelved: Simulation) -> None:
    Holder(shelved).hold(20)
    T = SE3.from_rotation_and_translation(
        SO3.from_z_radians(0.7) @ SO3.from_x_radians(0.2), np.array([0.6, 0.3, 0.9])
    )
    shelved.place_object("cube", T)
    np.testing.assert_allclose(
        shelved.object_pose("cube").as_matrix(), T.as_matrix(), rtol=0, atol=1e-12
    )
    assert not shelved.object_twist("cube").any()
    body = shelved.data.body("cube")
    np.testing.assert_allclose(body.xpos, T.translation(), atol=1e-12)
    Holder(shelved).hold(100)
    # Free fall, semi-implicit: v = g t.
    np.testing.assert_allclose(
        shelved.object_twist("cube"), [0, 0, -9.81 * 0.1, 0, 0, 0], atol=1e-9
    )


def test_a_placed_marker_is_there(shelved: Simulation) -> None:
    T = SE3.from_rotation_and_translation(SO3.from_z_radians(0.7), np.array([0.6, 0.3, 0.9]))
    shelved.place_marker("shelf", T)
    np.testing.assert_allclose(shelved.marker_pose("shelf").as_matrix(), T.as_matrix())
    np.testing.assert_allclose(shelved.data.body("shelf").xpos, T.translation())


@pytest.mark.parametrize(
    "ask",
    [
        lambda s: s.object_pose("shelf"),
        lambda s: s.object_twist("shelf"),
        lambda s: s.place_object("shelf", SE3.identity()),
    ],
)
def test_an_unknown_object_is_named(
    shelved: Simulation, ask: Callable[[Simulation], object]
) -> None:
    with pytest.raises(UnknownNameError, match=r"No object is called 'shelf'; known: cube\."):
        ask(shelved)


@pytest.mark.parametrize(
    "ask",
    [lambda s: s.marker_pose("cube"), lambda s: s.place_marker("cube", SE3.identity())],
)
def test_an_unknown_marker_is_named(
    shelved: Simulation, ask: Callable[[Simulation], object]
) -> None:
    with pytest.raises(UnknownNameError, match=r"No marker is called 'cube'; known: shelf\."):
        ask(shelved)


def test_names_in_a_world_without_objects(arm_alone: Simulation) -> None:
    assert arm_alone.objects == ()
    assert arm_alone.markers == ()
    with pytest.raises(UnknownNameError, match="known: none"):
        arm_alone.object_pose("cube")


def whole_state(simulation: Simulation) -> Vector:
    spec = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(simulation.model, spec))
    mujoco.mj_getState(simulation.model, simulation.data, state, spec)
    now = np.concatenate([simulation.state().q, simulation.tool_pose().wxyz_xyz])
    limits = simulation.model.actuator_forcerange.ravel()
    return np.concatenate([state, now, limits, [simulation.width_command()]])


def test_reset_restores_every_bit(shelved: Simulation) -> None:
    fresh = Simulation(PANDA, cube_on_a_shelf)
    start = whole_state(fresh)
    rng = np.random.default_rng(1)
    shelved.command_grip(Grip(width=0.01, force=5.0))
    shelved.place_marker("shelf", SE3.from_translation(np.array([0.4, 0.1, 0.2])))
    for _ in range(200):
        shelved.step(rng.uniform(-80.0, 80.0, N))
    assert (whole_state(shelved) != start).any()
    shelved.reset()
    np.testing.assert_array_equal(whole_state(shelved), start)
    for _ in range(100):
        tau = rng.uniform(-80.0, 80.0, N)
        shelved.step(tau)
        fresh.step(tau)
    np.testing.assert_array_equal(whole_state(shelved), whole_state(fresh))


def test_the_start_is_home_at_rest_with_an_open_gripper(shelved: Simulation) -> None:
    np.testing.assert_array_equal(shelved.state().q, PANDA.home)
    assert not shelved.state().v.any()
    assert shelved.time == 0.0
    assert shelved.width() == GRIPPER.width_max
    assert shelved.width_speed() == 0.0
    assert shelved.grip_settled()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_torque_that_is_no_number_is_refused_and_nothing_moves(
    arm_alone: Simulation, bad: float
) -> None:
    tau = np.zeros(N)
    tau[3] = bad
    before = (arm_alone.time, arm_alone.state().q.tobytes(), arm_alone.data.ctrl.tobytes())
    with pytest.raises(InvalidValueError, match="commanded torque must be finite"):
        arm_alone.step(tau)
    assert (arm_alone.time, arm_alone.state().q.tobytes(), arm_alone.data.ctrl.tobytes()) == before


@pytest.mark.parametrize("delay", [None, 0.0, 2e-3])
@pytest.mark.parametrize("shape", [(1,), (N - 1,), (N, 1)])
def test_torques_that_are_not_one_for_each_joint_are_refused(
    delay: float | None, shape: tuple[int, ...]
) -> None:
    """One would be broadcast to all joints."""
    sim = Simulation(PANDA, no_objects)
    if delay is not None:
        sim = DisturbedSimulation(PANDA, no_objects, Disturbance(torque_delay=delay))
    with pytest.raises(InvalidValueError, match=r"commanded torque must be 7 numbers .*; found sh"):
        sim.step(np.ones(shape))
    assert sim.time == 0.0


def test_a_reset_gives_objects_the_friction_of_the_scene() -> None:
    task = PickPlace()
    simulation = Simulation(PANDA, task.build_scene)
    described = simulation.model.geom_friction.copy()
    task.reset(simulation, np.random.default_rng(1))
    assert (simulation.model.geom_friction != described).any()
    simulation.reset()
    np.testing.assert_array_equal(simulation.model.geom_friction, described)
