"""The compiled searches beside the numpy reference: every piece, then whole searches."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp._core import library as core
from robo47_qp._core.library import functions, pointer, using
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.benchmarks.ik.same_step import differences, states, step_of
from robo47_qp.ik import many, multistart
from robo47_qp.ik.box_qp import box_qp
from robo47_qp.ik.gauss_newton import GaussNewtonIk, Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.many import IkResults, fk_many, solve_many
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.pose_log import PoseLog
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.restarts import Restarts
from robo47_qp.ik.seeds import feature_of, library_of
from robo47_qp.ik.solver import Tolerance
from robo47_qp.ik.tool_demand import POSITION, FreeAxis
from robo47_qp.ik.tool_error import ToolError
from robo47_qp.model.arm import Arm
from robo47_qp.model.chain import Chain
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.model.tool_poses import ToolPoses

EXACT = 1e-12
EARLY = {"max_iterations": 30, "stall": Stall()}
KINDS: dict[str, GaussNewtonIk] = {
    "lm": LmIk(**EARLY),  # type: ignore[arg-type]
    "qp": QpIk(**EARLY),  # type: ignore[arg-type]
    "lm, position": LmIk(position_only=True, **EARLY),  # type: ignore[arg-type]
    "lm, POSITION": LmIk(tolerance=Tolerance(demand=POSITION), **EARLY),  # type: ignore[arg-type]
}


@pytest.fixture(scope="module")
def panda() -> Arm:
    return Arm(PANDA)


def poses(arm: Arm, count: int, seed: int) -> list[SE3]:
    rng = np.random.default_rng(seed)
    return [arm.pose(q) for q in rng.uniform(arm.q_min, arm.q_max, (count, arm.n))]


def test_pose_errors_are_those_of_numpy(panda: Arm) -> None:
    rng, chain = np.random.default_rng(0), panda.derived(Chain)
    error, e, T = ToolError(panda), np.empty(6), np.empty(12)
    for k in range(2000):
        q = rng.uniform(panda.q_min, panda.q_max)
        target = panda.pose(rng.uniform(panda.q_min, panda.q_max))
        if k % 2:
            # Near the tool, and turned by almost half a turn about any axis of the tool.
            turn = SO3.exp(rng.normal(size=3) * 10.0 ** -rng.uniform(0.0, 9.0))
            half = SO3.exp(np.eye(3)[k % 3] * (np.pi - 1e-3) * (k % 4 == 1))
            here = panda.pose(q)
            target = SE3.from_rotation_and_translation(
                here.rotation() @ half @ turn, here.translation()
            )
        error.set_target(target)
        error.move(q)
        chain.move(q)
        functions().r47_frame_of(pointer(target.wxyz_xyz), pointer(T))
        functions().r47_pose_error(pointer(chain.frame()), pointer(T), pointer(e))
        np.testing.assert_allclose(e, error.e, rtol=0.0, atol=EXACT)


def test_logarithms_are_those_of_numpy() -> None:
    rng, log = np.random.default_rng(0), PoseLog()
    twist, A, B = np.empty(6), np.empty((3, 3)), np.empty((3, 3))
    for k in range(2000):
        e = rng.normal(size=6)
        e[3:] *= rng.uniform(0.0, 3.1) / np.linalg.norm(e[3:]) * 10.0 ** -(k % 10)
        expected, slope = log.expand(e)
        functions().r47_pose_log(pointer(e), pointer(twist), pointer(A), pointer(B))
        np.testing.assert_allclose(twist, expected, rtol=0.0, atol=EXACT)
        whole = np.block([[A, B], [np.zeros((3, 3)), A]])
        np.testing.assert_allclose(whole, slope, rtol=0.0, atol=10.0 * EXACT)


def solved(H: Matrix, f: Vector, low: Vector, high: Vector) -> Vector | None:
    n = len(f)
    x, side, L = np.empty(n), np.zeros(n, dtype=np.int32), np.empty((n, n))
    arrays: list[Any] = [H, f, low, high, x, side, L]
    free = functions().r47_box_qp(n, *map(pointer, arrays))
    assert free == -1 or free == np.count_nonzero(side == 0)
    return None if free < 0 else x


def test_box_qps_are_solved_to_the_last_digits() -> None:
    """Optimality itself, and DAQP; with bounds that meet, are missing or are met exactly."""
    rng = np.random.default_rng(0)
    for k in range(2000):
        n = 1 + k % 12
        A = rng.normal(size=(n + 2, n))
        H, f = A.T @ A + 10.0 ** -rng.uniform(0.0, 4.0) * np.eye(n), rng.normal(size=n)
        low, high = -rng.uniform(0.0, 1.0, n), rng.uniform(0.0, 1.0, n)
        low[rng.random(n) < 0.2] = -np.inf
        high[rng.random(n) < 0.1] = 0.0
        same = rng.random(n) < 0.1
        high[same] = np.where(np.isfinite(low), low, 0.0)[same]
        low[same] = high[same]
        if k % 5 == 0:
            # The free minimum lies on the bounds of half of the unknowns.
            free = np.linalg.solve(H, -f)
            low[::2], high[1::2] = free[::2], np.maximum(free, 0.0)[1::2]
            high = np.maximum(high, low)
        x = solved(H, f, low, high)
        assert x is not None
        assert (x >= low).all()
        assert (x <= high).all()
        slope = H @ x + f
        wrong = np.where(x <= low, np.minimum(slope, 0.0), slope)
        wrong = np.where(x >= high, np.maximum(slope, 0.0) * (x > low), wrong)
        assert np.abs(wrong).max() < 1e-10
        expected = box_qp("daqp", n).solve(H, f, np.maximum(low, -1e3), high)
        assert expected is not None
        assert x == pytest.approx(expected, abs=1e-7)


def test_a_qp_that_is_not_convex_has_no_answer() -> None:
    H = np.diag([1.0, -1.0])
    assert solved(H, np.zeros(2), np.full(2, -1.0), np.full(2, 1.0)) is None


@pytest.mark.parametrize("kind", KINDS)
def test_steps_are_those_of_numpy(panda: Arm, kind: str) -> None:
    """As far as those have digits: both are held to the exact step below and in test_mink.py."""
    for state in states(panda, 500, seed=8):
        step = step_of(KINDS[kind], panda, state)
        with using("numpy"):
            reference = step_of(KINDS[kind], panda, state)
        np.testing.assert_allclose(step, reference, rtol=0.0, atol=3e-10)


@pytest.mark.parametrize("name", ["qp", "lm", "lm, position"])
def test_steps_are_exact(panda: Arm, name: str) -> None:
    for state in states(panda, 30, seed=9):
        assert differences(name, panda, state).solver_exact < 2e-11


@pytest.mark.parametrize("kind", KINDS)
def test_descents_are_those_of_numpy(panda: Arm, kind: str) -> None:
    rng, solver = np.random.default_rng(2), KINDS[kind]
    for target in poses(panda, 60, seed=3):
        q = rng.uniform(panda.q_min - 0.1, panda.q_max + 0.1)
        found = solver.solve(panda, target, q)
        with using("numpy"):
            reference = solver.solve(panda, target, q)
        assert found.iterations == reference.iterations
        assert found.reason is reference.reason
        assert found.q == pytest.approx(reference.q, abs=1e-6)
        again = solver.solve(panda, target, q)
        assert again.q.tobytes() == found.q.tobytes()


def test_two_arms_descend_as_in_numpy() -> None:
    arm = Arm(panda_pair())
    rng = np.random.default_rng(4)
    names = [tool.name for tool in arm.robot.tools]
    for solver in (LmIk(), QpIk()):
        for _ in range(5):
            q = rng.uniform(arm.q_min, arm.q_max)
            goal = arm.home + rng.uniform(-0.3, 0.3, arm.n)
            target = ToolPoses({name: arm.pose(goal, i) for i, name in enumerate(names)})
            found = solver.solve(arm, target, q)
            with using("numpy"):
                reference = solver.solve(arm, target, q)
            assert found.iterations == reference.iterations
            assert found.q == pytest.approx(reference.q, abs=1e-6)


def test_the_nearest_of_the_library_are_those_of_numpy(panda: Arm) -> None:
    library = library_of(panda, 3000)
    whole = MultiStart(solver=KINDS["lm"], library=3000).whole(panda)
    assert whole is not None
    distances, T = np.empty(3000, dtype=np.float32), np.empty(12)
    for target in poses(panda, 50, seed=5):
        functions().r47_frame_of(pointer(target.wxyz_xyz), pointer(T))
        functions().r47_library_distances(whole.library.pointer, pointer(T), pointer(distances))
        expected = library.distances(feature_of(target))
        np.testing.assert_allclose(distances, expected, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("seed_first", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_a_whole_search_is_that_of_its_descents(
    panda: Arm, kind: str, seed_first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the bit: starts, their order, second looks; also where there is hardly a way."""
    solver = MultiStart(solver=KINDS[kind], seed_first=seed_first)
    hard = replace(solver, solver=replace(KINDS[kind], max_iterations=4), near=2, library=60)
    rng = np.random.default_rng(6)
    restarts = 0
    for search in (solver, hard):
        for k, target in enumerate(poses(panda, 25, seed=7)):
            q_seed = rng.uniform(panda.q_min, panda.q_max)
            if k % 5 == 0:
                # Nearer to the target than the library.
                target = panda.pose(q_seed + 0.01)  # noqa: PLW2901
            found = search.solve(panda, target, q_seed)
            with monkeypatch.context() as patch:
                patch.setattr(MultiStart, "whole", lambda *_: None)
                expected = search.solve(panda, target, q_seed)
            assert found.reason is expected.reason
            assert found.q.tobytes() == expected.q.tobytes()
            assert (found.iterations, found.restarts) == (expected.iterations, expected.restarts)
            assert found.position_error == expected.position_error
            assert found.orientation_error == expected.orientation_error
            assert found.limit_margin == expected.limit_margin
            restarts = max(restarts, found.restarts)
    assert restarts > 10 or "osition" in kind.lower()


