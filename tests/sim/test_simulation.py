"""The world keeps what it promises: at the motors, at the fingers, and about time."""

from collections.abc import Callable
from functools import cache

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
from robo47_qp.sim.simulation import Simulation
from tests.robots import GRIPPER
from tests.runs import ZEROS, Holder, no_objects

N = len(PANDA.joints)
HOME_TOOL = Arm(PANDA).pose(PANDA.home)
EDGE, MASS = 0.04, 0.1
WEIGHT = MASS * 9.81
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


def cube_on_a_shelf(spec: mujoco.MjSpec) -> None:
    """A cube between the open fingers of the arm at home, on a shelf that can be removed."""
    x, y, z = HOME_TOOL.translation()
    cube = spec.worldbody.add_body(name="cube", pos=[x, y, z])
    cube.add_freejoint()
    box = mujoco.mjtGeom.mjGEOM_BOX
    cube.add_geom(name="cube", type=box, size=[EDGE / 2] * 3, mass=MASS)
    shelf = spec.worldbody.add_body(name="shelf", mocap=True, pos=[x, y, z - EDGE / 2 - 0.01])
    shelf.add_geom(name="shelf", type=box, size=[0.02, 0.02, 0.01])


@cache
def one_world() -> Simulation:
    return Simulation(PANDA, no_objects)


def start_again() -> Simulation:
    """One world for all examples, each from its start."""
    one_world().reset()
    return one_world()


@pytest.fixture
def arm_alone() -> Simulation:
    return start_again()


@pytest.fixture
def shelved() -> Simulation:
    return Simulation(PANDA, cube_on_a_shelf)


def grasp(simulation: Simulation, force: float) -> Holder:
    """Squeeze the cube on the shelf, then take the shelf away."""
    holder = Holder(simulation)
    simulation.command_grip(Grip(width=0.0, force=force))
    holder.hold(900)
    simulation.place_marker("shelf", SE3.from_translation(np.array([2.0, 2.0, 0.0])))
    holder.hold(300)
    return holder


# Motors


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


# Time


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


# Gripper


def test_the_gripper_opens_and_closes_no_faster_than_its_speed(arm_alone: Simulation) -> None:
    holder, gripper = Holder(arm_alone), GRIPPER
    commands, speeds = [arm_alone.width_command()], []

    def look() -> None:
        commands.append(arm_alone.width_command())
        speeds.append(abs(arm_alone.width_speed()))

    for width in (0.0, gripper.width_max, 0.03, 0.0305):
        arm_alone.command_grip(Grip(width=width, force=30.0))
        holder.hold(1000, look)
        assert arm_alone.width() == pytest.approx(width, abs=1e-4)
        assert arm_alone.width_command() == width
        left, right = arm_alone.data.qpos[N : N + 2]
        assert left == pytest.approx(right, abs=1e-5)
    assert np.abs(np.diff(commands)).max() <= gripper.speed_max * TIMESTEP + 1e-12
    assert max(speeds) <= gripper.speed_max * 1.02
    # Full travel takes as long as the speed allows, not longer.
    arm_alone.command_grip(Grip(width=gripper.width_max, force=30.0))
    holder.hold(round((gripper.width_max - 0.0305) / gripper.speed_max / TIMESTEP) + 1)
    assert arm_alone.width_command() == gripper.width_max


@pytest.mark.parametrize("force", [3.0, 30.0, 70.0])
def test_each_finger_presses_with_the_force_asked_for(shelved: Simulation, force: float) -> None:
    grasp(shelved, force)
    model, data = shelved.model, shelved.data
    measured = {"left_finger": np.zeros(3), "right_finger": np.zeros(3)}
    for i in range(data.ncon):
        contact = data.contact[i]
        wrench = np.zeros(6)
        mujoco.mj_contactForce(model, data, i, wrench)
        bodies = [model.body(model.geom_bodyid[geom]).name for geom in contact.geom]
        finger = next(name for name in bodies if name in measured)
        measured[finger] += contact.frame.reshape(3, 3).T @ wrench[:3]
    sizes = [float(np.linalg.norm(f)) for f in measured.values()]
    # A finger bears half the weight besides its squeeze.
    expected = float(np.hypot(force, WEIGHT / 2))
    assert sizes == pytest.approx([expected, expected], rel=5e-3)
    assert shelved.last_finger_forces() == pytest.approx(sizes, rel=1e-3)
    assert shelved.grip_settled()


