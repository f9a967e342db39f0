import numpy as np
import pytest

from robo47_qp._core.library import BACKENDS, using
from robo47_qp.arrays import Vector
from robo47_qp.control.active import ActiveController
from robo47_qp.control.cartesian_impedance import CartesianImpedance
from robo47_qp.control.computed_torque import ComputedTorque
from robo47_qp.control.controller import Controller
from robo47_qp.control.joint_impedance import FeedForward, JointImpedance
from robo47_qp.control.joint_stops import JointStops
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.control.operational_space import OperationalSpace
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.model.robot import MotionProfile, Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.push import Push
from robo47_qp.sim.simulation import Simulation
from tests.controlled import DT, LOAD, at_rest
from tests.runs import no_objects

MEMBERS: tuple[Controller, ...] = (
    JointImpedance(),
    CartesianImpedance(),
    CartesianImpedance(frame="tool"),
    OperationalSpace(),
)
member = pytest.mark.parametrize("controller", MEMBERS, ids=lambda c: type(c).__name__)
each_backend = pytest.mark.parametrize("backend", BACKENDS)


class Fixed:
    """Asks for the same torque whatever happens."""

    def __init__(self, tau: Vector) -> None:
        self.tau = tau

    def torque(self, arm: Arm, reference: JointReference, state: JointState) -> Vector:
        return self.tau.copy()


def home_torque(arm: Arm) -> Vector:
    return arm.inverse_dynamics(arm.home, np.zeros(arm.n), np.zeros(arm.n))


def ask(active: ActiveController, arm: Arm) -> Vector:
    return active.torque(at_rest(arm.home), JointState(arm.home, np.zeros(arm.n)))


def assert_same(backend: str, tau: Vector, expected: Vector) -> None:
    """To the bit, or where the compiled core adds up small matrices in its own order, to 1e-12."""
    if backend == "numpy":
        assert tau.tolist() == expected.tolist()
    assert np.abs(tau - expected).max() <= 1e-12 * np.abs(expected).max()


@each_backend
@member
def test_within_the_limits_it_changes_nothing(
    controller: Controller, arm: Arm, backend: str
) -> None:
    with using(backend):
        active = ActiveController(controller, arm, dt=DT)
    state = JointState(arm.home + 1e-4, np.full(arm.n, 1e-4))
    tau = active.torque(at_rest(arm.home), state)
    assert_same(backend, tau, controller.torque(arm, at_rest(arm.home), state))
    assert active.commanded.tolist() == tau.tolist()


def test_torque_and_rate_are_the_closest_within_the_limits(robot: Robot, arm: Arm) -> None:
    active = ActiveController(Fixed(1e4 * np.ones(arm.n)), arm, dt=DT)
    last = home_torque(arm)
    for _ in range(400):
        tau = ask(active, arm)
        assert tau == pytest.approx(np.minimum(last + robot.tau_rate_max * DT, robot.tau_max))
        last = tau
    assert last.tolist() == robot.tau_max.tolist()
    active.switch(Fixed(-1e4 * np.ones(arm.n)), seconds=0.0)
    assert ask(active, arm) == pytest.approx(robot.tau_max - robot.tau_rate_max * DT)
    assert active.commanded.tolist() == [-1e4] * arm.n
    for _ in range(800):
        last = ask(active, arm)
    assert last.tolist() == (-robot.tau_max).tolist()


@member
def test_at_the_motors_no_limit_is_passed(robot: Robot, controller: Controller) -> None:
    """With pushes, an unknown payload and late commands; and the motors hold back nothing."""
    arm = Arm(robot)
    pushes = [Push(force=50 * d, start=s) for d, s in ((np.eye(3)[0], 0.1), (-np.eye(3)[2], 0.4))]
    sim = DisturbedSimulation(
        robot, no_objects, Disturbance(pushes=pushes, payload=LOAD, link_mass_factor=1.2)
    )
    active, last = ActiveController(controller, arm, dt=DT), sim.motor_torque()
    # Its first command follows on the torque that the motors hold.
    active.switch(controller, seconds=0.0)
    goal = arm.home + 0.3
    way = plan_ptp(arm.home, goal, robot.profile, DT)
    for q, v, a in zip(way.q, way.v, way.a, strict=True):
        tau = active.torque(JointReference(q, v, a), sim.state())
        sim.step(tau)
        motor = sim.last_torque()
        assert (np.abs(motor) <= robot.tau_max).all()
        assert (np.abs(motor - last) <= robot.tau_rate_max * DT * (1 + 1e-9)).all()
        last = motor
    # An unknown payload bends compliant arms by up to 0.19 rad; one that stays is 0.3 rad away.
    assert (np.abs(sim.state().q - goal) < 0.25).all()


