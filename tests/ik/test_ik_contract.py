"""What every IK solver of the package promises, whichever it is."""

import inspect
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import IkResult, IkSolver, Reason, Tolerance, is_pose, judged
from robo47_qp.model.arm import Arm
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Robot
from tests.examples import fractions, inner_fractions, poses, rates, shifted, turned
from tests.ik_members import KNOWN, discovered, keeps_limits, looks_at_position_only, members
from tests.plain_arm import PlainArm

MEMBERS = members()
EVERY = pytest.mark.parametrize("solver", MEMBERS.values(), ids=MEMBERS.keys())
# Shrinking a failure would solve thousands of problems.
FEW = settings(max_examples=8, phases=[Phase.explicit, Phase.generate])


def check(solver: IkSolver, plain: PlainArm, target: SE3, result: IkResult) -> None:
    """The result says what forward kinematics and the joint ranges say, and nothing else."""
    assert isinstance(result, IkResult)
    assert result.q.shape == (plain.n,)
    assert np.isfinite(result.q).all()
    position, angle = plain.errors(result.q, target)
    assert result.position_error == pytest.approx(position, abs=1e-9)
    assert result.orientation_error == pytest.approx(angle, abs=1e-9)
    margin = min((result.q - plain.q_min).min(), (plain.q_max - result.q).min())
    assert result.limit_margin == pytest.approx(margin, abs=1e-12)
    close = position <= solver.tolerance.position * (1 + 1e-6)
    if not looks_at_position_only(solver):
        close = close and angle <= solver.tolerance.orientation * (1 + 1e-6)
    if result.converged:
        assert close
        assert plain.inside(result.q)
        assert result.reason is None
        assert result.explanation == ""
    else:
        assert isinstance(result.reason, Reason)
        assert result.explanation
        if result.reason is Reason.JOINT_LIMITS:
            assert set(result.joints) <= set(plain.robot.joints)
            assert result.joints
            # Without restarts it is said of the answer itself, with them of the best one found.
            assert (close and not plain.inside(result.q)) or isinstance(solver, MultiStart)
        else:
            assert result.joints == ()
        out = result.reason is Reason.OUT_OF_REACH
        assert (result.beyond_reach > 0.0) == out == (result.bound is not None)
    assert result.iterations >= 0
    assert result.restarts >= 0
    assert 0.0 <= result.seconds < 60.0


def few_restarts(solver: IkSolver) -> IkSolver:
    """The same solver, giving up after few starts."""
    if isinstance(solver, MultiStart):
        return MultiStart(solver=solver.solver, max_restarts=3)
    return solver


def same(a: IkResult, b: IkResult) -> bool:
    """Bit by bit, but for the time it took."""
    fields = ("reason", "explanation", "position_error", "orientation_error", "limit_margin")
    counts = ("iterations", "restarts")
    return a.q.tobytes() == b.q.tobytes() and all(
        repr(getattr(a, name)) == repr(getattr(b, name)) for name in fields + counts
    )


def test_every_class_that_solves_is_in_this_test() -> None:
    tested = {type(solver) for solver in MEMBERS.values()}
    assert set(discovered()) == tested
    assert set(KNOWN) <= tested
    assert MultiStart in tested


@pytest.mark.parametrize("kind", discovered(), ids=lambda kind: kind.__name__)
def test_a_solver_follows_the_protocol(kind: type[Any]) -> None:
    assert list(inspect.signature(kind.solve).parameters) == [
        *("self", "arm", "T_world_target", "q_seed")
    ]
    assert hasattr(kind, "tolerance") or "tolerance" in inspect.signature(kind).parameters


@EVERY
def test_a_solver_names_its_tolerance(solver: IkSolver) -> None:
    assert isinstance(solver.tolerance, Tolerance)
    assert 0.0 < solver.tolerance.position <= 1e-4
    assert solver.tolerance.orientation > 0.0


@EVERY
@FEW
@given(at=fractions)
def test_a_target_reached_by_the_seed_returns_the_seed(
    solver: IkSolver, arm: Arm, plain: PlainArm, at: Vector
) -> None:
    q_seed = plain.at(at)
    target = arm.pose(q_seed)
    result = solver.solve(arm, target, q_seed)
    check(solver, plain, target, result)
    assert result.converged
    assert result.q.tolist() == q_seed.tolist()
    assert result.iterations == result.restarts == 0


