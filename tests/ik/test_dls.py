import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mink import SE3
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Vector
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.solver import Reason, Tolerance
from robo47_qp.model.arm import Arm
from tests.examples import inner_fractions, rates, shifted, turned
from tests.plain_arm import PlainArm

SEEDS = 100


def way(plain: PlainArm, q: Vector, target: SE3) -> Vector:
    """Displacement and rotation vector to the target, both in the tool frame."""
    position, R = plain.tool(q)
    turn = Rotation.from_matrix(R.T @ target.rotation().as_matrix()).as_rotvec()
    return np.concatenate([R.T @ (target.translation() - position), turn])


@settings(max_examples=25)
@given(at=inner_fractions, step=rates, damping=st.floats(0.01, 1.0))
def test_one_step_minimises_error_and_damped_step(
    arm: Arm, plain: PlainArm, at: Vector, step: Vector, damping: float
) -> None:
    q = plain.at(at)
    target = arm.pose(q + 0.3 * step[: plain.n])
    e = way(plain, q, target)
    assume(1e-3 < np.linalg.norm(e[3:]) < 3.0)
    A = np.vstack([plain.jacobian(q), damping * np.eye(plain.n)])
    best = np.linalg.lstsq(A, np.concatenate([e, np.zeros(plain.n)]), rcond=None)[0]
    solver = DlsIk(max_iterations=1, clip=False, damping=damping)
    assert solver.solve(arm, target, q).q - q == pytest.approx(best, abs=1e-6)


@settings(max_examples=25)
@given(at=inner_fractions, step=rates)
def test_one_step_on_the_position_ignores_the_rotation(
    arm: Arm, plain: PlainArm, at: Vector, step: Vector
) -> None:
    q = plain.at(at)
    target = turned(arm.pose(q + 0.3 * step[: plain.n]), 1, 2.0)
    position, R = plain.tool(q)
    e = R.T @ (target.translation() - position)
    assume(np.linalg.norm(e) > 1e-3)
    A = np.vstack([plain.jacobian(q)[:3], 0.05 * np.eye(plain.n)])
    best = np.linalg.lstsq(A, np.concatenate([e, np.zeros(plain.n)]), rcond=None)[0]
    solver = DlsIk(max_iterations=1, clip=False, position_only=True)
    assert solver.solve(arm, target, q).q - q == pytest.approx(best, abs=1e-6)


def test_clipping_ends_a_step_on_the_limit(arm: Arm, plain: PlainArm) -> None:
    q = arm.home.copy()
    q[0] = plain.q_max[0] - 0.05
    beyond = q.copy()
    beyond[0] += 0.3
    target = arm.pose(beyond)
    free = DlsIk(max_iterations=1, clip=False).solve(arm, target, q)
    clipped = DlsIk(max_iterations=1).solve(arm, target, q)
    assert free.q[0] > plain.q_max[0]
    assert clipped.q == pytest.approx(np.clip(free.q, plain.q_min, plain.q_max), abs=1e-15)


def test_without_clipping_an_answer_outside_the_limits_is_named(arm: Arm, plain: PlainArm) -> None:
    q = arm.home.copy()
    q[0] = plain.q_max[0] + 0.2
    result = DlsIk(clip=False).solve(arm, arm.pose(q), q)
    joint, low, high = arm.robot.joints[0], plain.q_min[0], plain.q_max[0]
    assert result.reason is Reason.JOINT_LIMITS
    assert (
        result.explanation
        == f"{joint} is 0.200 {arm.robot.units[0]} outside [{low:.3f}, {high:.3f}]"
    )
    assert result.limit_margin == pytest.approx(-0.2)


def test_every_joint_outside_its_limits_is_named(arm: Arm, plain: PlainArm) -> None:
    q = arm.home.copy()
    q[0], q[-1] = plain.q_min[0] - 0.1, plain.q_max[-1] + 0.4
    result = DlsIk(clip=False).solve(arm, arm.pose(q), q)
    first, last = result.explanation.split("], ")
    assert first.startswith(f"{arm.robot.joints[0]} is 0.100 {arm.robot.units[0]} outside")
    assert last.startswith(f"{arm.robot.joints[-1]} is 0.400 rad outside")
    assert result.limit_margin == pytest.approx(-0.4)


