import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robo47_qp.control.operational_space import OperationalSpace
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference, JointState
from tests.controlled import DT, World, at_rest, controlled, self_motion, tool_offset
from tests.plain_arm import PlainArm


def patience(plain: PlainArm) -> float:
    """How long an arm takes to come to rest, the longer the more its joints are damped [s]."""
    return 1.5 + 0.5 * float(plain.damping.max())


@pytest.mark.parametrize("ratio", [0.5, 1.0])
def test_an_error_decays_as_that_of_a_mass_on_a_spring(
    arm: Arm, plain: PlainArm, rng: np.random.Generator, ratio: float
) -> None:
    """Every axis: e'' + 2 ζ ω e' + ω² e = 0, solved by hand."""
    w = 25.0
    controller = OperationalSpace(frequency=w, damping_ratio=ratio)
    q = arm.home + 0.02 * rng.uniform(-1, 1, arm.n)
    home, world = arm.pose(arm.home), World(plain, q)
    path = [tool_offset(plain, q, home)]
    for _ in range(300):
        world.step(controller.torque(arm, at_rest(arm.home), world.state()))
        path.append(tool_offset(plain, world.state().q, home))
    t = DT * np.arange(301)
    if ratio == 1.0:
        decay = (1 + w * t) * np.exp(-w * t)
    else:
        fast = w * np.sqrt(1 - ratio**2)
        decay = np.exp(-ratio * w * t) * (np.cos(fast * t) + ratio * w / fast * np.sin(fast * t))
    expected = decay[:, None] * path[0]
    assert np.abs(np.array(path) - expected).max() < 0.03 * np.abs(path[0]).max()


def test_the_tool_turns_back_at_the_same_pace(arm: Arm, plain: PlainArm) -> None:
    q = arm.home.copy()
    q[-1] += 0.05
    R_home = plain.tool(arm.home)[1]
    world, angles = World(plain, q), []
    for _ in range(200):
        angles.append(Rotation.from_matrix(plain.tool(world.state().q)[1].T @ R_home).magnitude())
        world.step(OperationalSpace().torque(arm, at_rest(arm.home), world.state()))
    t = DT * np.arange(200)
    expected = angles[0] * (1 + 25 * t) * np.exp(-25 * t)
    assert np.abs(np.array(angles) - expected).max() < 0.03 * angles[0]


def test_a_force_meets_the_inertia_of_the_arm(arm: Arm, plain: PlainArm) -> None:
    """x = Λ⁻¹ F / ω², with Λ from energies and differences of poses."""
    J, M = plain.jacobian(arm.home), plain.mass_matrix(arm.home)
    R = plain.tool(arm.home)[1]
    J_world = np.vstack([R @ J[:3], R @ J[3:]])
    force = np.array([0.0, 0.0, 2.0])
    twist = J_world @ np.linalg.solve(M, J_world[:3].T @ force)
    world = World(plain, arm.home)
    end = controlled(world, OperationalSpace(), arm, arm.home, 1.0, push=(force, None))
    moved = tool_offset(plain, end.q, arm.pose(arm.home))
    assert moved == pytest.approx(twist[:3] / 25**2, rel=0.05, abs=1e-4)


def test_the_elbow_moves_without_the_tool(arm: Arm, plain: PlainArm) -> None:
    if arm.n < 7:
        pytest.skip("six joints leave no self-motion")
    q, home, off = self_motion(arm, 400), arm.pose(arm.home), [0.0]
    end = controlled(
        World(plain, q),
        OperationalSpace(),
        arm,
        arm.home,
        1.5,
        lambda state: off.append(float(np.linalg.norm(tool_offset(plain, state.q, home)))),
    )
    assert np.abs(end.q - arm.home).max() < 0.01 * np.abs(q - arm.home).max()
    assert max(off) < 1e-4


@pytest.mark.parametrize("gap", [0.0, 1e-6, 1e-3, 0.03, 0.1])
def test_it_stays_calm_at_a_singularity(arm: Arm, plain: PlainArm, gap: float) -> None:
    q = np.clip(np.full(arm.n, gap), arm.q_min + 0.02, arm.q_max - 0.02)
    world, worst = World(plain, q), 0.0
    for k in range(round(1000 * patience(plain))):
        state = world.state()
        tau = OperationalSpace().torque(arm, at_rest(q), state)
        assert np.isfinite(tau).all()
        force = np.array([10.0, -6.0, 8.0]) if k < 200 else None
        world.step(np.clip(tau, -arm.robot.tau_max, arm.robot.tau_max), force)
        worst = max(worst, float(np.abs(state.v).max()))
    end = world.state()
    assert worst < 5.0
    assert np.abs(end.v).max() < 0.1
    assert np.abs(end.q - q).max() < 0.1


def test_without_error_the_arm_does_what_the_reference_does(
    arm: Arm, plain: PlainArm, rng: np.random.Generator
) -> None:
    q = arm.home + 0.1 * rng.uniform(-1, 1, arm.n)
    v, a = rng.uniform(-1, 1, (2, arm.n))
    tau = OperationalSpace().torque(arm, JointReference(q, v, a), JointState(q, v))
    friction = 0.8 * arm.dry_friction * np.tanh(v / 0.05)
    assert np.abs(plain.acceleration(q, v, tau - friction) - a).max() < 1e-6


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("frequency", -1.0),
        ("damping_ratio", np.nan),
        ("error_max", (0.1, -0.1)),
        ("error_max", (0.1,)),
        ("error_max", (0.1, 0.2, 0.3)),
    ],
)
def test_another_setting_is_refused(name: str, bad: object) -> None:
    with pytest.raises(InvalidValueError, match=rf"{name} must be .*0 or more and finite"):
        OperationalSpace(**{name: bad})  # type: ignore[arg-type]


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_large_error_is_answered_up_to_its_bound(arm: Arm, plain: PlainArm, side: float) -> None:
    controller = OperationalSpace(error_max=(0.01, 0.02), posture_frequency=0.0)
    still = np.zeros(arm.n)
    far = np.clip(arm.home + 0.5 * side, arm.q_min, arm.q_max)
    tau = controller.torque(arm, at_rest(far), JointState(arm.home, still))
    a = plain.acceleration(arm.home, still, tau)
    R, J = plain.tool(arm.home)[1], plain.jacobian(arm.home)
    twist = np.concatenate([R @ (J[:3] @ a), R @ (J[3:] @ a)])
    bound = 25.0**2 * np.array([0.01] * 3 + [0.02] * 3)
    assert (np.abs(twist) <= 1.001 * bound).all()
    assert (np.abs(twist) > 0.99 * bound).any()