@EVERY
@FEW
@given(at=inner_fractions, step=rates)
def test_a_target_near_the_seed_is_reached_pairs_within(
    solver: IkSolver, arm: Arm, plain: PlainArm, at: Vector, step: Vector
) -> None:
    q_seed = plain.at(at)
    assume(np.linalg.svd(arm.jacobian(q_seed), compute_uv=False)[-1] > 0.1)
    q_there = np.clip(q_seed + 0.02 * step[: plain.n], plain.q_min, plain.q_max)
    target = arm.pose(q_there)
    result = solver.solve(arm, target, q_seed)
    check(solver, plain, target, result)
    assert result.converged
    assert result.restarts == 0


@EVERY
@FEW
@given(at=fractions, seed=fractions)
def test_a_target_within_reach_is_never_called_out_of_reach(
    solver: IkSolver, arm: Arm, plain: PlainArm, at: Vector, seed: Vector
) -> None:
    target = arm.pose(plain.at(at))
    solver = few_restarts(solver)
    result = solver.solve(arm, target, plain.at(seed))
    check(solver, plain, target, result)
    assert result.reason in {None, Reason.NOT_CONVERGED, Reason.JOINT_LIMITS}
    if keeps_limits(solver):
        assert plain.inside(result.q)
        if not isinstance(solver, MultiStart):
            assert result.reason is not Reason.JOINT_LIMITS


@EVERY
@FEW
@given(target=poses, seed=fractions)
def test_any_pose_in_the_room_has_an_answer(
    solver: IkSolver, arm: Arm, plain: PlainArm, target: SE3, seed: Vector
) -> None:
    solver = few_restarts(solver)
    check(solver, plain, target, solver.solve(arm, target, plain.at(seed)))


@EVERY
def test_a_half_turn_of_the_tool_is_not_taken_for_none(
    solver: IkSolver, arm: Arm, plain: PlainArm
) -> None:
    solver = few_restarts(solver)
    for axis, angle in product(range(3), (np.pi, -np.pi, np.pi - 1e-9, np.pi + 1e-7)):
        target = turned(arm.pose(arm.home), axis, angle)
        check(solver, plain, target, solver.solve(arm, target, arm.home))


@EVERY
def test_an_exact_half_turn_is_not_taken_for_none(
    solver: IkSolver, arm: Arm, plain: PlainArm
) -> None:
    """The quaternion between tool and target has w = 0, to the last bit."""
    solver = few_restarts(solver)
    for half_turn in np.eye(4)[1:]:
        for q in (arm.home, plain.at(np.full(8, 0.4))):
            target = arm.pose(q) @ SE3.from_rotation(SO3(half_turn))
            assert plain.errors(q, target)[1] == pytest.approx(np.pi)
            check(solver, plain, target, solver.solve(arm, target, q))


@EVERY
@FEW
@given(at=inner_fractions, step=rates)
def test_a_quaternion_and_its_negative_are_the_same_target(
    solver: IkSolver, arm: Arm, plain: PlainArm, at: Vector, step: Vector
) -> None:
    solver, q_seed = few_restarts(solver), plain.at(at)
    target = arm.pose(np.clip(q_seed + 0.1 * step[: plain.n], plain.q_min, plain.q_max))
    signs = np.array([-1.0] * 4 + [1.0] * 3)
    mirrored = SE3(target.wxyz_xyz * signs)
    a, b = solver.solve(arm, target, q_seed), solver.solve(arm, mirrored, q_seed)
    assert a.reason is b.reason
    if a.converged:  # where it is not, rounding decides where a long search ends
        assert a.q == pytest.approx(b.q, abs=1e-5)


@EVERY
def test_the_stretched_arm_can_be_left_and_reached(
    solver: IkSolver, arm: Arm, plain: PlainArm
) -> None:
    stretched = np.clip(np.zeros(arm.n), plain.q_min, plain.q_max)
    for start, goal in ((stretched, arm.home), (arm.home, stretched)):
        target = arm.pose(goal)
        check(solver, plain, target, solver.solve(arm, target, start))
    result = solver.solve(arm, arm.pose(stretched), stretched)
    assert result.converged