@each_backend
@pytest.mark.parametrize("new", [JointImpedance(stiffness_scale=0.1), *MEMBERS[1:]])
def test_a_switch_has_no_bump_and_ends_with_the_new_controller(
    arm: Arm, new: Controller, backend: str
) -> None:
    with using(backend):
        active = ActiveController(JointImpedance(), arm, dt=DT)
    reference = at_rest(arm.home)
    state = JointState(arm.home + 0.01, np.full(arm.n, 0.02))
    old = JointImpedance().torque(arm, reference, state)
    final = new.torque(arm, reference, state)
    assert np.abs(final - old).max() > 0.05
    active.torque(reference, state)
    with using(backend):
        active.switch(new, seconds=0.05)
    path = []
    for _ in range(60):
        active.torque(reference, state)
        path.append(active.commanded)
    assert path[0] == pytest.approx(old, abs=1e-12)
    assert_same(backend, path[-1], final)
    # As 3x² - 2x³: level at both ends, and half as steep again as the mean slope in the middle.
    steps, mean = np.diff(path, axis=0), (final - old) / 50
    assert (np.abs(steps) <= 1.5 * np.abs(mean) + 1e-9).all()
    assert steps[24:26] == pytest.approx(np.tile(1.5 * mean, (2, 1)), rel=1e-2, abs=1e-9)
    for end in (steps[0], steps[49]):
        assert (np.abs(end) <= 0.1 * np.abs(mean) + 1e-9).all()
    assert path[25] == pytest.approx((old + final) / 2, abs=1e-9)


def test_a_switch_during_a_switch_has_no_bump_either(arm: Arm) -> None:
    reference, still = at_rest(arm.home), np.zeros(arm.n)
    state = JointState(arm.home + 0.01, still)
    active = ActiveController(JointImpedance(), arm, dt=DT)
    path = []
    for k in range(200):
        if k in (20, 40):
            active.switch(JointImpedance(stiffness_scale=0.5 if k == 20 else 2.0), seconds=0.05)
        if k == 60:
            active.set_arm(arm.with_payload(LOAD), seconds=0.05)
        active.torque(reference, state)
        path.append(active.commanded)
    jump = np.abs(np.diff(path, axis=0)).max()
    spring = np.abs(JointImpedance().torque(arm, reference, state) - home_torque(arm)).max()
    assert jump < 0.15 * spring + 1.0
    belief = arm.with_payload(LOAD)
    last = JointImpedance(stiffness_scale=2.0).torque(belief, reference, state)
    assert path[-1].tolist() == last.tolist()


def test_in_no_time_the_change_is_at_once(arm: Arm) -> None:
    active = ActiveController(JointImpedance(), arm, dt=DT)
    ask(active, arm)
    active.set_arm(arm.with_payload(LOAD), seconds=0.0)
    ask(active, arm)
    assert active.commanded == pytest.approx(home_torque(arm.with_payload(LOAD)), abs=1e-12)


def test_an_updated_payload_takes_the_error_away(robot: Robot, arm: Arm) -> None:
    sim = DisturbedSimulation(robot, no_objects, Disturbance(payload=LOAD))
    active, errors = ActiveController(JointImpedance(), arm, dt=DT), {}
    for phase, belief in (("unknown", arm), ("known", arm.with_payload(LOAD))):
        active.set_arm(belief)
        for _ in range(2500):
            sim.step(ask_state(active, arm, sim))
        errors[phase] = np.abs(sim.state().q - arm.home)
    stuck = 1.05 * arm.dry_friction / robot.stiffness
    assert (errors["known"] < 0.1 * errors["unknown"].max() + stuck).all()


def ask_state(active: ActiveController, arm: Arm, sim: Simulation) -> Vector:
    return active.torque(at_rest(arm.home), sim.state())