def test_the_reference_calls_nothing_of_the_core(
    panda: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbidden() -> Any:
        raise AssertionError("the core was called")

    target = panda.pose(panda.home + 0.2)
    with using("numpy"):
        monkeypatch.setattr(core, "_core", forbidden)
        arm = Arm(PANDA)
        for kind in KINDS.values():
            assert MultiStart(solver=kind).solve(arm, target, arm.home).converged
        assert solve_many(MultiStart(solver=KINDS["lm"]), arm, [target]).converged.all()
        assert fk_many(arm, [arm.home]).shape == (1, 4, 4)


def test_what_is_not_compiled_is_left_to_numpy(panda: Arm) -> None:
    whole = MultiStart(solver=LmIk()).whole(panda)
    assert isinstance(whole, Restarts)
    others: list[Any] = [
        LmIk(tolerance=Tolerance(demand=FreeAxis())),
        LmIk(clearance=0.01),
        LmIk(within_limits=False),
        QpIk(backend="osqp"),
    ]
    for solver in others:
        assert MultiStart(solver=solver).whole(panda) is None
        assert MultiStart(solver=solver).solve(panda, panda.pose(panda.home), panda.home).converged
    assert MultiStart(solver=LmIk(), answers=2).whole(panda) is None


def test_a_stall_over_more_steps_than_the_core_keeps_is_refused(panda: Arm) -> None:
    solver = LmIk(stall=Stall(steps=65))
    with pytest.raises(InvalidValueError, match=r"at most 64, else ROBO47_BACKEND=numpy; found 65"):
        solver.solve(panda, panda.pose(panda.home), panda.home)


def test_many_answers_are_those_one_by_one(panda: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(many, "_PART", 16)
    solver = MultiStart(solver=KINDS["lm"], seed_first=False)
    targets = poses(panda, 70, seed=11)
    targets[3] = SE3.from_translation(np.array([3.0, 0.0, 0.0]))
    targets[40] = SE3(np.full(7, np.nan))
    # Quaternions may be too long by one part in a million.
    targets[42] = SE3(targets[0].wxyz_xyz * [*[1.0 + 0.9e-6] * 4, 1.0, 1.0, 1.0])
    targets[43] = SE3(targets[0].wxyz_xyz * [*[1.0 + 1.1e-6] * 4, 1.0, 1.0, 1.0])
    q_seeds = np.random.default_rng(12).uniform(panda.q_min, panda.q_max, (70, panda.n))
    expected = [solver.solve(panda, t, q) for t, q in zip(targets, q_seeds, strict=True)]
    found: IkResults | None = None
    for threads in (3, 1):
        found = solve_many(solver, panda, targets, q_seeds, threads=threads)
        assert len(found) == len(targets)
        for k, (one, other) in enumerate(zip(found, expected, strict=True)):
            assert one.q.tobytes() == other.q.tobytes() == found.q[k].tobytes()
            assert one.reason is other.reason
            assert found.converged[k] == other.converged
            assert (one.iterations, one.restarts) == (other.iterations, other.restarts)
            assert repr(one.position_error) == repr(other.position_error)
    assert found is not None
    assert not found.converged[[3, 40, 43]].any()
    assert found.converged[42]
    assert [one.iterations for one in found[2:5]] == [one.iterations for one in expected[2:5]]
    assert found[-1].q.tobytes() == expected[-1].q.tobytes()
    with pytest.raises(IndexError):
        found[70]


def test_many_by_another_solver_take_their_turn(panda: Arm) -> None:
    targets = poses(panda, 3, seed=13)
    found = solve_many(LmIk(), panda, targets)
    for one, target in zip(found, targets, strict=True):
        assert one.q.tobytes() == LmIk().solve(panda, target, panda.home).q.tobytes()
    assert len(solve_many(LmIk(), panda, [])) == 0


def test_many_poses_are_those_one_by_one() -> None:
    arm = Arm(panda_pair())
    q = np.random.default_rng(14).uniform(arm.q_min, arm.q_max, (3000, arm.n))
    T = fk_many(arm, q, 1, threads=2)
    assert T.tobytes() == fk_many(arm, q, 1, threads=1).tobytes()
    for k in range(0, 3000, 97):
        np.testing.assert_allclose(T[k], arm.pose(q[k], 1).as_matrix(), rtol=0.0, atol=EXACT)
    with using("numpy"):
        np.testing.assert_allclose(T[:9], fk_many(arm, q[:9], 1), rtol=0.0, atol=EXACT)


def test_bad_input_is_refused(panda: Arm) -> None:
    target = panda.pose(panda.home)
    solver = MultiStart(solver=LmIk())
    with pytest.raises(InvalidValueError, match=r"q_seeds must be one .* each of 1 targets"):
        solve_many(solver, panda, [target], np.zeros((2, 7)))
    with pytest.raises(InvalidValueError, match=r"q_seeds must be finite numbers of shape"):
        solve_many(solver, panda, [target], np.zeros(6))
    with pytest.raises(InvalidValueError, match=r"q must be finite numbers of shape \(count, 7\)"):
        fk_many(panda, np.full((2, 7), np.nan))
    with pytest.raises(InvalidValueError, match="threads must be"):
        fk_many(panda, np.zeros((2, 7)), threads=0)


def test_the_number_of_second_looks_fits_the_core() -> None:
    """`MOST_CLOSE` and `MOST_ENDS` of restarts.c."""
    looks = multistart._SECOND_LOOKS
    most = max(b - a for a, b in zip((0, *looks), looks, strict=False))
    assert most + multistart._ENDS <= 128
    assert multistart._ENDS <= 8


@pytest.mark.parametrize("tool", [1, -1, 1_000_000, "tcp"])
def test_a_tool_that_the_robot_does_not_have_is_refused(panda: Arm, tool: Any) -> None:
    with pytest.raises(InvalidValueError, match="tool must be 0"):
        fk_many(panda, [panda.home], tool)


def test_words_are_no_configurations(panda: Arm) -> None:
    with pytest.raises(InvalidValueError, match=r"q must be finite numbers of shape \(count, 7\)"):
        fk_many(panda, "abc")
    with pytest.raises(InvalidValueError, match="q_seeds must be finite numbers"):
        solve_many(LmIk(), panda, [panda.pose(panda.home)], "abc")
