"""The compiled control period and loop, held to the numpy path."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
import pytest

from robo47_qp._core.library import functions, pointer, using
from robo47_qp._core.mujoco_functions import dynamics
from robo47_qp.arrays import Matrix
from robo47_qp.control.active import ActiveController
from robo47_qp.control.cartesian_impedance import CartesianImpedance
from robo47_qp.control.closed_chain import ClosedChain
from robo47_qp.control.compiled import law_of
from robo47_qp.control.computed_torque import ComputedTorque
from robo47_qp.control.controller import Controller
from robo47_qp.control.friction import FrictionLearning, LearnedFriction
from robo47_qp.control.joint_impedance import FeedForward, JointImpedance
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.control.operational_space import OperationalSpace
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.run.control_loop import Aborted, ControlLoop
from robo47_qp.run.scenario import Run
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import CONTROLLERS, ClassicalStack
from tests.controlled import DT, LOAD, at_rest
from tests.robots import GRIPPER
from tests.runs import Reach, carry_out, no_objects

JOINT_LAWS = (
    ComputedTorque(),
    # With springs in every joint that is light enough.
    ComputedTorque(frequency=5.0, stiffness_share=1.0),
    JointImpedance(),
)
TOOL_LAWS = (CartesianImpedance(), CartesianImpedance(frame="tool", error_max=np.full(6, 1e-3)))
LAWS = (*JOINT_LAWS, *TOOL_LAWS)
law = pytest.mark.parametrize("controller", LAWS, ids=lambda c: type(c).__name__)
both = pytest.mark.parametrize("observer", [None, DisturbanceObserver()])


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """What a controller is asked, period by period."""

    references: tuple[Matrix, Matrix, Matrix]
    states: tuple[Matrix, Matrix]


def inputs(periods: int, seed: int, noise: float = 0.0) -> Inputs:
    """A motion with reversals, stops and a joint at its limit, followed with errors."""
    rng, arm = np.random.default_rng(seed), Arm(PANDA)
    t = np.arange(periods)[:, None] * DT
    w, size = rng.uniform(0.5, 6.0, arm.n), rng.uniform(0.0, 0.5, arm.n)
    size[3] = 1.2
    q = arm.home + size * np.sin(w * t)
    v, a = size * w * np.cos(w * t), -size * w**2 * np.sin(w * t)
    # One that stops in the middle of its turn, while others move.
    q[:, 5] = arm.home[5] + np.minimum(1e-3 * t[:, 0], 5e-5)
    v[:, 5] = np.where(t[:, 0] < 0.05, 1e-3, 0.0)
    a[:, 5] = 0.0
    still = (t[:, 0] > 1.0) & (t[:, 0] < 1.2)
    q[still], v[still], a[still] = q[still][:1], 0.0, 0.0
    off = 2e-3 * np.sin(13.0 * t + np.arange(arm.n)) + noise * rng.standard_normal(q.shape)
    return Inputs(references=(q, v, a), states=(q + off, v + 1e-2 * off))


def closed(active: ActiveController, seed: int) -> None:
    """Tell the observer, if there is one, of a chain that leaves two thirds of the joints free."""
    n = active.arm.n
    A = np.random.default_rng(seed).normal(size=(n // 3, n))
    along = np.eye(n) - np.linalg.pinv(A) @ A
    if active.observed is not None:
        chain = ClosedChain(along=along, shares=0.9 * along + 0.1 * np.eye(n))
        active.observed.close(chain)


def asked(
    controller: Controller, observer: DisturbanceObserver | None, given: Inputs, backend: str
) -> Matrix:
    """What a controller answers and estimates in every period, with all that may happen to it."""
    with using(backend):
        arm = Arm(PANDA)
        active = ActiveController(controller, arm, dt=DT, observer=observer)
        happens: dict[int, Callable[[], None]] = {
            200: partial(active.set_arm, arm.with_payload(LOAD), seconds=0.02),
            300: partial(active.compensate, on=False),
            340: partial(closed, active, seed=1),
            400: partial(closed, active, seed=2),
            450: partial(active.compensate, on=True),
            500: partial(active.compensate, on=False),
            520: partial(active.compensate, on=True),
            700: partial(active.switch, JointImpedance(stiffness_scale=0.5)),
            750: partial(active.switch, controller, seconds=0.03),
            770: partial(active.switch, controller, seconds=0.0),
        }
        answers = []
        for k, (q_ref, v_ref, a_ref, q, v) in enumerate(
            zip(*given.references, *given.states, strict=True)
        ):
            if k in happens:
                happens[k]()
            tau = active.torque(JointReference(q_ref, v_ref, a_ref), JointState(q, v))
            seen = active.observed
            estimates = [] if seen is None else [seen.disturbance, seen.compensation, seen.friction]
            answers.append(np.concatenate([tau, active.commanded, *estimates]))
        assert (active.compiled is not None) == (backend == "compiled")
    return np.array(answers)


@pytest.mark.parametrize("controller", JOINT_LAWS, ids=lambda c: type(c).__name__)
def test_without_an_observer_torques_are_those_of_numpy_to_the_bit(controller: Controller) -> None:
    given = inputs(1300, seed=1)
    expected = asked(controller, None, given, "numpy")
    got = asked(controller, None, given, "compiled")
    np.testing.assert_array_equal(got, expected)
    assert (expected[:, :7] != expected[:, 7:]).any()  # limits were met


@pytest.mark.parametrize("controller", TOOL_LAWS, ids=lambda c: c.frame)
def test_torques_at_the_tool_are_those_of_numpy(controller: CartesianImpedance) -> None:
    """Products of small matrices are sums in another order."""
    given = inputs(1300, seed=1)
    expected = asked(controller, None, given, "numpy")
    got = asked(controller, None, given, "compiled")
    size = np.abs(expected).max(axis=0)
    np.testing.assert_array_less(np.abs(got - expected).max(axis=0) / size, 1e-12)
    assert (expected[:, :7] != expected[:, 7:]).any()  # limits were met


@law
@pytest.mark.parametrize(
    "observer",
    [
        DisturbanceObserver(),
        DisturbanceObserver(noise_q=1e-5, state_delay=1),
        DisturbanceObserver(noise_q=1e-5, command_delay=3),
        DisturbanceObserver(noise_q=5e-5, state_delay=1, command_delay=1, jitter=1e-4),
    ],
    ids=["exact", "state late", "command late", "all"],
)
def test_with_an_observer_they_are_those_of_numpy(
    controller: Controller, observer: DisturbanceObserver
) -> None:
    """Estimates are sums of five numbers in another order, which the observer's gains amplify."""
    given = inputs(1300, seed=2, noise=observer.noise_q or 0.0)
    expected = asked(controller, observer, given, "numpy")
    got = asked(controller, observer, given, "compiled")
    np.testing.assert_allclose(got[:1], expected[:1], rtol=0.0, atol=1e-12)
    size = np.abs(expected).max(axis=0) + 1.0
    np.testing.assert_array_less(np.abs(got - expected).max(axis=0) / size, 2e-11)