def test_a_torque_that_is_no_number_is_not_hidden(robot: Robot, arm: Arm) -> None:
    active = ActiveController(Fixed(np.full(arm.n, np.nan)), arm, dt=DT)
    with pytest.raises(InvalidValueError, match="commanded torque must be finite"):
        Simulation(robot, no_objects).step(ask(active, arm))


def test_what_it_cannot_do_is_refused(arm: Arm, robot: Robot) -> None:
    active = ActiveController(JointImpedance(), arm, dt=DT)
    for bad in (-0.1, np.nan, np.inf):
        with pytest.raises(InvalidValueError, match="seconds must be finite and not negative"):
            active.switch(JointImpedance(), seconds=bad)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_stops_push_away_from_the_limits_with_a_potential(
    robot: Robot, arm: Arm, side: float
) -> None:
    stops, zero = JointStops(margin=0.05, strength=0.5), np.zeros(arm.n)
    width = 0.05 * (arm.q_max - arm.q_min)
    limit = arm.q_max if side > 0 else arm.q_min
    for depth, share in ((0.0, 0.0), (0.5, 0.25), (1.0, 1.0), (-0.2, 0.0)):
        tau = zero.copy()
        stops.push(tau, arm, arm.home, limit - side * (1.0 - depth) * width)
        assert tau == pytest.approx(-side * 0.5 * share * robot.tau_max, abs=1e-9)


def test_a_reference_near_a_limit_is_followed_for_nothing(arm: Arm) -> None:
    stops, tau = JointStops(), np.zeros(arm.n)
    near = arm.q_max - 0.2 * 0.03 * (arm.q_max - arm.q_min)
    stops.push(tau, arm, near, near)
    assert not tau.any()
    stops.push(tau, arm, near, near + 0.1 * 0.03 * (arm.q_max - arm.q_min))
    assert tau == pytest.approx(-0.01 * arm.robot.tau_max)
    tau[:] = 0.0
    stops.push(tau, arm, near, near - 0.1 * 0.03 * (arm.q_max - arm.q_min))
    assert not tau.any()