@EVERY
def test_beyond_the_stretched_arm_nothing_breaks(
    solver: IkSolver, arm: Arm, plain: PlainArm
) -> None:
    stretched = np.clip(np.zeros(arm.n), plain.q_min, plain.q_max)
    target = shifted(arm.pose(stretched), np.array([0.0, 0.0, 0.05]))
    result = few_restarts(solver).solve(arm, target, stretched)
    check(solver, plain, target, result)
    assert result.converged == looks_at_position_only(solver)


@EVERY
def test_a_joint_at_its_limit_is_inside(solver: IkSolver, arm: Arm, plain: PlainArm) -> None:
    for i, end in product(range(arm.n), ("q_min", "q_max")):
        q = arm.home.copy()
        q[i] = getattr(plain, end)[i]
        target = arm.pose(q)
        assert solver.solve(arm, target, q).converged
        seed = np.clip(q + 0.02, plain.q_min, plain.q_max)
        result = solver.solve(arm, target, seed)
        check(solver, plain, target, result)
        if keeps_limits(solver):
            assert result.converged, result.explanation


@EVERY
def test_a_seed_outside_the_limits_is_a_start_like_any_other(
    solver: IkSolver, arm: Arm, plain: PlainArm
) -> None:
    q_seed = arm.home.copy()
    q_seed[0] = plain.q_max[0] + 0.3
    target = arm.pose(np.clip(q_seed - 0.4, plain.q_min, plain.q_max))
    result = solver.solve(arm, target, q_seed)
    check(solver, plain, target, result)
    if keeps_limits(solver):
        assert result.converged


@EVERY
def test_a_target_out_of_reach_is_a_result_with_its_distance(
    solver: IkSolver, arm: Arm, plain: PlainArm
) -> None:
    for far in np.array([(2.0, 0.0, 0.3), (0.0, 0.0, -5.0), (1e3, 1e3, 1e3)]):
        target = SE3.from_rotation_and_translation(arm.pose(arm.home).rotation(), far)
        result = solver.solve(arm, target, arm.home)
        check(solver, plain, target, result)
        assert result.reason is Reason.OUT_OF_REACH
        beyond = arm.beyond_reach(far)
        assert result.explanation == f"the target is {beyond:.3f} m beyond the reach of the arm"
        assert result.restarts == 0


BAD_POSES = {
    "nan position": [1, 0, 0, 0, 0.4, np.nan, 0.3],
    "infinite position": [1, 0, 0, 0, np.inf, 0.0, 0.3],
    "nan quaternion": [np.nan, 0, 0, 0, 0.4, 0.0, 0.3],
    "infinite quaternion": [np.inf, 0, 0, 0, 0.4, 0.0, 0.3],
    "no quaternion": [0, 0, 0, 0, 0.4, 0.0, 0.3],
    "long quaternion": [1.01, 0, 0, 0, 0.4, 0.0, 0.3],
    "beyond all bounds": [1, 0, 0, 0, 1e100, 0.0, 0.3],
    "overflow": [1, 0, 0, 0, 0.4, -1e300, 0.3],
    "short quaternion": [0.99, 0, 0, 0, 0.4, 0.0, 0.3],
}


@EVERY
def test_a_target_that_is_no_pose_is_a_result(solver: IkSolver, arm: Arm) -> None:
    for case, numbers in BAD_POSES.items():
        target = SE3(np.array(numbers, dtype=np.float64))
        assert not is_pose(target), case
        result = solver.solve(arm, target, arm.home)
        assert result.reason is Reason.INVALID_TARGET, case
        assert not result.converged
        assert "not a finite pose with a unit quaternion" in result.explanation
        assert result.q.tolist() == arm.home.tolist()
        assert np.isnan(result.position_error)
        assert np.isnan(result.orientation_error)
        assert result.limit_margin == arm.limit_margin(arm.home)
        assert result.iterations == result.restarts == 0
    others: list[Any] = [None, np.eye(4), np.zeros(3), "home", SO3.identity()]
    for other in others:
        assert solver.solve(arm, other, arm.home).reason is Reason.INVALID_TARGET


@EVERY
def test_a_seed_that_is_no_configuration_is_refused(solver: IkSolver, arm: Arm) -> None:
    shapes: list[Any] = [[0.0], 0.0, [[0.0] * 7], [0.0] * 30, "home"]
    for q_seed in shapes:
        with pytest.raises(InvalidValueError, match=rf"q_seed must be a vector of {arm.n} finite"):
            solver.solve(arm, arm.pose(arm.home), q_seed)
    q_seed = arm.home.copy()
    for bad in (np.nan, np.inf, -np.inf):
        q_seed[2] = bad
        for target in (arm.pose(arm.home), SE3(np.full(7, np.nan))):
            with pytest.raises(InvalidValueError, match=r"q_seed must be .* found"):
                solver.solve(arm, target, q_seed)


