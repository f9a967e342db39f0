from dataclasses import replace

import numpy as np
import pytest
from mink import SE3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.control.active import ActiveController
from robo47_qp.control.cartesian_impedance import CartesianImpedance
from robo47_qp.control.controller import Controller
from robo47_qp.control.joint_impedance import JointImpedance
from robo47_qp.control.pressing import Pressing
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.model.payload import Payload
from robo47_qp.model.robots.panda import PANDA
from tests.controlled import DT, LOAD, World, at_rest
from tests.plain_arm import PlainArm
from tests.pressed import Bench, Contact

PRESS = Pressing(force=10.0)
WIPE = Pressing(force=10.0, speed_max=0.118)
"""The friction of the joints takes a part of its speed: the pad arrives at 0.1 m/s."""
SLANTED = np.array([1.0, -2.0, 2.0])
STIFFNESS = np.array([600.0, 900.0, 1200.0, 30.0, 40.0, 50.0])
BARE = CartesianImpedance(stiffness=STIFFNESS, posture_frequency=0.0, posture_damping=0.0)


def nothing() -> Vector:
    return np.zeros(3)


def pressing_back(force: float) -> Vector:
    """What a table below feels like."""
    return np.array([0.0, 0.0, force])


def world_jacobian(plain: PlainArm, q: Vector) -> Matrix:
    J, R = plain.jacobian(q), plain.tool(q)[1]
    return np.vstack([R @ J[:3], R @ J[3:]])


def wrench(plain: PlainArm, arm: Arm, controller: Controller, q_ref: Vector) -> Vector:
    """What the tool would exert at rest at home, in the world (6,): Jᵀ w = tau - g."""
    still = np.zeros(arm.n)
    tau = controller.torque(arm, at_rest(q_ref), JointState(arm.home, still))
    tau = tau - arm.inverse_dynamics(arm.home, still, still)
    found = np.linalg.lstsq(world_jacobian(plain, arm.home).T, tau, rcond=None)[0]
    return np.array(found, dtype=np.float64)


@pytest.mark.parametrize("frame", ["world", "tool"])
def test_it_presses_along_the_axis_and_is_a_spring_along_all_others(
    arm: Arm, plain: PlainArm, rng: np.random.Generator, frame: str
) -> None:
    """P K P e + u F for the linear part, with P = I - u u'; the rest as without pressing."""
    impedance = replace(BARE, frame=frame)  # type: ignore[arg-type]
    presser = Pressing(force=7.0, axis=SLANTED, impedance=impedance).build(arm, nothing)
    q_ref = arm.home + 0.03 * rng.uniform(-1, 1, arm.n)
    found = wrench(plain, arm, presser, q_ref)
    p_ref, R_ref = plain.tool(q_ref)
    axes = np.eye(3) if frame == "world" else R_ref
    e = axes.T @ (p_ref - plain.tool(arm.home)[0])
    u = SLANTED / 3.0
    P = np.eye(3) - np.outer(u, u)
    expected = axes @ (P @ (STIFFNESS[:3] * (P @ e)) + 7.0 * u)
    assert found[:3] == pytest.approx(expected, abs=1e-3)
    without = wrench(plain, arm, impedance, q_ref)[3:]
    assert found[3:] == pytest.approx(without, abs=1e-3)
    assert np.abs(without).max() > 0.1


def test_dampers_act_across_the_axis_alone(arm: Arm, plain: PlainArm) -> None:
    """P D P for the velocity across, D = 2 √(K Λ) with Λ from energies and differences."""
    J, M, u = world_jacobian(plain, arm.home), plain.mass_matrix(arm.home), SLANTED / 3.0
    inertia = np.linalg.inv(J @ np.linalg.solve(M, J.T))
    twist = np.array([0.02, 0.03, -0.04, 0.0, 0.0, 0.0])
    v = np.linalg.solve(M, J.T @ inertia @ twist)
    presser = Pressing(force=7.0, axis=SLANTED, impedance=BARE).build(arm, nothing)
    still = np.zeros(arm.n)
    tau = presser.torque(arm, at_rest(arm.home), JointState(arm.home, v))
    P = np.eye(3) - np.outer(u, u)
    D = 2.0 * np.sqrt(STIFFNESS[:3] * np.diag(inertia)[:3])
    expected = -P @ (D * (P @ twist[:3])) + 7.0 * (1.0 - u @ twist[:3] / 0.1) * u
    tau -= arm.inverse_dynamics(arm.home, still, still)
    assert tau == pytest.approx(J[:3].T @ expected, abs=0.02)