def test_stops_keep_a_limp_arm_off_its_limits(robot: Robot, arm: Arm) -> None:
    """A hand drags each joint outwards; without stops it arrives."""
    reached = {}
    for strength in (0.0, 1.0):
        q, v = arm.home.copy(), np.zeros(arm.n)
        stops, M = JointStops(strength=strength), np.diag(arm.mass_matrix(arm.home))
        for _ in range(6000):
            tau = 0.3 * robot.tau_max - 2.0 * np.sqrt(robot.tau_max * M) * v
            stops.push(tau, arm, arm.home, q)
            v = v + DT * tau / M
            q = q + DT * v
        reached[strength] = q
    assert (reached[1.0] < arm.q_max).all()
    assert (reached[0.0] > arm.q_max).any()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"margin": 0.0}, "margin must be above 0 and below 0.5"),
        ({"margin": 0.5}, "margin must be above 0 and below 0.5"),
        ({"strength": -1.0}, "strength must be 0 or more and finite"),
    ],
)
def test_other_stops_are_refused(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        JointStops(**setting)


def test_each_term_of_the_feed_forward_adds_its_own(arm: Arm, rng: np.random.Generator) -> None:
    q, v = arm.home + 0.1, rng.uniform(-1, 1, arm.n)
    a, still = rng.uniform(-1, 1, arm.n), np.zeros(arm.n)
    tau = {
        terms: JointImpedance(feed_forward=terms).torque(
            arm, JointReference(q, v, a), JointState(q, v)
        )
        for terms in FeedForward
    }
    friction = 0.8 * arm.dry_friction * np.tanh(v / 0.05)
    assert not tau[FeedForward.NONE].any()
    assert tau[FeedForward.GRAVITY] == pytest.approx(arm.inverse_dynamics(q, still, still))
    moving = arm.inverse_dynamics(q, v, still) + friction
    assert tau[FeedForward.CORIOLIS] == pytest.approx(moving)
    pushed = tau[FeedForward.FULL] - tau[FeedForward.CORIOLIS]
    assert pushed == pytest.approx(arm.mass_matrix(q) @ a, abs=1e-9)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_each_limit_is_kept_on_its_own(robot: Robot, arm: Arm, side: float) -> None:
    step = robot.tau_rate_max * DT
    still = JointState(arm.home, np.zeros(arm.n))
    fixed = Fixed(home_torque(arm) + 1.5 * side * step)
    active = ActiveController(fixed, arm, dt=DT)
    first = active.torque(at_rest(arm.home), still)
    assert first == pytest.approx(home_torque(arm) + side * step)
    fixed.tau = side * robot.tau_max
    for _ in range(600):
        active.torque(at_rest(arm.home), still)
    fixed.tau = side * (robot.tau_max + 0.3 * step)
    tau = active.torque(at_rest(arm.home), still)
    assert tau.tolist() == (side * robot.tau_max).tolist()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_close_to_a_limit_the_stops_push(robot: Robot, arm: Arm, side: float) -> None:
    active = ActiveController(Fixed(home_torque(arm)), arm, dt=DT)
    limit, width = (arm.q_max if side > 0 else arm.q_min), 0.03 * (arm.q_max - arm.q_min)
    q = limit - side * 0.9 * width
    tau = active.torque(at_rest(arm.home), JointState(q, np.zeros(arm.n)))
    assert active.commanded == pytest.approx(home_torque(arm) - side * 0.01 * robot.tau_max)
    assert (side * (tau - home_torque(arm)) < 0.0).all()


def test_a_change_at_once_forgets_one_that_was_under_way(arm: Arm) -> None:
    active = ActiveController(JointImpedance(), arm, dt=DT)
    reference, state = at_rest(arm.home), JointState(arm.home + 0.01, np.zeros(arm.n))
    middle = JointImpedance(stiffness_scale=0.5)
    active.switch(JointImpedance(stiffness_scale=3.0), seconds=0.05)
    active.switch(middle, seconds=0.0)
    active.torque(reference, state)
    expected = middle.torque(arm, reference, state)
    assert active.commanded.tolist() == expected.tolist()
    active.switch(JointImpedance(stiffness_scale=2.0), seconds=0.05)
    active.torque(reference, state)
    assert active.commanded == pytest.approx(expected, abs=1e-12)


def test_a_reference_near_the_lower_limit_is_followed_for_nothing_too(arm: Arm) -> None:
    stops, tau = JointStops(), np.zeros(arm.n)
    near = arm.q_min + 0.2 * 0.03 * (arm.q_max - arm.q_min)
    stops.push(tau, arm, near, near)
    assert not tau.any()
    stops.push(tau, arm, near, near - 0.1 * 0.03 * (arm.q_max - arm.q_min))
    assert tau == pytest.approx(0.01 * arm.robot.tau_max)


@pytest.mark.parametrize("observer", [None, DisturbanceObserver(noise_q=0.0)], ids=["no", "with"])
def test_joints_do_not_run_ahead_of_a_reference_that_accelerates(
    observer: DisturbanceObserver | None,
) -> None:
    """By T ζ a / ω they would: 0.25 mrad at 7.5 rad/s²."""
    arm, sim = Arm(PANDA), Simulation(PANDA, no_objects)
    active = ActiveController(ComputedTorque(), arm, dt=DT, observer=observer)
    profile = MotionProfile.uniform(arm.n, v=2.0, a=7.5, j=150.0)
    way = plan_ptp(arm.home, arm.home + 0.3, profile, DT)
    worst = 0.0
    for sample in zip(way.q, way.v, way.a, strict=True):
        worst = max(worst, float(np.abs(sim.true_state().q - sample[0]).max()))
        sim.step(active.torque(JointReference(*sample), sim.state()))
    assert np.abs(way.a).max() == pytest.approx(7.5, rel=1e-3)
    assert worst < 0.1e-3


def test_two_switches_at_once_start_from_what_was_commanded_before_both(arm: Arm) -> None:
    active = ActiveController(Fixed(home_torque(arm) + 0.1), arm, dt=DT)
    ask(active, arm)
    active.switch(Fixed(home_torque(arm) + 7.0))
    active.switch(Fixed(home_torque(arm) - 3.0))
    ask(active, arm)
    assert active.commanded == pytest.approx(home_torque(arm) + 0.1, abs=1e-9)
