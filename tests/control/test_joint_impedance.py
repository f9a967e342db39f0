import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.control.controller import Controller
from robo47_qp.control.joint_impedance import JointImpedance
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Robot
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.trajectory import Trajectory
from tests.examples import fractions, rates
from tests.plain_arm import PlainArm

DT = 1e-3
CONTROLLER: Controller = JointImpedance()
BRICK = Payload(
    mass=2.0,
    inertia=(4e-3, 5e-3, 6e-3),
    T_tcp_com=SE3.from_translation(np.array([0.02, 0.0, 0.05])),
)


def at_rest(q: Vector) -> JointReference:
    return JointReference(q, np.zeros(len(q)), np.zeros(len(q)))


class World:
    """The welded arm in MuJoCo, driven by torques: no code of the package."""

    def __init__(self, plain: PlainArm, q: Vector) -> None:
        self._m = plain.welded
        self._d = mujoco.MjData(self._m)
        self._d.qpos[:] = q

    def state(self) -> JointState:
        return JointState(self._d.qpos.copy(), self._d.qvel.copy())

    def step(self, tau: Vector) -> None:
        self._d.qfrc_applied[:] = tau
        mujoco.mj_step(self._m, self._d)


def tracking_errors(plain: PlainArm, arm: Arm, trajectory: Trajectory, ahead: int) -> Vector:
    """Joint errors at every instant, with the reference taken so many periods later."""
    world = World(plain, trajectory.q[0])
    errors = []
    for k in range(trajectory.steps):
        state = world.state()
        errors.append(np.abs(trajectory.q[k] - state.q).max())
        i = min(k + ahead, trajectory.steps)
        reference = JointReference(trajectory.q[i], trajectory.v[i], trajectory.a[i])
        world.step(CONTROLLER.torque(arm, reference, state))
    return np.array(errors)


@given(at=fractions, v=rates, a=rates)
def test_without_error_the_arm_does_what_the_reference_does(
    arm: Arm, plain: PlainArm, at: Vector, v: Vector, a: Vector
) -> None:
    q, v, a = plain.at(at), v[: plain.n], a[: plain.n]
    tau = CONTROLLER.torque(arm, JointReference(q, v, a), JointState(q, v))
    assert tau.shape == (arm.n,)
    assert np.abs(plain.acceleration(q, v, tau) - a).max() < 1e-8


@pytest.mark.parametrize("scale", [0.0, 0.5, 2.0])
@given(at=fractions, error=rates)
def test_the_spring_is_that_of_the_robot_and_pulls_towards_the_reference(
    robot: Robot, arm: Arm, plain: PlainArm, scale: float, at: Vector, error: Vector
) -> None:
    q, error = plain.at(at), 0.1 * error[: plain.n]
    controller = JointImpedance(stiffness_scale=scale)
    still = JointState(q, np.zeros(arm.n))
    spring = controller.torque(arm, at_rest(q + error), still) - controller.torque(
        arm, at_rest(q), still
    )
    assert spring == pytest.approx(scale * robot.stiffness * error, abs=1e-9)


@pytest.mark.parametrize("scale", [1.0, 4.0])
@pytest.mark.parametrize("ratio", [0.0, 0.7, 1.0])
def test_the_damper_has_the_asked_ratio_at_home(
    robot: Robot, arm: Arm, plain: PlainArm, scale: float, ratio: float
) -> None:
    """A joint alone: M x'' + D x' + K x = 0 decays with the damping ratio D / (2 √(K M))."""
    controller = JointImpedance(stiffness_scale=scale, damping_ratio=ratio)
    M = plain.mass_matrix(arm.home)
    q, still = arm.home + 0.3, np.zeros(arm.n)
    for i, e in enumerate(np.eye(arm.n)):
        faster = JointReference(q, e, still)
        tau = controller.torque(arm, faster, JointState(q, still)) - controller.torque(
            arm, at_rest(q), JointState(q, still)
        )
        damping = 2 * ratio * np.sqrt(scale * robot.stiffness[i] * M[i, i])
        assert tau == pytest.approx(damping * e, rel=1e-6, abs=1e-6)


@given(at=fractions, v=rates)
def test_spring_and_damper_only_take_energy_from_a_motion_past_the_reference(
    arm: Arm, plain: PlainArm, at: Vector, v: Vector
) -> None:
    q, v, still = plain.at(at), v[: plain.n], np.zeros(plain.n)
    tau = CONTROLLER.torque(arm, JointReference(q, still, still), JointState(q, v))
    carried = CONTROLLER.torque(arm, JointReference(q, v, still), JointState(q, v))
    assert (tau - carried) @ v <= 0.0