def test_what_the_impedance_says_of_the_axis_is_not_used(
    arm: Arm, rng: np.random.Generator
) -> None:
    q, v = arm.home + 0.05 * rng.uniform(-1, 1, arm.n), rng.uniform(-1, 1, arm.n)
    found = []
    for stiffness in (0.0, 3000.0):
        impedance = CartesianImpedance(stiffness=np.array([600.0, 900.0, stiffness, 30, 40, 50]))
        presser = replace(PRESS, impedance=impedance).build(arm, nothing)
        found.append(presser.torque(arm, at_rest(arm.home), JointState(q, v)))
    assert found[0] == pytest.approx(found[1], abs=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0, 1.5])
def test_the_push_falls_to_zero_at_the_speed_and_brakes_beyond(
    arm: Arm, plain: PlainArm, share: float
) -> None:
    """Without springs nor damping of anything else; the trim changes force, not speed."""
    free = CartesianImpedance(stiffness=np.zeros(6), posture_frequency=0.0, posture_damping=0.0)
    J = world_jacobian(plain, arm.home)
    v = np.linalg.pinv(J) @ np.array([0.0, 0.0, -0.1 * share, 0.0, 0.0, 0.0])
    for trim in (0.0, 4.0):
        presser = replace(PRESS, impedance=free).build(arm, lambda: pressing_back(10.0))
        presser.trim = trim
        state = JointState(arm.home, v)
        tau = presser.torque(arm, JointReference(arm.home, v, np.zeros(arm.n)), state)
        tau -= arm.inverse_dynamics(arm.home, v, np.zeros(arm.n))
        if arm.has_dry_friction:
            tau -= 0.8 * arm.dry_friction * np.tanh(v / 0.05)
        expected = J[2] * -(10.0 + trim) * (1.0 - share)
        assert tau == pytest.approx(expected, abs=2e-3)


def test_without_contact_the_tool_is_no_faster_than_its_speed(arm: Arm, plain: PlainArm) -> None:
    presser = replace(PRESS, axis=np.array([0.0, 0.0, 1.0])).build(arm, nothing)
    world, top = World(plain, arm.home), 0.0
    for _ in range(500):
        state = world.state()
        top = max(top, float((world_jacobian(plain, state.q) @ state.v)[2]))
        world.step(presser.torque(arm, at_rest(arm.home), state))
    assert 0.01 < top < 0.1 * 1.02


@pytest.mark.parametrize("frame", ["world", "tool"])
def test_the_trim_integrates_what_is_missing_once_a_period(arm: Arm, frame: str) -> None:
    """Pressing along x of the frame, with three different forces at the sensor."""
    R = arm.pose(arm.home).rotation().as_matrix() if frame == "tool" else np.eye(3)
    felt = [np.zeros(3)]
    impedance = CartesianImpedance(frame=frame)  # type: ignore[arg-type]
    settings = Pressing(force=10.0, axis=np.array([2.0, 0, 0]), impedance=impedance, trim_rate=0.5)
    presser = settings.build(arm, lambda: felt[0])

    def period(force: float) -> float:
        felt[0] = R @ np.array([-force, 3.0, -2.0])
        state = JointState(arm.home.copy(), np.zeros(arm.n))
        for _ in range(2):
            presser.torque(arm, at_rest(arm.home), state)
        assert presser.pressed == pytest.approx(force)
        return presser.trim

    step = 0.5 * DT
    assert period(0.0) == 0.0
    assert period(0.9) == 0.0
    assert period(-20.0) == 0.0
    assert period(4.0) == pytest.approx(6.0 * step)
    assert period(12.0) == pytest.approx(4.0 * step)
    assert period(100.0) == pytest.approx(-6.0 * step)
    assert period(0.0) == pytest.approx(-6.0 * step * (1.0 - step))


