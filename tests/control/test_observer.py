from dataclasses import replace

import numpy as np
import pytest
from mink import SE3

from robo47_qp._core.library import using
from robo47_qp.arrays import Vector
from robo47_qp.control.active import ActiveController
from robo47_qp.control.cartesian_impedance import CartesianImpedance
from robo47_qp.control.computed_torque import ComputedTorque
from robo47_qp.control.controller import Controller, dry_friction_torque
from robo47_qp.control.friction import FrictionLearning
from robo47_qp.control.joint_impedance import JointImpedance
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.push import Push
from tests.controlled import DT, LOAD, World, at_rest
from tests.plain_arm import PlainArm
from tests.runs import no_objects

EXACT = DisturbanceObserver(noise_q=0.0)
NO_FRICTION = DisturbanceObserver(noise_q=0.0, friction=None)


def hold(
    active: ActiveController, world: World, q_ref: Vector, periods: int, **push: Vector
) -> JointState:
    for _ in range(periods):
        world.step(active.torque(at_rest(q_ref), world.state()), **push)
    return world.state()


def test_a_constant_force_is_found_and_met(arm: Arm, plain: PlainArm) -> None:
    """The estimate is that of the force alone: M d = Jᵀ F, with J and M of MuJoCo."""
    observer = DisturbanceObserver(noise_q=0.0, friction=None, torque_share=1.0)
    active = ActiveController(ComputedTorque(), arm, dt=DT, observer=observer)
    world, force = World(plain, arm.home), np.array([3.0, -4.0, 5.0])
    end = hold(active, world, arm.home, 1500, force=force)
    assert active.observed is not None
    J_world = arm.pose(end.q).rotation().as_matrix() @ arm.jacobian(end.q)[:3]
    expected = J_world.T @ force
    found = arm.mass_matrix(end.q) @ active.observed.disturbance
    assert found == pytest.approx(expected, abs=0.02 * np.abs(expected).max())
    assert np.abs(end.q - arm.home).max() < 1e-5
    without = ActiveController(ComputedTorque(), arm, dt=DT)
    sagged = hold(without, World(plain, arm.home), arm.home, 1500, force=force)
    assert np.abs(sagged.q - arm.home).max() > 1e-3


def test_while_moving_it_is_what_inverse_dynamics_lacks(robot: Robot, arm: Arm) -> None:
    """Against the inverse dynamics of an arm that is told of the load, along the true motion."""
    told = arm.with_payload(LOAD)
    sim = DisturbedSimulation(robot, no_objects, Disturbance(payload=LOAD))
    active = ActiveController(ComputedTorque(), arm, dt=DT, observer=NO_FRICTION)
    way = plan_ptp(arm.home, arm.home + 0.3, robot.profile, DT)
    errors, sizes, moving = [], [], []
    for q, v, a in zip(way.q, way.v, way.a, strict=True):
        state = sim.true_state()
        sim.step(active.torque(JointReference(q, v, a), sim.state()))
        assert active.observed is not None
        truth = arm.inverse_dynamics(*state, a) - told.inverse_dynamics(*state, a)
        # Of the joints' dry friction a share is fed forward; the observer sees the rest.
        truth -= arm.dry_friction * np.sign(state.v) - dry_friction_torque(arm, v)
        moving.append(not arm.has_dry_friction or np.abs(state.v).min() > 0.02)
        errors.append(arm.mass_matrix(state.q) @ active.observed.disturbance - truth)
        sizes.append(truth)
    settled = np.flatnonzero(moving)[100:]
    assert len(settled) > 0.7 * len(way.q)
    assert np.abs(np.array(errors)[settled]).max() < 0.1 * np.abs(np.array(sizes)[settled]).max()


