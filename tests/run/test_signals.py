"""Signals: what stands where, and what follows from what."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mink import SE3, SO3
from scipy.spatial.transform import Rotation

from robo47_qp._core.library import using
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.arm import Arm
from robo47_qp.model.gripper import Grip
from robo47_qp.model.payload import Payload
from robo47_qp.model.robots import load_robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.rerun.log import RerunLog
from robo47_qp.report.rerun.reading import read_recording
from robo47_qp.run import signals
from robo47_qp.run.recording import Rows
from robo47_qp.sim.signal import POSE_UNIT, Signal
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.robots import GRIPPER
from tests.runs import Holder, picked_and_placed


def two_objects(spec: mujoco.MjSpec) -> None:
    PickPlace().build_scene(spec)
    die = spec.worldbody.add_body(name="die", pos=[0.5, 0.3, 0.05])
    die.add_freejoint()
    die.add_geom(name="die", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.01] * 3, mass=0.05)


FINGERS = GRIPPER.fingers
ALL = signals.all_signals(Simulation(PANDA, two_objects))
WIDTH = sum(len(signal.labels) for signal in ALL)


def block(count: int, seed: int = 0) -> Rows:
    """Random rows with unit quaternions, torques as commanded, and nothing derived."""
    rows = Rows(ALL, np.random.default_rng(seed).normal(size=(count, WIDTH)))
    for signal in ALL:
        if signal.labels[-4:] == ("qw", "qx", "qy", "qz"):
            q = rows[signal.name][:, -4:]
            q /= np.linalg.norm(q, axis=1, keepdims=True)
    rows["joints/tau"][:] = rows["joints/tau_command"]
    for signal in signals.derived(PANDA):
        rows[signal.name][:] = np.nan
    return rows


def wxyz(rotation: Rotation) -> Matrix:
    q: Matrix = np.atleast_2d(rotation.as_quat())[:, [3, 0, 1, 2]]
    return q


def test_names_are_unique_and_every_column_has_a_label() -> None:
    names = [signal.name for signal in ALL]
    assert len(set(names)) == len(names)
    assert all(signal.labels and signal.unit for signal in ALL)
    assert names[:2] == ["time", "phase"]


def test_nothing_is_left_for_derive_to_forget() -> None:
    rows = block(5)
    signals.derive(rows, PANDA)
    assert np.isfinite(rows.values).all()


def test_derive_leaves_what_was_recorded_alone() -> None:
    rows, before = block(5), block(5)
    signals.derive(rows, PANDA)
    derived = {signal.name for signal in signals.derived(PANDA)}
    for signal in ALL:
        if signal.name not in derived:
            np.testing.assert_array_equal(rows[signal.name], before[signal.name])


def test_the_joint_error_is_reference_minus_measurement() -> None:
    rows = block(1)
    rows["joints/q_ref"][:], rows["joints/q"][:] = 0.3, 0.1
    signals.derive(rows, PANDA)
    np.testing.assert_allclose(rows["errors/q"], 0.2)


def test_the_tool_error_is_a_distance() -> None:
    rows = block(2)
    rows["tool/pose"][:, :3] = [1.0, 2.0, 3.0]
    rows["tool/pose_ref"][:, :3] = [[1.0, 2.0, 3.0], [1.3, 2.0, 2.6]]
    signals.derive(rows, PANDA)
    np.testing.assert_allclose(rows["errors/tool_position"][:, 0], [0.0, 0.5], atol=1e-15)


ANGLES = st.one_of(
    st.floats(0.0, np.pi),
    st.floats(0.0, 1e-6),
    st.sampled_from([0.0, 1e-9, 1e-12, np.pi, np.pi - 1e-9, np.pi - 1e-6, np.pi / 2]),
)


@given(ANGLES, st.integers(0, 2**32 - 1), st.booleans(), st.booleans())
@settings(max_examples=200, deadline=None)
def test_the_tool_angle_is_that_between_the_orientations(
    angle: float, seed: int, flip_a: bool, flip_b: bool
) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    first = Rotation.random(random_state=rng)
    second = first * Rotation.from_rotvec(angle * axis)
    rows = block(1)
    # A quaternion and its opposite are the same orientation.
    rows["tool/pose"][:, 3:] = wxyz(first) * (-1 if flip_a else 1)
    rows["tool/pose_ref"][:, 3:] = wxyz(second) * (-1 if flip_b else 1)
    signals.derive(rows, PANDA)
    found = float(rows["errors/tool_angle"][0, 0])
    assert found == pytest.approx((first.inv() * second).magnitude(), abs=1e-14, rel=1e-7) or (
        abs(found - angle) < 1e-14 + 1e-7 * angle
    )
    assert found == pytest.approx(angle, abs=1e-14 + 1e-7 * angle)


def test_saturated_motors_are_counted_on_both_sides() -> None:
    """Whatever is commanded: what arrives late is no saturation."""
    rows, most = block(4), PANDA.tau_max
    rows["joints/tau_command"][:] = 1e3
    rows["joints/tau"][0] = 0.99 * most
    rows["joints/tau"][1, 2] = most[2]
    rows["joints/tau"][2, [0, 3, 6]] = most[[0, 3, 6]] * [1.0, -1.0, 1.0 - 1e-12]
    rows["joints/tau"][3] = rows["joints/tau_command"][3] = 0.0
    signals.derive(rows, PANDA)
    np.testing.assert_array_equal(rows["joints/saturated"][:, 0], [0, 1, 3, 0])


def test_width_and_force_of_the_gripper() -> None:
    rows = block(1)
    rows["gripper/fingers"][:] = [0.01, 0.02]
    rows["gripper/left_finger_contact"][:] = [3.0, 0.0, -4.0]
    rows["gripper/right_finger_contact"][:] = [0.0, 5.0, 12.0]
    signals.derive(rows, PANDA)
    np.testing.assert_allclose(rows["gripper/width"], [[0.03]])
    np.testing.assert_allclose(rows["gripper/force"], [[5.0, 13.0]])


# What the simulation writes is what the columns say.


@pytest.fixture(scope="module")
def busy() -> Simulation:
    """A world in which every signal has its own value: all moves, the fingers touch."""
    simulation = Simulation(PANDA, two_objects)
    tool = simulation.tool_pose().translation()
    simulation.command_grip(Grip(width=0.0, force=30.0))
    holder = Holder(simulation)
    holder.hold(380)
    lean = SO3.from_z_radians(0.05) @ SO3.from_x_radians(0.03)
    simulation.place_object("cube", SE3.from_rotation_and_translation(lean, tool))
    holder.hold(40)
    for _ in range(7):
        simulation.step(np.array([3.0, -20.0, 4.0, 25.0, 1.0, -1.0, 2.0]))
    return simulation


def filled(group: tuple[Signal, ...], values: Vector) -> Rows:
    return Rows(group, values[None, :])


def test_what_is_written_for_now_is_what_the_model_says_by_name(busy: Simulation) -> None:
    group = tuple(busy.signals_now)
    row = np.full(sum(len(signal.labels) for signal in group), np.nan)
    busy.write_now(row)
    rows, data = filled(group, row), busy.data
    for i, joint in enumerate(PANDA.joints):
        assert rows["joints/q"][0, i] == data.joint(joint).qpos[0]
        assert rows["joints/v"][0, i] == data.joint(joint).qvel[0]
    site = data.site(PANDA.tcp)
    np.testing.assert_array_equal(rows["tool/pose"][0, :3], site.xpos)
    turn = Rotation.from_quat(rows["tool/pose"][0, [4, 5, 6, 3]])
    np.testing.assert_allclose(turn.as_matrix().ravel(), site.xmat, atol=1e-12)
    for i, joint in enumerate(GRIPPER.joints):
        assert rows["gripper/fingers"][0, i] == data.joint(joint).qpos[0]
    assert rows["gripper/width_command"][0, 0] == data.actuator("gripper").ctrl[0]
    for name in ("cube", "die"):
        body = data.body(name)
        np.testing.assert_allclose(rows[f"objects/{name}"][0, :3], body.xpos, atol=1e-12)
        np.testing.assert_allclose(rows[f"objects/{name}"][0, 3:], body.xquat, atol=1e-12)
        joint = busy.model.body(name).jntadr[0]
        moving = data.qvel[busy.model.jnt_dofadr[joint] :][:6]
        np.testing.assert_array_equal(rows[f"motion/{name} velocity"][0], moving)
    # One of the objects is at rest.
    assert len(np.unique(row)) > len(row) - 10


def test_what_is_written_for_the_last_period_is_what_the_model_says_by_name(
    busy: Simulation,
) -> None:
    group = tuple(busy.signals_last)
    row = np.full(sum(len(signal.labels) for signal in group), np.nan)
    busy.write_last(row)
    rows, data = filled(group, row), busy.data
    for i, (joint, motor) in enumerate(zip(PANDA.joints, PANDA.motors, strict=True)):
        assert rows["joints/a"][0, i] == data.joint(joint).qacc[0]
        assert rows["joints/tau"][0, i] == data.actuator(motor).force[0]
    np.testing.assert_array_equal(rows["contact/tool"][0], busy.last_tool_force())
    assert rows["contact/links"][0, 0] == busy.last_links_force()
    assert rows["contact/tool"].any()
    for finger in FINGERS:
        force = rows[f"gripper/{finger}_contact"][0]
        np.testing.assert_array_equal(force, data.sensor(f"{finger}_contact").data)
        assert force.any()


def test_the_order_of_a_row_is_reference_now_command_last_derived(busy: Simulation) -> None:
    parts = (
        *ALL[:2],
        *signals.references(PANDA),
        *busy.signals_now,
        signals.command(PANDA),
        *busy.signals_last,
        *signals.derived(PANDA),
    )
    assert parts == ALL


@pytest.mark.parametrize("name", ["panda", "panda_pair"])
def test_reference_columns_are_the_same_to_the_bit_from_the_core(name: str) -> None:
    robot = load_robot(name)
    T_tcp_com = SE3.from_translation(np.array([0.0, 0.01, 0.02]))
    payload = Payload(mass=0.7, T_tcp_com=T_tcp_com, inertia=(1e-3, 1e-3, 1e-3))
    arm, rng = Arm(robot, payload), np.random.default_rng(90_021)
    # Columns of a larger array: samples need not lie in one piece.
    q, v, a = rng.normal(size=(3, 20, 2 * arm.n))[:, :, ::2]
    with using("numpy"):
        expected = signals.reference_rows(arm, (q, v, a))
    last = arm.scratch.qfrc_inverse.copy()
    arm.inverse_dynamics(*np.zeros((3, arm.n)))
    arm.evaluated = False
    with using("compiled"):
        found = signals.reference_rows(arm, (q, v, a))
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(arm.scratch.qfrc_inverse, last)
    assert arm.evaluated
    assert found.shape == (20, sum(len(signal.labels) for signal in signals.references(robot)))


# The contract of every signal.


def test_every_recorded_column_is_known_by_name_and_place() -> None:
    """A recording of earlier days is read by these: a change is meant, or it is a mistake."""
    names = [signal.name for signal in signals.all_signals(Simulation(PANDA, two_objects))]
    assert names == [
        *("time", "phase"),
        *("joints/q_ref", "joints/v_ref", "joints/a_ref", "joints/tau_ref", "tool/pose_ref"),
        *("joints/q", "joints/v", "tool/pose", "gripper/fingers", "gripper/width_command"),
        *("objects/cube", "objects/die", "motion/cube velocity", "motion/die velocity"),
        *("joints/tau_command", "joints/a", "joints/tau"),
        *("contact/tool", "contact/links", "contact/fixed"),
        *("motion/cube acceleration", "motion/die acceleration"),
        *("gripper/left_finger_contact", "gripper/right_finger_contact", "gripper/friction_use"),
        *("errors/q", "errors/tool_position", "errors/tool_angle", "joints/saturated"),
        *("gripper/width", "gripper/force"),
    ]


WORLD = Simulation(PANDA, PickPlace().build_scene)
UNITS = {"rad", "m", "s", "N", "N·m", "count", "-"}
UNITS |= {f"rad/{time}" for time in ("s", "s²")} | {POSE_UNIT}
UNITS |= {"m/s, rad/s", "m/s², rad/s²"}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Rows:
    """The rows of a run, read from its Rerun file."""
    path = tmp_path_factory.mktemp("signals") / "run.rrd"
    log = RerunLog(path, WORLD.model, PANDA, picked_and_placed().rows.signals)
    log.write(picked_and_placed().rows)
    log.finish("done")
    return read_recording(path).rows


def test_a_run_records_every_signal_in_order_and_its_file_those_that_are_shown(
    recorded: Rows,
) -> None:
    every = signals.all_signals(WORLD)
    assert picked_and_placed().rows.signals == every
    assert {s.name for s in recorded.signals} == {"time", *(s.name for s in every if s.shown)}


@pytest.mark.parametrize("signal", signals.all_signals(WORLD), ids=lambda signal: signal.name)
def test_every_signal_of_a_run_is_finite_and_has_its_shape(signal: Signal, recorded: Rows) -> None:
    run = picked_and_placed()
    values = run.rows[signal.name]
    assert values.shape == (len(run.rows), len(signal.labels))
    assert len(set(signal.labels)) == len(signal.labels)
    assert signal.unit in UNITS
    assert np.isfinite(values).all()
    if signal.shown:
        assert signal in recorded.signals
        np.testing.assert_array_equal(recorded[signal.name], values)
    # Neither links nor the hand touch what is fixed, and no motor is at its limit.
    if signal.name not in ("contact/links", "contact/fixed", "joints/saturated"):
        assert len(np.unique(values)) > 1, "it is never filled"