def test_position_only_reaches_the_point_and_tells_the_angle_left(
    arm: Arm, plain: PlainArm
) -> None:
    target = turned(shifted(arm.pose(arm.home), np.array([0.05, 0.1, -0.1])), 0, 1.0)
    result = DlsIk(position_only=True).solve(arm, target, arm.home)
    position, angle = plain.errors(result.q, target)
    assert result.converged
    assert position <= 1e-6
    assert result.orientation_error == pytest.approx(angle, abs=1e-9)
    assert angle > 0.1


def test_the_number_of_steps_is_bounded_and_counted(arm: Arm) -> None:
    target = shifted(arm.pose(arm.home), np.array([0.1, 0.1, -0.1]))
    full = DlsIk().solve(arm, target, arm.home)
    assert full.converged
    for count in range(full.iterations + 3):
        result = DlsIk(max_iterations=count).solve(arm, target, arm.home)
        assert result.iterations == min(count, full.iterations)
        assert result.converged == (count >= full.iterations)
        if count == 0:
            assert result.q.tolist() == arm.home.tolist()


def test_what_remains_is_told_in_numbers(arm: Arm, plain: PlainArm) -> None:
    target = turned(shifted(arm.pose(arm.home), np.array([0.012, 0.0, 0.0])), 2, 0.1)
    result = DlsIk(max_iterations=0).solve(arm, target, arm.home)
    assert result.reason is Reason.NOT_CONVERGED
    assert result.explanation == "12 mm and 5.73° remain after 0 iterations"


def test_a_wider_tolerance_is_met_sooner(arm: Arm, plain: PlainArm) -> None:
    target = shifted(arm.pose(arm.home), np.array([0.1, 0.1, -0.1]))
    wide = DlsIk(tolerance=Tolerance(position=1e-3, orientation=1e-2))
    loose, tight = wide.solve(arm, target, arm.home), DlsIk().solve(arm, target, arm.home)
    assert loose.converged
    assert loose.iterations < tight.iterations
    assert 1e-6 < loose.position_error <= 1e-3
    assert loose.orientation_error <= 1e-2


@pytest.mark.parametrize(
    ("field", "value"), [("position", 1e-3), ("orientation", 1e-2)], ids=["position", "angle"]
)
def test_both_errors_count(arm: Arm, field: str, value: float) -> None:
    """One tolerance wide open does not open the other."""
    target = turned(shifted(arm.pose(arm.home), np.array([0.1, 0.1, -0.1])), 1, 0.3)
    wide = {"position": Tolerance(position=value), "orientation": Tolerance(orientation=value)}
    tolerance = wide[field]
    result = DlsIk(tolerance=tolerance).solve(arm, target, arm.home)
    assert result.converged
    assert result.position_error <= tolerance.position
    assert result.orientation_error <= tolerance.orientation


def test_damping_calms_the_step_at_a_singularity(arm: Arm, plain: PlainArm) -> None:
    stretched = np.clip(np.zeros(arm.n), plain.q_min, plain.q_max)
    target = shifted(arm.pose(stretched), np.array([0.0, 0.0, -0.05]))
    steps = [
        np.linalg.norm(
            DlsIk(max_iterations=1, clip=False, damping=damping).solve(arm, target, stretched).q
            - stretched
        )
        for damping in (1e-4, 0.05, 0.5)
    ]
    assert steps[0] > steps[1] > steps[2] > 0.0


def test_it_reaches_most_targets_from_home(arm: Arm, plain: PlainArm) -> None:
    rng = np.random.default_rng(5)
    clipped, point = 0, 0
    for _ in range(SEEDS):
        target = arm.pose(rng.uniform(plain.q_min, plain.q_max))
        clipped += DlsIk().solve(arm, target, arm.home).converged
        point += DlsIk(position_only=True).solve(arm, target, arm.home).converged
    assert clipped >= 0.5 * SEEDS
    assert point >= 0.9 * SEEDS