@law
@both
def test_they_repeat_to_the_bit(
    controller: Controller, observer: DisturbanceObserver | None
) -> None:
    given = inputs(800, seed=3)
    first = asked(controller, observer, given, "compiled")
    np.testing.assert_array_equal(asked(controller, observer, given, "compiled"), first)


@law
@both
def test_one_period_from_any_state_is_that_of_numpy(
    controller: Controller, observer: DisturbanceObserver | None
) -> None:
    """1000 states, set anew each time: none has a history in which differences could grow."""
    rng, arm = np.random.default_rng(4), Arm(PANDA)
    pair = []
    for backend in ("numpy", "compiled"):
        with using(backend):
            pair.append(ActiveController(controller, arm, dt=DT, observer=observer))
            pair[-1].torque(at_rest(arm.home), JointState(arm.home, np.zeros(arm.n)))
    for _ in range(1000):
        q, v = rng.uniform(arm.q_min, arm.q_max), rng.uniform(-1.0, 1.0, arm.n)
        measured, d, expected = q + 1e-4 * rng.standard_normal(7), *rng.normal(0.0, 2.0, (2, arm.n))
        away = rng.choice([1e-3, 1.0]) * rng.standard_normal(7)  # beyond half a turn, too
        reference = JointReference(q + away, v, rng.uniform(-5.0, 5.0, 7))
        answers = []
        for active in pair:
            if active.observed is not None:
                active.observed._now.whole[:] = np.concatenate([q, v, d, expected, measured])
            active.torque(reference, JointState(measured, v))
            seen = active.observed
            estimates = [] if seen is None else [seen.disturbance, seen.compensation]
            answers.append(np.concatenate([active.commanded, *estimates]))
        off = np.abs(answers[1] - answers[0]).max()
        assert off <= 1e-12 * np.abs(answers[0]).max()


def learned(backend: str) -> Matrix:
    """What is learned, and how reversals turn, in a motion with reversals, another load, a rest."""
    rng = np.random.default_rng(5)
    with using(backend):
        arm = Arm(PANDA)
        friction = LearnedFriction(FrictionLearning(), arm, DT)
        loaded, answers = arm.with_payload(LOAD), []
        for k in range(1500):
            if k == 700:
                arm = loaded
            moving = k - min(max(k - 900, 0), 300)
            q = arm.home + 0.2 * np.sin(moving * 0.01 * np.arange(7))
            arm.inverse_dynamics(q, np.zeros(7), np.zeros(7))
            if k == 1100:
                friction.jump(q - 0.01)
            held = rng.normal(0.1, 0.3, 7) if k % 2 else None
            change = friction.change(arm, q, held)
            turn = np.zeros(7) if change is None else change.copy()
            friction.learn(arm, rng.normal(0.3, 1.0, 7))
            answers.append(np.concatenate([turn, friction.friction]))
    return np.array(answers)


