import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Vector
from robo47_qp.control.cartesian_impedance import CartesianImpedance
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.model.robot import Robot
from tests.controlled import World, at_rest, controlled, self_motion, tool_offset
from tests.plain_arm import PlainArm

STIFFNESS = np.array([600.0, 900.0, 1200.0, 30.0, 40.0, 50.0])


def patience(plain: PlainArm) -> float:
    """How long an arm takes to come to rest, the longer the more its joints are damped [s]."""
    return 2.0 + 0.6 * float(plain.damping.max())


@pytest.mark.parametrize("frame", ["world", "tool"])
def test_a_push_deflects_the_tool_by_force_over_stiffness_on_each_axis(
    arm: Arm, plain: PlainArm, frame: str
) -> None:
    controller = CartesianImpedance(stiffness=STIFFNESS, frame=frame)  # type: ignore[arg-type]
    home = arm.pose(arm.home)
    axes = np.eye(3) if frame == "world" else home.rotation().as_matrix()
    for i in range(3):
        world = World(plain, arm.home)
        end = controlled(
            world, controller, arm, arm.home, patience(plain), push=(10 * axes[:, i], None)
        )
        moved = axes.T @ tool_offset(plain, end.q, home)
        expected = np.zeros(3)
        expected[i] = 10.0 / STIFFNESS[i]
        assert moved == pytest.approx(expected, abs=0.02 * expected[i])
        assert np.abs(end.v).max() < 5e-3


@pytest.mark.parametrize("frame", ["world", "tool"])
def test_a_torque_turns_the_tool_by_torque_over_stiffness(
    arm: Arm, plain: PlainArm, frame: str
) -> None:
    controller = CartesianImpedance(stiffness=STIFFNESS, frame=frame)  # type: ignore[arg-type]
    R_home = arm.pose(arm.home).rotation().as_matrix()
    axes = np.eye(3) if frame == "world" else R_home
    world = World(plain, arm.home)
    end = controlled(
        world, controller, arm, arm.home, patience(plain), push=(None, 0.6 * axes[:, 1])
    )
    turned = axes.T @ Rotation.from_matrix(plain.tool(end.q)[1] @ R_home.T).as_rotvec()
    assert turned == pytest.approx([0.0, 0.6 / STIFFNESS[4], 0.0], abs=0.02 * 0.6 / STIFFNESS[4])


def test_the_elbow_moves_without_the_tool(robot: Robot, arm: Arm, plain: PlainArm) -> None:
    if arm.n < 7:
        pytest.skip("six joints leave no self-motion")
    q, home = self_motion(arm, 400), arm.pose(arm.home)
    start = np.abs(q - arm.home).max()
    assert start > 0.2
    off: list[float] = []
    end = controlled(
        World(plain, q),
        CartesianImpedance(),
        arm,
        arm.home,
        1.5,
        lambda state: off.append(float(np.linalg.norm(tool_offset(plain, state.q, home)))),
    )
    assert np.abs(end.q - arm.home).max() < 0.01 * start
    assert max(off) < 1e-4


def test_a_torque_that_only_moves_the_elbow_is_not_felt_by_the_tool(
    arm: Arm, plain: PlainArm
) -> None:
    if arm.n < 7:
        pytest.skip("six joints leave no self-motion")
    world, home, off = World(plain, arm.home), arm.pose(arm.home), []
    controller = CartesianImpedance()
    for _ in range(800):
        state = world.state()
        off.append(np.linalg.norm(tool_offset(plain, state.q, home)))
        n = np.linalg.svd(arm.jacobian(state.q))[2][-1]
        n = n if n[0] >= 0 else -n
        push = 5.0 * arm.mass_matrix(state.q) @ n
        world.step(controller.torque(arm, at_rest(arm.home), state) + push)
    assert np.abs(world.state().q - arm.home).max() > 0.02
    assert max(off) < 1e-4


def stored(controller: CartesianImpedance, plain: PlainArm, world: World, q_ref: Vector) -> float:
    """Kinetic energy, and that of the springs from its definition [J]."""
    p_ref, R_ref = plain.tool(q_ref)
    p, R = plain.tool(world.state().q)
    axes = np.eye(3) if controller.frame == "world" else R_ref
    e = axes.T @ (p_ref - p)
    epsilon = axes.T @ Rotation.from_matrix(R_ref @ R.T).as_quat()[:3]
    K = controller.stiffness
    springs = 0.5 * e @ (K[:3] * e) + 2.0 * epsilon @ (K[3:] * epsilon)
    return world.kinetic_energy() + float(springs)


@pytest.mark.parametrize("frame", ["world", "tool"])
@pytest.mark.parametrize("ratio", [0.0, 1.0])
def test_stored_energy_never_grows(
    arm: Arm, plain: PlainArm, rng: np.random.Generator, frame: str, ratio: float
) -> None:
    """Without dampers it stays (joints' own friction aside), with them it falls."""
    controller = CartesianImpedance(
        stiffness=STIFFNESS,
        frame=frame,  # type: ignore[arg-type]
        damping_ratio=ratio,
        posture_frequency=0.0,
        error_max=np.full(6, 9.0),
    )
    v = 0.5 * rng.uniform(-1.0, 1.0, arm.n)
    world = World(plain, arm.home + 0.05 * rng.uniform(-1.0, 1.0, arm.n), v)
    energies = [stored(controller, plain, world, arm.home)]
    for _ in range(300):
        state = world.state()
        world.step(controller.torque(arm, at_rest(arm.home), state))
        energies.append(stored(controller, plain, world, arm.home))
    assert np.diff(energies).max() < 2e-3 * energies[0]
    assert energies[-1] < (0.5 if ratio else 1.001) * energies[0]