def test_with_an_exact_model_there_is_nothing_to_compensate(robot: Robot, arm: Arm) -> None:
    sim = DisturbedSimulation(robot, no_objects, Disturbance())
    active = ActiveController(ComputedTorque(), arm, dt=DT, observer=EXACT)
    way = plan_ptp(arm.home, arm.home + 0.3, robot.profile, DT)
    for q, v, a in zip(way.q, way.v, way.a, strict=True):
        assert np.abs(sim.true_state().q - q).max() < (1e-3 if arm.has_dry_friction else 0.2e-3)
        sim.step(active.torque(JointReference(q, v, a), sim.state()))
    if not arm.has_dry_friction:
        assert active.observed is not None
        assert active.observed.friction == pytest.approx(0.0, abs=0.02)


FRICTION = np.array([0.5, 0.5, 0.5, 0.5, 0.3, 0.3, 0.3])


def there_and_back(
    sim: DisturbedSimulation, active: ActiveController, trips: int
) -> tuple[Vector, Vector]:
    """Move from home to a goal and back; errors while moving (N, n), and at rest in between."""
    arm = active.arm
    goal = arm.home + np.array([0.45, 0.2, -0.25, 0.3, -0.35, 0.2, -0.4])
    moving, resting = [], []
    for k in range(trips):
        ends = (arm.home, goal) if k % 2 == 0 else (goal, arm.home)
        way = plan_ptp(ends[0], ends[1], arm.robot.profile, DT)
        for sample in zip(way.q, way.v, way.a, strict=True):
            moving.append(sample[0] - sim.true_state().q)
            sim.step(active.torque(JointReference(*sample), sim.state()))
        for _ in range(300):
            sim.step(active.torque(at_rest(ends[1]), sim.state()))
        resting.append(ends[1] - sim.true_state().q)
    return np.array(moving), np.array(resting)


def test_heavier_links_and_dry_friction_leave_no_error() -> None:
    arm = Arm(PANDA)
    wrong = Disturbance(link_mass_factor=1.05, dry_friction=0.5)
    sim = DisturbedSimulation(PANDA, no_objects, wrong)
    active = ActiveController(ComputedTorque(), arm, dt=DT, observer=EXACT)
    moving, resting = there_and_back(sim, active, 2)
    assert np.abs(moving).max() < 1.3e-3
    assert np.abs(resting).max() < 0.3e-3
    without = ActiveController(JointImpedance(), arm, dt=DT)
    before, _ = there_and_back(DisturbedSimulation(PANDA, no_objects, wrong), without, 1)
    assert np.abs(before).max() > 4e-3