@EVERY
def test_the_same_question_has_the_same_answer(solver: IkSolver, robot: Robot, arm: Arm) -> None:
    rng = np.random.default_rng(11)
    targets = [arm.pose(rng.uniform(arm.q_min, arm.q_max)) for _ in range(3)]
    q_seed = rng.uniform(arm.q_min, arm.q_max)
    first = solver.solve(arm, targets[0], q_seed)
    assert same(solver.solve(arm, targets[0], q_seed), first)
    solver.solve(arm, targets[1], arm.home)
    solver.solve(arm, SE3(np.full(7, np.nan)), arm.home)
    assert same(solver.solve(arm, targets[0], q_seed), first)
    fresh = Arm(robot)
    solver.solve(fresh, targets[2], q_seed)
    assert same(solver.solve(fresh, targets[0], q_seed), first)


@EVERY
def test_answers_belong_to_the_caller_and_questions_are_left_alone(
    solver: IkSolver, arm: Arm
) -> None:
    q_seed, target = arm.home + 0.05, arm.pose(arm.home)
    asked = q_seed.copy(), target.wxyz_xyz.copy(), arm.q_min.copy(), arm.q_max.copy()
    first = solver.solve(arm, target, q_seed)
    q = first.q.copy()
    for other in (first, solver.solve(arm, target, arm.home)):
        other.q[:] = 99.0
    assert solver.solve(arm, target, q_seed).q.tolist() == q.tolist()
    nothing = solver.solve(arm, SE3(np.full(7, np.nan)), q_seed)
    nothing.q[:] = 99.0
    found = q_seed, target.wxyz_xyz, arm.q_min, arm.q_max
    for before, after in zip(asked, found, strict=True):
        assert before.tolist() == after.tolist()


@EVERY
def test_what_the_tool_holds_does_not_matter(solver: IkSolver, arm: Arm) -> None:
    held = Payload(mass=2.0, inertia=(1e-2, 1e-2, 1e-2), T_tcp_com=SE3.identity())
    target = turned(shifted(arm.pose(arm.home), np.array([0.05, 0.08, -0.1])), 2, 0.4)
    empty = solver.solve(arm, target, arm.home)
    loaded = solver.solve(arm.with_payload(held), target, arm.home)
    # Rounding of the Jacobian is amplified along the null space.
    assert loaded.q == pytest.approx(empty.q, abs=1e-5)
    assert loaded.converged == empty.converged


@EVERY
def test_a_solver_cannot_be_changed_and_compares_by_its_settings(solver: IkSolver) -> None:
    assert members()[next(name for name, value in MEMBERS.items() if value is solver)] == solver
    assert hash(solver) == hash(solver)


def test_each_error_alone_is_an_error(arm: Arm) -> None:
    here = arm.pose(arm.home)
    turn, shift = turned(here, 1, 2e-3), shifted(here, np.array([0.0, 2e-3, 0.0]))
    for target, wide in (
        (turn, Tolerance(position=1.0, orientation=1e-3)),
        (shift, Tolerance(position=1e-3, orientation=1.0)),
    ):
        result = judged(arm, target, arm.home, wide, 4)
        assert result.reason is Reason.NOT_CONVERGED
        assert result.iterations == 4
        assert judged(
            arm, target, arm.home, Tolerance(position=3e-3, orientation=3e-3), 4
        ).converged


def test_a_judged_result_has_its_own_configuration(arm: Arm) -> None:
    q = arm.home.copy()
    result = judged(arm, arm.pose(q), q, Tolerance(), 0)
    q[:] = 7.0
    assert result.q.tolist() == arm.home.tolist()


def test_a_quaternion_may_be_off_by_rounding() -> None:
    for scale in (1.0, 1.0 + 1e-12, 1.0 - 5e-7, 1.0 + 5e-7):
        assert is_pose(SE3(np.array([scale, 0, 0, 0, 0.1, 0.2, 0.3])))
    for scale in (1.0 - 1e-5, 1.0 + 1e-5):
        assert not is_pose(SE3(np.array([scale, 0, 0, 0, 0.1, 0.2, 0.3])))