def test_the_springs_torque_is_the_slope_of_its_potential(
    arm: Arm, plain: PlainArm, rng: np.random.Generator
) -> None:
    controller = CartesianImpedance(
        stiffness=STIFFNESS, posture_frequency=0.0, error_max=np.full(6, 9.0)
    )
    q, q_ref, still = arm.home, arm.home + 0.2 * rng.uniform(-1, 1, arm.n), np.zeros(arm.n)
    tau = controller.torque(arm, at_rest(q_ref), JointState(q, still))
    tau -= arm.inverse_dynamics(q, still, still)
    h = 1e-5
    slope = [
        (
            stored(controller, plain, World(plain, q + h * e), q_ref)
            - stored(controller, plain, World(plain, q - h * e), q_ref)
        )
        / (2 * h)
        for e in np.eye(arm.n)
    ]
    assert tau == pytest.approx(-np.array(slope), rel=1e-4, abs=1e-4)


def test_a_large_error_pulls_no_harder_than_its_bound(arm: Arm) -> None:
    bound = np.array([0.02] * 3 + [0.1] * 3)
    controller = CartesianImpedance(error_max=bound, posture_frequency=0.0)
    still = np.zeros(arm.n)
    far = arm.home + np.where(np.arange(arm.n) % 2, 0.6, -0.6)
    tau = controller.torque(arm, at_rest(far), JointState(arm.home, still))
    tau -= arm.inverse_dynamics(arm.home, still, still)
    R, J = arm.pose(arm.home).rotation().as_matrix(), arm.jacobian(arm.home)
    J_world = np.vstack([R @ J[:3], R @ J[3:]])
    wrench = np.linalg.lstsq(J_world.T, tau, rcond=None)[0]
    assert (np.abs(wrench[:3]) <= controller.stiffness[:3] * bound[:3] + 1e-6).all()
    assert np.linalg.norm(wrench[3:]) <= np.linalg.norm(controller.stiffness[3:] * bound[3:]) + 1e-6
    assert np.abs(wrench[:3]).max() > 0.99 * controller.stiffness[0] * bound[0]


@pytest.mark.parametrize("gap", [0.0, 1e-6, 1e-3, 0.03, 0.1])
def test_it_stays_calm_at_a_singularity(
    robot: Robot, arm: Arm, plain: PlainArm, gap: float
) -> None:
    """All joints straight, and near it: pushed about and let go, the arm comes to rest."""
    q = np.clip(np.full(arm.n, gap), arm.q_min + 0.02, arm.q_max - 0.02)
    condition = np.linalg.cond(arm.jacobian(q))
    if gap == 0.0 and robot.name in ("panda", "iiwa14", "xarm7"):
        assert condition > 20.0
    world, controller, worst = World(plain, q), CartesianImpedance(), 0.0
    low, high = robot.tau_max * -1.0, robot.tau_max
    for k in range(round(1000 * patience(plain))):
        state = world.state()
        tau = controller.torque(arm, at_rest(q), state)
        assert np.isfinite(tau).all()
        force = np.array([10.0, -6.0, 8.0]) if k < 200 else None
        world.step(np.clip(tau, low, high), force)
        worst = max(worst, float(np.abs(state.v).max()))
    end = world.state()
    assert worst < 4.0
    assert np.abs(end.v).max() < 0.1
    assert np.abs(end.q - q).max() < 0.1


def test_without_error_the_arm_does_what_the_reference_does(
    arm: Arm, plain: PlainArm, rng: np.random.Generator
) -> None:
    for frame in ("world", "tool"):
        controller = CartesianImpedance(frame=frame)
        q = arm.home + 0.1 * rng.uniform(-1, 1, arm.n)
        v, a = rng.uniform(-1, 1, (2, arm.n))
        tau = controller.torque(arm, JointReference(q, v, a), JointState(q, v))
        friction = 0.8 * arm.dry_friction * np.tanh(v / 0.05)
        assert np.abs(plain.acceleration(q, v, tau - friction) - a).max() < 1e-6


@pytest.mark.parametrize(
    ("name", "bad", "message"),
    [
        ("stiffness", np.array([1.0, 1.0, 1.0, 1.0, 1.0, -1.0]), "0 or more and finite"),
        ("stiffness", np.ones(3), "a vector of 6"),
        ("error_max", np.full(6, np.nan), "a vector of 6"),
        ("damping_ratio", -0.1, "0 or more and finite"),
        ("posture_damping", np.inf, "0 or more and finite"),
        ("posture_frequency", np.nan, "0 or more and finite"),
        ("frame", "base", "'world' or 'tool'"),
    ],
)
def test_another_setting_is_refused(name: str, bad: object, message: str) -> None:
    with pytest.raises(InvalidValueError, match=rf"{name} must be .*{message}"):
        CartesianImpedance(**{name: bad})  # type: ignore[arg-type]