def test_friction_is_learned_and_later_reversals_are_met_with_it() -> None:
    arm = Arm(PANDA)
    errors = {}
    for name, observer in (("learned", EXACT), ("not", NO_FRICTION)):
        active = ActiveController(ComputedTorque(), arm, dt=DT, observer=observer)
        sim = DisturbedSimulation(PANDA, no_objects, Disturbance(dry_friction=0.5))
        moving, _ = there_and_back(sim, active, 4)
        errors[name] = np.abs(moving[len(moving) // 2 :]).max()
        if name == "learned":
            assert active.observed is not None
            assert active.observed.friction == pytest.approx(FRICTION, rel=0.15)
            asked: list[Vector] = []
            turns_at_once(sim, active, asked)
            # A torque that turned at once would change by twice the friction: by 1 N m in 1 ms.
            assert (np.abs(np.diff(asked, axis=0)) < 0.5 * PANDA.tau_rate_max * DT).all()
    assert errors["learned"] < 0.6 * errors["not"]


def turns_at_once(sim: DisturbedSimulation, active: ActiveController, asked: list[Vector]) -> None:
    """Lead all joints back by 1 mrad within 10 ms, one update of the friction."""
    for k in range(40):
        back = 1e-4 * np.clip(k - 20, 0, 10)
        sim.step(active.torque(at_rest(PANDA.home - back), sim.state()))
        asked.append(active.commanded.copy())


def loop(delay: int, mass: float, arm: Arm, observer: DisturbanceObserver) -> np.ndarray:
    """The linear loop of all joints at home, by pushing each number of its state on its own.

    The world has `mass` times the inertia that the belief has, and gets torques `delay` late.
    """
    n, M = arm.n, arm.mass_matrix(arm.home)
    g = arm.inverse_dynamics(arm.home, np.zeros(n), np.zeros(n))
    B, home = np.diag(arm.model.dof_damping), np.outer([1.0, 0.0, 0.0, 0.0], arm.home)
    inverse = np.linalg.inv(mass * M + DT * B)

    def step(x: Vector, known: Vector, queue: Vector) -> Vector:
        active = ActiveController(ComputedTorque(), arm, dt=DT, observer=observer)
        seen = active.observed
        assert seen is not None
        seen.estimate(at_rest(arm.home), arm.home)
        rows = seen._now.whole.reshape(5, n)
        rows[:4] = known.reshape(4, n) + home
        q, v = x.reshape(2, n)
        reference, state = seen.estimate(at_rest(arm.home), arm.home + q)
        tau = ComputedTorque().torque(arm, reference, state)
        seen.expect(arm, reference, tau)
        sent = np.vstack([queue.reshape(-1, n), tau - g])
        v = v + DT * inverse @ (sent[0] - B @ v)
        rows = seen._now.whole.reshape(5, n)
        after = rows[:4] - home
        return np.concatenate([q + DT * v, v, after.reshape(-1), sent[1:].reshape(-1)])

    size, small = (2 + 4 + delay) * n, 1e-6
    columns = []
    for i in range(size):
        x = np.zeros(size)
        x[i] = small
        columns.append(step(x[: 2 * n], x[2 * n : 6 * n], x[6 * n :]) / small)
    return np.array(columns).T


@pytest.mark.parametrize(("delay", "mass"), [(0, 1.0), (3, 0.9), (5, 1.0), (5, 0.9), (5, 1.2)])
def test_a_delay_that_nobody_told_of_leaves_it_stable(delay: int, mass: float) -> None:
    """Every eigenvalue of the sampled loop decays, at 5 ms as well."""
    arm = Arm(PANDA)
    rates = np.log(np.abs(np.linalg.eigvals(loop(delay, mass, arm, NO_FRICTION))) + 1e-12) / DT
    assert rates.max() < -3.0


@pytest.mark.parametrize("beyond", [0.0, 0.1])
def test_a_payload_that_is_believed_and_not_there_leaves_it_stable(beyond: float) -> None:
    """As much as the Panda is rated for, at the tool point and beyond it."""
    there = SE3.from_translation(np.array([0.0, 0.0, beyond]))
    load = Payload(mass=3.0, inertia=(0.01, 0.01, 0.01), T_tcp_com=there)
    arm, sim = Arm(PANDA).with_payload(load), DisturbedSimulation(PANDA, no_objects, Disturbance())
    active = ActiveController(ComputedTorque(), arm, dt=DT, observer=DisturbanceObserver())
    for _ in range(1500):
        sim.step(active.torque(at_rest(PANDA.home), sim.state()))
    assert np.abs(sim.true_state().v).max() < 1e-6
    assert np.abs(sim.true_state().q - PANDA.home).max() < 1e-6


@pytest.mark.parametrize(("state", "command"), [(3, 0), (3, 4)])
def test_a_delay_that_is_told_is_made_up_for(state: int, command: int) -> None:
    arm, errors = Arm(PANDA), []
    way = plan_ptp(arm.home, arm.home + 0.3, PANDA.profile, DT)
    told = DisturbanceObserver(noise_q=0.0, state_delay=state, command_delay=command)
    for observer in (EXACT, told):
        sim = DisturbedSimulation(PANDA, no_objects, Disturbance(torque_delay=command * DT))
        active = ActiveController(ComputedTorque(), arm, dt=DT, observer=observer)
        off, seen = [], [sim.state()] * state
        for q, v, a in zip(way.q, way.v, way.a, strict=True):
            off.append(np.abs(q - sim.true_state().q).max())
            seen.append(sim.state())
            sim.step(active.torque(JointReference(q, v, a), seen.pop(0)))
        errors.append(max(off))
    assert errors[1] < 0.1 * errors[0]
    assert errors[1] < 0.2e-3


def test_noise_of_the_positions_keeps_the_torque_rate(rng: np.random.Generator) -> None:
    arm, noise = Arm(PANDA), 1e-4
    sim = DisturbedSimulation(PANDA, no_objects, Disturbance(noise_q=noise), rng)
    active = ActiveController(
        ComputedTorque(),
        arm,
        dt=DT,
        observer=DisturbanceObserver().in_cell(noise, 0.0, 0.0, 0.0, DT),
    )
    way = plan_ptp(arm.home, arm.home + 0.4, PANDA.profile, DT)
    asked = []
    for q, v, a in zip(way.q, way.v, way.a, strict=True):
        assert np.abs(sim.true_state().q - q).max() < 0.4e-3
        sim.step(active.torque(JointReference(q, v, a), sim.state()))
        asked.append(active.commanded.copy())
    change = np.diff(asked, axis=0)
    assert (np.abs(change) < PANDA.tau_rate_max * DT).all()
    assert (6.0 * change.std(axis=0) < PANDA.tau_rate_max * DT).all()


def test_more_noise_takes_bandwidth_and_none_leaves_all(arm: Arm) -> None:
    quiet, loud = (DisturbanceObserver(noise_q=s).bandwidths(arm, DT).usual for s in (0.0, 1e-3))
    assert (quiet == DisturbanceObserver().bandwidth).all()
    assert (loud <= quiet).all()
    assert (loud < quiet).any()


def test_measured_velocities_are_not_used(arm: Arm) -> None:
    taus = []
    for v in (0.0, 0.5):
        active = ActiveController(ComputedTorque(), arm, dt=DT, observer=EXACT)
        taus.append(active.torque(at_rest(arm.home), JointState(arm.home, np.full(arm.n, v))))
    assert taus[0].tolist() == taus[1].tolist()


@pytest.mark.parametrize(("side", "name"), [(1.0, "numpy"), (-1.0, "numpy"), (1.0, "compiled")])
@pytest.mark.parametrize("controller", [ComputedTorque(), CartesianImpedance()])
def test_at_the_motors_limits_nothing_winds_up(
    arm: Arm, plain: PlainArm, controller: Controller, side: float, name: str
) -> None:
    """Pushed beyond the compensation for long, and let go of: it returns as one never pushed."""
    robot = arm.robot
    # Half as much again as is compensated: springs of the tool bear it without folding the arm.
    torque = side * 0.3 * robot.tau_max
    ends, swings = {}, {}
    for seconds in (0.3, 1.5):
        with using(name):
            active = ActiveController(controller, arm, dt=DT, observer=NO_FRICTION)
        world = World(plain, arm.home)
        for k in range(round(seconds / DT)):
            tau = active.torque(at_rest(arm.home), world.state())
            world.step(tau + (torque if k > 100 else 0.0) * np.eye(arm.n)[1])
            assert active.observed is not None
            bound = 0.2 * robot.tau_max * np.diag(np.linalg.inv(arm.mass_matrix(arm.home)))
            assert (np.abs(active.observed.compensation) <= bound * (1 + 1e-9)).all()
        assert active.observed is not None
        ends[seconds] = np.abs(active.observed.disturbance).max()
        pushed = world.state().q - arm.home
        way = [hold(active, world, arm.home, 1).q - arm.home for _ in range(2000)]
        swings[seconds] = (-np.sign(pushed) * way).max() / np.abs(pushed).max()
        assert np.abs(way[-1]).max() < 0.02 * np.abs(pushed).max()
    assert ends[1.5] < 2.0 * ends[0.3]
    assert swings[1.5] < 1.5 * swings[0.3]


def test_held_in_contact_it_presses_no_harder_with_time() -> None:
    """Against a spring that keeps the arm from its reference."""
    arm, pressed = Arm(PANDA), {}
    stop = 2e4
    for held in (True, False):
        sim = DisturbedSimulation(PANDA, no_objects, Disturbance())
        active = ActiveController(ComputedTorque(), arm, dt=DT, observer=NO_FRICTION)
        active.compensate(not held)
        q_ref, depth = arm.home + 0.01 * np.eye(arm.n)[1], 0.0
        for _ in range(1500):
            # A wall where the second joint is at home.
            depth = max(0.0, sim.true_state().q[1] - arm.home[1])
            sim.data.qfrc_applied[1] = -stop * depth
            sim.step(active.torque(at_rest(q_ref), sim.state()))
        pressed[held] = stop * depth
    stiff = ComputedTorque().frequency ** 2 * arm.mass_matrix(arm.home)[1, 1] * 0.01
    assert pressed[True] < 1.1 * stiff
    assert pressed[False] > 1.2 * pressed[True]


def test_after_contact_the_compensation_comes_back_without_a_bump(arm: Arm) -> None:
    active = ActiveController(ComputedTorque(), arm, dt=DT, observer=NO_FRICTION)
    off = JointState(arm.home + 1e-3, np.zeros(arm.n))
    for _ in range(200):
        active.torque(at_rest(arm.home), off)
    assert active.observed is not None
    active.compensate(False)
    before = active.observed.compensation
    for _ in range(100):
        active.torque(at_rest(arm.home), JointState(arm.home - 1e-3, off.v))
    assert active.observed.compensation.tolist() == before.tolist()
    active.compensate(True)
    path = [before]
    for _ in range(150):
        active.torque(at_rest(arm.home), JointState(arm.home - 1e-3, off.v))
        path.append(active.observed.compensation)
    steps = np.abs(np.diff(path, axis=0)).max(axis=0)
    assert (steps <= 0.05 * np.abs(path[-1] - path[0]) + 0.05 * np.abs(path[-1]) + 1e-9).all()


def test_an_observer_starts_anew_with_every_run(arm: Arm) -> None:
    first = ActiveController(ComputedTorque(), arm, dt=DT, observer=EXACT)
    for k in range(60):
        first.torque(at_rest(arm.home), JointState(arm.home + 1e-3 * np.sin(k), np.zeros(arm.n)))
    taus = []
    for _ in range(2):
        active = ActiveController(ComputedTorque(), arm, dt=DT, observer=EXACT)
        state = JointState(arm.home + 1e-3, np.zeros(arm.n))
        taus.append([active.torque(at_rest(arm.home), state).tolist() for _ in range(50)])
    assert taus[0] == taus[1]


def test_every_controller_may_have_one(robot: Robot, arm: Arm) -> None:
    """A push that is met by the observer leaves a tenth of the error."""
    push = Push(force=np.array([5.0, 5.0, -5.0]), start=0.0, duration=2.0)
    for controller in (JointImpedance(), CartesianImpedance()):
        off = []
        for observer in (None, NO_FRICTION):
            sim = DisturbedSimulation(robot, no_objects, Disturbance(pushes=(push,)))
            active = ActiveController(controller, arm, dt=DT, observer=observer)
            for _ in range(1000):
                sim.step(active.torque(at_rest(arm.home), sim.state()))
            moved = sim.tool_pose().translation() - arm.pose(arm.home).translation()
            off.append(np.linalg.norm(moved))
        assert off[1] < 0.1 * off[0]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"bandwidth": 0.0}, "bandwidth must be above 0"),
        ({"noise_q": -1.0}, "noise_q must be 0 or more"),
        ({"torque_share": 1.1}, "torque_share must be at least 0 and at most 1"),
        ({"command_delay": -1}, "command_delay must be"),
    ],
)
def test_other_settings_are_refused(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        DisturbanceObserver(**setting)  # type: ignore[arg-type]


def test_friction_settings_out_of_range_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="displacement must be above 0"):
        FrictionLearning(displacement=0.0)


def test_a_reference_is_taken_ahead_of_the_commands_delay(arm: Arm) -> None:
    observed = replace(NO_FRICTION, command_delay=4).build(arm, DT)
    v, a, t = np.full(arm.n, 0.3), np.full(arm.n, 5.0), 4 * DT
    sampled = JointReference(arm.home, v - 0.5 * DT * a, a)
    ahead, _ = observed.estimate(sampled, arm.home)
    assert ahead.q == pytest.approx(arm.home + t * v + 0.5 * t**2 * a, abs=1e-12)
    assert ahead.v == pytest.approx(v + (t - 0.5 * DT) * a, abs=1e-12)