def test_friction_is_learned_as_by_numpy_to_the_bit() -> None:
    expected = learned("numpy")
    assert (expected != 0.0).any(axis=0).sum() >= 12  # the first joint rests
    np.testing.assert_array_equal(learned("compiled"), expected)


def test_what_the_core_does_not_know_stays_in_python() -> None:
    arm = Arm(PANDA)
    with using("compiled"):
        for controller in (OperationalSpace(), JointImpedance(feed_forward=FeedForward.GRAVITY)):
            assert law_of(controller, arm) is None
            assert ActiveController(controller, arm, dt=DT).compiled is None
        assert law_of(JointImpedance(), arm) is not None
    with using("numpy"):
        assert law_of(JointImpedance(), arm) is None


def ran(
    task: Reach,
    backend: str,
    observer: DisturbanceObserver | None,
    controller: str = ClassicalStack.controller,
) -> Run:
    with using(backend):
        return carry_out(task, observer=observer, controller=controller)


@pytest.mark.parametrize("rise", [0.02, -0.6])
@pytest.mark.parametrize("name", ["computed_torque", "joint_impedance"])
def test_runs_without_an_observer_are_those_of_numpy_to_the_bit(rise: float, name: str) -> None:
    """Up in free space, and down until the hand hits the table and the run is stopped."""
    one, other = (ran(Reach(rise=rise), backend, None, name) for backend in ("numpy", "compiled"))
    assert type(one.scenario.controller) is type(CONTROLLERS[name]())
    assert (one.failure is None) == (rise > 0.0)
    np.testing.assert_array_equal(other.rows.values, one.rows.values)
    touched = one.rows["contact/fixed"][:, 0] > 0.0
    assert touched.any() == (rise < 0.0)


def test_a_run_with_the_observer_is_that_of_numpy() -> None:
    observer = DisturbanceObserver()
    one, other = (ran(Reach(), backend, observer) for backend in ("numpy", "compiled"))
    np.testing.assert_allclose(other.rows.values, one.rows.values, rtol=0.0, atol=1e-7)
    positions = np.array([run.rows["joints/q"] for run in (one, other)])
    assert np.abs(np.diff(positions, axis=0)).max() < 1e-11


def block_between_the_fingers(spec: mujoco.MjSpec) -> None:
    body = spec.worldbody.add_body(name="block", gravcomp=1.0)
    body.pos = Arm(PANDA).pose(PANDA.home).translation()
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02] * 3, mass=0.1)


def test_fingers_let_go_gradually_with_both_backends() -> None:
    rows = []
    for backend in ("numpy", "compiled"):
        with using(backend):
            sim = Simulation(PANDA, block_between_the_fingers)
            loop = ControlLoop(Arm(PANDA), JointImpedance(), sim)
            for width, seconds in ((0.0, 0.6), (0.08, 0.6), (0.02, 0.1)):
                sim.command_grip(Grip(width=width, force=30.0))
                loop.begin("grip")
                loop.hold(seconds)
            rows.append(loop.recording.rows())
    np.testing.assert_array_equal(rows[1].values, rows[0].values)
    force = np.linalg.norm(rows[0]["gripper/left_finger_contact"], axis=1)[599:]
    assert force[0] == pytest.approx(30.0, rel=0.01)
    # Half a newton in a period, and then the fingers are off at their full speed.
    assert 0.3 < -np.diff(force[5:50]).min() < 0.8
    assert force[55] > 0.0
    assert not force[75:].any()
    opening = np.diff(rows[0]["gripper/width_command"][:, 0])[680:700]
    assert opening == pytest.approx(GRIPPER.speed_max * DT)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_a_torque_that_is_no_number_is_refused_and_moves_nothing(backend: str) -> None:
    with using(backend):
        sim = Simulation(PANDA, no_objects)
        loop = ControlLoop(Arm(PANDA), JointImpedance(), sim)
    a = np.zeros((31, 7))
    a[13] = np.nan
    home = np.tile(PANDA.home, (31, 1))
    with pytest.raises(Aborted, match="cannot be controlled: commanded torque must be finite"):
        loop.track(Trajectory(q=home, v=np.zeros((31, 7)), a=a, dt=DT))
    assert len(loop.recording) == 13
    assert sim.time == pytest.approx(13 * DT)


def test_inverse_dynamics_by_parts_are_those_of_mujoco_to_the_bit(
    arm: Arm, rng: np.random.Generator
) -> None:
    data = mujoco.MjData(arm.model)
    core, y = dynamics(arm.model, data), rng.normal(size=(1, arm.n))
    for q in rng.uniform(arm.q_low, arm.q_high, (50, arm.n)):
        v, a = rng.normal(size=(2, arm.n))
        tau = arm.inverse_dynamics(q, v, a)
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        functions().r47_inverse(core.pointer)
        np.testing.assert_array_equal(data.qfrc_inverse, tau)
        expected, found = np.zeros((2, 1, arm.n))
        mujoco.mj_solveM(arm.model, arm.scratch, expected, y)
        functions().r47_solve(core.pointer, pointer(found), pointer(y), 1)
        np.testing.assert_array_equal(found, expected)