@pytest.mark.parametrize("scale", [0.25, 1.0, 2.0])
def test_a_displaced_arm_comes_back_without_ringing(
    arm: Arm, plain: PlainArm, scale: float
) -> None:
    controller = JointImpedance(stiffness_scale=scale)
    world = World(plain, arm.home + 0.02)
    path = []
    for _ in range(1500):
        state = world.state()
        path.append(state.q - arm.home)
        world.step(controller.torque(arm, at_rest(arm.home), state))
    assert np.abs(path[-1]).max() < 1e-4
    # Joints pull on one another through the mass matrix: some of it goes past.
    assert np.min(path) > -0.012


def test_at_rest_it_holds_the_arm_up(arm: Arm, plain: PlainArm) -> None:
    for q in (arm.home, plain.at(np.full(8, 0.3))):
        world = World(plain, q)
        for _ in range(500):
            world.step(CONTROLLER.torque(arm, at_rest(q), world.state()))
        assert np.abs(world.state().q - q).max() < 1e-9


def test_a_payload_that_it_knows_is_held_and_one_that_it_does_not_sags(
    robot: Robot, arm: Arm
) -> None:
    plain = PlainArm(robot, BRICK)
    sag = {}
    for known in (True, False):
        belief = arm.with_payload(BRICK) if known else arm
        world = World(plain, arm.home)
        for _ in range(2000):
            world.step(CONTROLLER.torque(belief, at_rest(arm.home), world.state()))
        sag[known] = np.abs(world.state().q - arm.home)
    assert sag[True].max() < 1e-9
    still = np.zeros(arm.n)
    missing = arm.with_payload(BRICK).inverse_dynamics(
        arm.home, still, still
    ) - arm.inverse_dynamics(arm.home, still, still)
    assert sag[False] == pytest.approx(np.abs(missing) / robot.stiffness, rel=0.1, abs=1e-3)
    assert sag[False].max() > 5e-3


@pytest.mark.parametrize("payload", [None, BRICK], ids=["empty", "carrying"])
def test_a_ptp_motion_is_tracked_closely_only_with_the_reference_of_the_same_instant(
    robot: Robot, payload: Payload | None
) -> None:
    plain, arm = PlainArm(robot, payload), Arm(robot, payload)
    q_goal = arm.home + np.array([1.0, 0.6, -0.5, 0.7, -0.8, 0.4, -1.0])[: arm.n]
    trajectory = plan_ptp(arm.home, q_goal, robot.profile, DT)
    same = tracking_errors(plain, arm, trajectory, ahead=0).max()
    later = tracking_errors(plain, arm, trajectory, ahead=1).max()
    assert same < 3e-4
    assert later > 5 * same


def test_the_same_question_has_the_same_answer(robot: Robot, arm: Arm) -> None:
    state = JointState(arm.home + 0.1, 0.3 * arm.home)
    reference = JointReference(arm.home, 0.1 * arm.home, -arm.home)
    first = CONTROLLER.torque(arm, reference, state)
    kept = first.copy()
    other = JointImpedance(stiffness_scale=3.0)
    other.torque(arm, at_rest(arm.home), state)
    CONTROLLER.torque(arm.with_payload(BRICK), reference, state)
    first[:] = 7.0
    for belief in (arm, Arm(robot)):
        assert CONTROLLER.torque(belief, reference, state).tolist() == kept.tolist()


def test_reference_and_state_are_left_alone(arm: Arm) -> None:
    state = JointState(arm.home + 0.1, 0.3 * arm.home)
    reference = JointReference(arm.home.copy(), 0.1 * arm.home, -arm.home)
    kept = [part.copy() for part in (*state, *reference)]
    CONTROLLER.torque(arm, reference, state)[:] = 7.0
    for part, before in zip((*state, *reference), kept, strict=True):
        assert part.tolist() == before.tolist()


@given(scale=st.floats(0.0, 1e3), ratio=st.floats(0.0, 1e2))
def test_gains_may_be_zero_or_positive(scale: float, ratio: float) -> None:
    controller = JointImpedance(stiffness_scale=scale, damping_ratio=ratio)
    assert (controller.stiffness_scale, controller.damping_ratio) == (scale, ratio)


@pytest.mark.parametrize("name", ["stiffness_scale", "damping_ratio"])
@pytest.mark.parametrize("bad", [-1e-9, -1.0, np.nan, np.inf])
def test_another_gain_is_refused(name: str, bad: float) -> None:
    with pytest.raises(InvalidValueError, match=rf"{name} must be 0 or more and finite; found"):
        JointImpedance(**{name: bad})  # type: ignore[arg-type]