@pytest.mark.parametrize(("pressed", "bound"), [(2.0, 3.0), (30.0, -3.0)])
def test_the_trim_is_bounded(arm: Arm, pressed: float, bound: float) -> None:
    presser = replace(PRESS, trim_max=0.3).build(arm, lambda: pressing_back(pressed))
    for _ in range(2500):
        presser.torque(arm, at_rest(arm.home), JointState(arm.home, np.zeros(arm.n)))
    assert presser.trim == bound


def test_a_heavy_arm_that_presses_lightly_trims_slowly(arm: Arm, plain: PlainArm) -> None:
    """γ is held below half of F / (s Λ_u), with Λ from energies and differences of poses."""
    light = Pressing(force=0.5, trim_rate=50.0)
    presser = light.build(arm, lambda: pressing_back(0.3))
    presser.torque(arm, at_rest(arm.home), JointState(arm.home, np.zeros(arm.n)))
    J, M = world_jacobian(plain, arm.home), plain.mass_matrix(arm.home)
    inertia = np.linalg.inv(J @ np.linalg.solve(M, J.T))[2, 2]
    assert presser.trim == pytest.approx(0.2 * DT * 0.5 * 0.5 / (0.1 * inertia), rel=0.01)


def test_it_takes_over_without_a_bump_and_keeps_its_trim_with_another_payload(arm: Arm) -> None:
    active = ActiveController(JointImpedance(), arm, dt=DT)
    presser = PRESS.build(arm, lambda: pressing_back(8.0))
    q, v = arm.home + 0.005, np.zeros(arm.n)
    path, trims = [], []
    for k in range(300):
        if k == 50:
            active.switch(presser, seconds=0.05)
        if k == 150:
            active.set_arm(arm.with_payload(LOAD), seconds=0.05)
        if k == 220:
            active.switch(JointImpedance(), seconds=0.05)
        active.torque(at_rest(arm.home), JointState(q.copy(), v.copy()))
        path.append(active.commanded)
        trims.append(presser.trim)
    jumps = np.abs(np.diff(path, axis=0)).max(axis=0)
    assert (jumps < 0.1 * np.ptp(path, axis=0) + 1e-3).all()
    assert np.ptp(path, axis=0).max() > 1.0
    steps = np.diff(trims)[50:219]
    assert steps.min() > 0.0
    assert steps.max() < 1.2 * steps.min()
    assert (
        np.abs(np.array(path[215]) - pressed_alone(arm.with_payload(LOAD), q, trims[215])).max()
        < 1e-9
    )


def pressed_alone(belief: Arm, q: Vector, trim: float) -> Vector:
    presser = replace(PRESS, trim_rate=0.0).build(belief, lambda: pressing_back(8.0))
    presser.trim = trim
    return presser.torque(belief, at_rest(belief.home), JointState(q, np.zeros(belief.n)))


@pytest.mark.parametrize("gap", [0.0, 1e-3, 0.1])
def test_at_a_singularity_it_stays_calm(arm: Arm, plain: PlainArm, gap: float) -> None:
    """All joints straight: along the tool's own axis no joint can move it."""
    q = np.clip(np.full(arm.n, gap), arm.q_min + 0.02, arm.q_max - 0.02)
    axis = plain.tool(q)[1][:, 2]
    presser = replace(PRESS, axis=axis).build(arm, nothing)
    world, worst = World(plain, q), 0.0
    for _ in range(500):
        state = world.state()
        tau = presser.torque(arm, at_rest(q), state)
        assert np.isfinite(tau).all()
        world.step(np.clip(tau, -arm.robot.tau_max, arm.robot.tau_max))
        worst = max(worst, float(np.abs(state.v).max()))
    assert worst < 4.0