def test_a_second_grip_can_be_weaker_than_the_first(shelved: Simulation) -> None:
    holder = grasp(shelved, 70.0)
    shelved.command_grip(Grip(width=0.0, force=10.0))
    holder.hold(600)
    assert shelved.last_finger_forces() == pytest.approx([10.0, 10.0], rel=0.01)


def test_a_held_cube_hardly_creeps(shelved: Simulation) -> None:
    holder = grasp(shelved, 30.0)
    before = shelved.tool_pose().inverse() @ shelved.object_pose("cube")
    holder.hold(2000)
    after = shelved.tool_pose().inverse() @ shelved.object_pose("cube")
    shift = np.linalg.norm(after.translation() - before.translation())
    turn = np.linalg.norm((before.inverse() @ after).rotation().log())
    # Friction in MuJoCo is soft, and nothing removes the slip.
    assert shift / 2.0 < 5e-6
    assert turn / 2.0 < 1e-3


def test_an_open_grip_lets_the_cube_fall(shelved: Simulation) -> None:
    holder = grasp(shelved, 30.0)
    height = shelved.object_pose("cube").translation()[2]
    shelved.command_grip(Grip(width=0.08, force=30.0))
    holder.hold(400)
    assert shelved.object_pose("cube").translation()[2] < height - 0.1
    assert not shelved.last_finger_forces().any()


def test_a_grip_settles_at_the_width_asked_for(arm_alone: Simulation) -> None:
    holder = Holder(arm_alone)
    for width in (0.02, 0.06):
        holder.hold(200)
        assert arm_alone.grip_settled()
        arm_alone.command_grip(Grip(width=width, force=30.0))
        assert not arm_alone.grip_settled()
        settled: list[tuple[bool, float]] = []
        for _ in range(900):
            holder.hold(1)
            settled.append((arm_alone.grip_settled(), arm_alone.width()))
        first = next(i for i, (done, _) in enumerate(settled) if done)
        assert all(abs(where - width) < 1e-4 for done, where in settled if done)
        assert all(done for done, _ in settled[first:])


def test_a_grip_settles_on_an_object_before_the_servo_is_where_it_was_sent(
    shelved: Simulation,
) -> None:
    holder = Holder(shelved)
    shelved.command_grip(Grip(width=0.0, force=30.0))
    seen = []

    def look() -> None:
        if shelved.grip_settled():
            force, command = float(shelved.last_finger_forces().min()), shelved.width_command()
            seen.append((force, command, abs(shelved.width_speed())))

    holder.hold(900, look)
    assert seen
    assert seen[0][1] > 0.02
    assert all(force > 0.95 * 30.0 and speed < 1e-3 for force, _, speed in seen)


def test_a_finger_at_the_stop_of_a_short_grip_is_not_settled_by_pushing_the_wrong_way(
    shelved: Simulation,
) -> None:
    """The servo squeezes the cube with all its force; opening begins, it is not done."""
    grasp(shelved, 30.0)
    shelved.command_grip(Grip(width=0.08, force=30.0))
    assert not shelved.grip_settled()


@pytest.mark.parametrize("width", [-0.001, 0.081, np.nan])
def test_an_impossible_width_is_refused(arm_alone: Simulation, width: float) -> None:
    with pytest.raises(InvalidValueError, match=r"grip width must be between 0 and 0\.08 \[m\]"):
        arm_alone.command_grip(Grip(width=width, force=30.0))


@pytest.mark.parametrize("force", [0.0, -1.0, 70.1, np.nan])
def test_an_impossible_force_is_refused(arm_alone: Simulation, force: float) -> None:
    with pytest.raises(InvalidValueError, match=r"grip force must be above 0 and at most 70"):
        arm_alone.command_grip(Grip(width=0.04, force=force))


def test_a_refused_grip_changes_nothing(arm_alone: Simulation) -> None:
    Holder(arm_alone).hold(50)
    with pytest.raises(InvalidValueError):
        arm_alone.command_grip(Grip(width=0.04, force=1e3))
    assert arm_alone.grip_settled()
    Holder(arm_alone).hold(300)
    assert arm_alone.width() == pytest.approx(0.08, abs=1e-5)


# Objects and markers


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


# Reset


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