@pytest.mark.parametrize("time_constant", [0.02, 0.004, 0.002])
def test_on_the_table_it_lands_softly_and_wipes_with_a_steady_force(time_constant: float) -> None:
    """From MuJoCo's default contact to the stiffest that its time step allows."""
    bench = Bench(Contact(time_constant=time_constant), WIPE)
    bench.rest(1.8)
    assert bench.touching_speed() == pytest.approx(0.1, abs=0.002)
    on = bench.touched()
    forces = np.array(bench.forces)
    assert forces.max() < 30.0
    assert (forces[on:] > 0.0).all()
    assert np.abs(forces[on + 900 :] - 10.0).max() < 0.5
    bench.slide((0.0, 0.3, 0.0))
    assert np.abs(np.array(bench.forces[1800:]) - 10.0).max() < 0.5


def test_what_a_rigid_tool_meets_is_its_inertia(plain_panda: PlainArm) -> None:
    """MuJoCo's contact brakes at once, at 2 / (0.95 tc) times the speed, and 0.9 of that at its
    surface (solref and solimp): no controller is in time."""
    bench = Bench(Contact(spring=None, friction=1e-5), WIPE)
    bench.rest(1.0)
    q = bench.robot.home
    J, M = world_jacobian(plain_panda, q)[2], plain_panda.mass_matrix(q)
    mass = 1.0 / (J @ np.linalg.solve(M, J))
    expected = 0.9 * 2.0 / (0.95 * 0.02) * bench.touching_speed() * mass
    assert expected > 50.0
    assert max(bench.forces) == pytest.approx(expected, rel=0.1)


@pytest.fixture(scope="module")
def plain_panda() -> PlainArm:
    return PlainArm(PANDA)


@pytest.mark.parametrize("spring", [400.0, 20000.0])
def test_the_force_does_not_depend_on_the_stiffness(spring: float) -> None:
    bench = Bench(Contact(spring=spring, damping=0.02 * spring), WIPE, height=0.02)
    bench.rest(2.5)
    assert np.abs(np.array(bench.forces[-300:]) - 10.0).max() < 0.1


def test_the_trim_makes_up_for_an_unknown_payload() -> None:
    load = Payload(mass=0.1, inertia=(1e-4, 1e-4, 1e-4), T_tcp_com=LOAD.T_tcp_com)
    last = {}
    for rate in (0.0, 5.0):
        bench = Bench(Contact(), replace(WIPE, trim_rate=rate), height=0.01, unknown=load)
        bench.rest(1.5)
        last[rate] = float(np.mean(bench.forces[-100:]))
    assert last[0.0] == pytest.approx(10.0 + 0.981, abs=0.05)
    assert last[5.0] == pytest.approx(10.0, abs=0.1)


def test_when_the_table_goes_the_tool_follows_at_its_speed() -> None:
    bench = Bench(Contact(), PRESS, height=0.01)
    bench.rest(1.2)
    lower = SE3.from_translation(np.array([0.0, 0.0, -0.05])) @ bench.sim.marker_pose("table")
    bench.sim.place_marker("table", lower)
    bench.rest(1.5)
    falling = -np.diff(bench.heights[1200:]) / DT
    # The pad itself springs back first.
    assert falling[60:].max() < 0.1
    assert bench.heights[-1] - bench.heights[1199] == pytest.approx(-0.05, abs=5e-4)
    assert bench.forces[-1] == pytest.approx(10.0, abs=0.5)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"force": 0.0}, "force must be above 0 and finite"),
        ({"force": np.nan}, "force must be above 0 and finite"),
        ({"speed_max": -0.1}, "speed_max must be above 0 and finite"),
        ({"trim_rate": -1.0}, "trim_rate must be 0 or more and finite"),
        ({"trim_max": np.inf}, "trim_max must be at least 0 and below 1"),
        ({"trim_max": 1.0}, "trim_max must be at least 0 and below 1"),
        ({"axis": np.zeros(3)}, "axis must be a vector with a direction"),
        ({"axis": np.ones(2)}, "axis must be a vector of 3"),
    ],
)
def test_another_setting_is_refused(setting: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        Pressing(**{"force": 10.0, **setting})  # type: ignore[arg-type]


def test_its_axis_is_a_unit_vector_that_cannot_be_changed() -> None:
    axis = Pressing(force=1.0, axis=SLANTED).axis
    assert axis == pytest.approx(SLANTED / 3.0)
    with pytest.raises(ValueError, match="read-only"):
        axis[0] = 1.0
