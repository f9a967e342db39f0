from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mink import SE3

from robo47_qp._core.library import using
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.benchmarks.ik.catalogue import solvers
from robo47_qp.evaluation.benchmarks.ik.targets import near_limits
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart, Preference
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.seeds import library_of
from robo47_qp.ik.solver import (
    IkResult,
    Reason,
    Tolerance,
    judged,
)
from robo47_qp.model.arm import Arm
from robo47_qp.model.loading import robot_from_mjcf
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.sampling import spread
from robo47_qp.model.tool_poses import Target
from tests.plain_arm import PlainArm
from tests.robots import arm_of


@dataclass(frozen=True, kw_only=True, eq=False)
class Script:
    """A solver that answers from a list and remembers where it was started."""

    answers: list[Vector]
    seeds: list[Vector] = field(default_factory=list)
    tolerance: Tolerance = Tolerance()

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        answer = self.answers[min(len(self.seeds), len(self.answers) - 1)]
        self.seeds.append(q_seed.copy())
        result = judged(arm, T_world_target, answer, self.tolerance, 3)
        return replace(result, seconds=100.0)


def off(arm: Arm, by: float) -> Vector:
    """Home with its first joint moved: the further, the larger the error."""
    q = arm.home.copy()
    q[0] += by
    return q


def starts(arm: Arm, count: int) -> list[Vector]:
    script = Script(answers=[off(arm, 1.0)])
    MultiStart(solver=script, max_restarts=count).solve(arm, arm.pose(arm.home), off(arm, 2.0))
    assert script.seeds[0].tolist() == off(arm, 2.0).tolist()
    return script.seeds[1:]


def test_a_seed_that_works_needs_no_restart(arm: Arm) -> None:
    script = Script(answers=[arm.home])
    result = MultiStart(solver=script).solve(arm, arm.pose(arm.home), off(arm, 0.3))
    assert result.converged
    assert result.restarts == 0
    assert result.iterations == 3
    assert [seed.tolist() for seed in script.seeds] == [off(arm, 0.3).tolist()]


@pytest.mark.parametrize("failures", [1, 4])
def test_it_stops_at_the_first_start_that_works(arm: Arm, failures: int) -> None:
    script = Script(answers=[off(arm, 1.0)] * failures + [arm.home, off(arm, 1.0)])
    result = MultiStart(solver=script).solve(arm, arm.pose(arm.home), arm.home)
    assert result.converged
    assert result.q.tolist() == arm.home.tolist()
    assert result.restarts == failures
    assert result.iterations == 3 * (failures + 1)
    assert len(script.seeds) == failures + 1


@pytest.mark.parametrize("best", [0, 1, 3, 5])
def test_where_none_works_the_closest_is_returned(arm: Arm, best: int) -> None:
    answers = [off(arm, 0.5 + 0.1 * i) for i in range(6)]
    answers[best] = off(arm, 0.2)
    script = Script(answers=answers)
    result = MultiStart(solver=script, max_restarts=5).solve(arm, arm.pose(arm.home), arm.home)
    assert not result.converged
    assert result.q.tolist() == off(arm, 0.2).tolist()
    assert result.restarts == 5
    assert result.iterations == 18
    assert len(script.seeds) == 6


def test_an_answer_outside_the_limits_is_tried_again(arm: Arm, plain: PlainArm) -> None:
    outside = off(arm, plain.q_max[0] - arm.home[0] + 0.1)
    target = arm.pose(outside)
    script = Script(answers=[outside, outside, off(arm, 1.0)])
    result = MultiStart(solver=script, max_restarts=3).solve(arm, target, arm.home)
    assert result.reason is Reason.JOINT_LIMITS
    assert len(script.seeds) == 4


def test_no_restart_helps_where_there_is_no_reach(arm: Arm) -> None:
    script = Script(answers=[arm.home])
    far = SE3.from_translation(np.array([9.0, 0.0, 0.0]))
    result = MultiStart(solver=script).solve(arm, far, arm.home)
    assert result.reason is Reason.OUT_OF_REACH
    assert len(script.seeds) == 1


def test_without_restarts_it_is_the_solver_itself(arm: Arm, plain: PlainArm) -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        target, seed = arm.pose(rng.uniform(plain.q_min, plain.q_max)), arm.home
        a = MultiStart(solver=QpIk(), max_restarts=0).solve(arm, target, seed)
        b = QpIk().solve(arm, target, seed)
        assert a.q.tolist() == b.q.tolist()
        assert (a.converged, a.iterations, a.restarts) == (b.converged, b.iterations, 0)


def test_starts_are_inside_the_limits_and_the_same_every_time(arm: Arm, plain: PlainArm) -> None:
    first = starts(arm, 50)
    assert len(first) == 50
    assert all(plain.inside(q) for q in first)
    assert np.array(first).tolist() == np.array(starts(arm, 50)).tolist()
    assert len({tuple(q) for q in first}) == 50


def test_fewer_starts_are_the_first_of_many(arm: Arm) -> None:
    few, many = starts(arm, 7), starts(arm, 40)
    assert np.array(few).tolist() == np.array(many[:7]).tolist()


def feature(plain: PlainArm, q: Vector) -> Vector:
    """What nearness is measured by: position [m] and 0.3 times the rotation matrix."""
    position, R = plain.tool(q)
    return np.concatenate([position, 0.3 * R.ravel()])


def away(plain: PlainArm, rows: Matrix, q_target: Vector) -> Vector:
    there = feature(plain, q_target)
    return np.array([np.linalg.norm(feature(plain, q) - there) for q in rows])


def order_of(
    arm: Arm, q_target: Vector, q_seed: Vector, *, near: int, seed_first: bool = True
) -> list[Vector]:
    """Every start of a search over 50 configurations that finds nothing."""
    script = Script(answers=[off(arm, 1.0)])
    solver = MultiStart(
        solver=script, library=50, near=near, max_restarts=500, seed_first=seed_first
    )
    result = solver.solve(arm, arm.pose(q_target), q_seed)
    assert result.restarts == len(script.seeds) - 1
    return script.seeds


@pytest.mark.parametrize("near", [1, 2, 10, 49, 50, 70])
def test_the_seed_goes_first_then_the_nearest_then_the_rest_each_once(
    arm: Arm, plain: PlainArm, near: int
) -> None:
    library = spread(plain.q_min, plain.q_max, 50)
    places = {q.tobytes(): k for k, q in enumerate(library)}
    q_target, q_seed = plain.at(np.full(8, 0.35)), off(arm, 0.3)
    seeds = order_of(arm, q_target, q_seed, near=near)
    assert seeds[0].tolist() == q_seed.tolist()
    order = [places[q.tobytes()] for q in seeds[1:]]
    assert sorted(order) == list(range(50))
    nearest = np.argsort(away(plain, library, q_target))
    assert order[:near] == nearest[:near].tolist()
    assert order[near:] == sorted(nearest[near:].tolist())


def test_without_the_seed_first_it_takes_its_place_only_where_it_is_the_nearest(
    arm: Arm, plain: PlainArm
) -> None:
    library = spread(plain.q_min, plain.q_max, 50)
    q_target = plain.at(np.full(8, 0.35))
    distances = away(plain, library, q_target)
    direction = np.where(np.arange(arm.n) % 2, 1.0, -1.0)
    close, far = q_target + 0.01 * direction, q_target + 1.0 * direction
    assert away(plain, np.array([close]), q_target)[0] < distances.min()
    assert away(plain, np.array([far]), q_target)[0] > distances.min()
    usual = order_of(arm, q_target, close, near=10)[1:]
    with_close = order_of(arm, q_target, close, near=10, seed_first=False)
    assert with_close[0].tolist() == close.tolist()
    assert np.array(with_close[1:]).tolist() == np.array(usual).tolist()
    with_far = order_of(arm, q_target, far, near=10, seed_first=False)
    assert np.array(with_far).tolist() == np.array(usual).tolist()


def test_a_target_that_is_no_pose_has_the_seed_alone(arm: Arm) -> None:
    for seed_first in (True, False):
        solver = MultiStart(solver=QpIk(), seed_first=seed_first)
        result = solver.solve(arm, SE3(np.full(7, np.nan)), off(arm, 0.2))
        assert result.reason is Reason.INVALID_TARGET
        assert result.q.tolist() == off(arm, 0.2).tolist()
        assert result.restarts == 0


@pytest.mark.parametrize("count", [0, 1, 2, 17, 49])
def test_the_budget_is_spent_and_not_passed(arm: Arm, count: int) -> None:
    for seed_first in (True, False):
        script = Script(answers=[off(arm, 1.0)])
        solver = MultiStart(
            solver=script, library=50, near=5, max_restarts=count, seed_first=seed_first
        )
        result = solver.solve(arm, arm.pose(arm.home), off(arm, 2.0))
        assert len(script.seeds) == count + 1
        assert (result.restarts, result.iterations) == (count, 3 * (count + 1))


def test_several_answers_differ_and_the_preferred_one_is_first(arm: Arm, plain: PlainArm) -> None:
    rng = np.random.default_rng(4)
    most = 0
    for _ in range(12):
        target = arm.pose(rng.uniform(plain.at(np.full(8, 0.2)), plain.at(np.full(8, 0.8))))
        q_seed = rng.uniform(plain.q_min, plain.q_max)
        inner = LmIk(max_iterations=20, stall=Stall())
        solver = MultiStart(solver=inner, answers=4, apart=0.4, max_restarts=40)
        found = solver.solve_all(arm, target, q_seed)
        assert 1 <= len(found) <= 4
        for k, result in enumerate(found):
            assert result.converged
            assert plain.inside(result.q)
            assert max(plain.errors(result.q, target)) < 1.1e-6
            for other in found[:k]:
                assert np.abs(result.q - other.q).max() > 0.4
        assert Preference().ranked(arm, found, q_seed) == found
        assert solver.solve(arm, target, q_seed).q.tolist() == found[0].q.tolist()
        assert len({(r.iterations, r.restarts, r.seconds) for r in found}) == 1
        # Which one is preferred is up to the weights.
        roomy = replace(solver, preference=Preference(seed=0.0, limits=1.0, manipulability=0.0))
        best = roomy.solve(arm, target, q_seed).q
        rooms = [np.minimum(r.q - plain.q_min, plain.q_max - r.q) for r in found]
        shares = [(room / (plain.q_max - plain.q_min)).min() for room in rooms]
        assert best.tolist() == found[int(np.argmax(shares))].q.tolist()
        most = max(most, len(found))
    assert most == 4


def along_the_null_space(arm: Arm, plain: PlainArm) -> list[Vector]:
    """Answers to one target that lie ever further apart."""
    q, target = arm.home.copy(), arm.pose(arm.home)
    answers = [q.copy()]
    for _ in range(60):
        still = np.linalg.svd(plain.jacobian(q))[2][-1]
        q = q + 0.02 * still * np.sign(still[0])
        end = QpIk(posture_cost=1e-3).solve(arm, target, q)
        assert end.converged
        q = end.q
        answers.append(q.copy())
    return answers


def test_answers_that_are_alike_are_one(arm: Arm, plain: PlainArm) -> None:
    """Each one taken differs by more than `apart` in some joint from all taken before."""
    answers = along_the_null_space(arm, plain)
    script = Script(answers=[*answers, off(arm, 1.0)])
    solver = MultiStart(solver=script, answers=50, apart=0.3, max_restarts=80)
    found = solver.solve_all(arm, arm.pose(arm.home), arm.home)
    expected: list[Vector] = []
    for q in answers:
        if all(np.abs(q - other).max() > 0.3 for other in expected):
            expected.append(q)
    assert len(expected) >= 3
    assert sorted(r.q.tolist() for r in found) == sorted(q.tolist() for q in expected)
    assert {(r.restarts, r.iterations) for r in found} == {(80, 243)}


@pytest.mark.parametrize("answers", [1, 2, 3])
def test_it_stops_once_there_are_as_many_answers_as_asked_for(
    arm: Arm, plain: PlainArm, answers: int
) -> None:
    ways = along_the_null_space(arm, plain)
    apart = [ways[0], ways[30], ways[60]]
    assert np.abs(ways[30] - ways[0]).max() > 0.3
    assert np.abs(ways[60] - ways[30]).max() > 0.3
    script = Script(answers=[off(arm, 1.0), *apart, off(arm, 1.0)])
    solver = MultiStart(solver=script, answers=answers)
    found = solver.solve_all(arm, arm.pose(arm.home), arm.home)
    assert sorted(r.q.tolist() for r in found) == sorted(q.tolist() for q in apart[:answers])
    assert len(script.seeds) == answers + 1
    assert all(r.restarts == answers for r in found)


def test_where_there_is_no_answer_there_is_one_result_with_its_reason(arm: Arm) -> None:
    script = Script(answers=[off(arm, 1.0)])
    solver = MultiStart(solver=script, answers=3, max_restarts=4)
    (result,) = solver.solve_all(arm, arm.pose(arm.home), arm.home)
    assert result.reason is Reason.NOT_CONVERGED
    assert result.explanation.startswith("the pose is within reach, but ")
    assert result.explanation.endswith(" from 5 starts")
    assert result.restarts == 4


@pytest.mark.parametrize(
    ("name", "least"), [("max_restarts", 0), ("library", 1), ("near", 1), ("answers", 1)]
)
def test_counts_that_are_too_small_are_refused(name: str, least: int) -> None:
    usual = MultiStart(solver=QpIk())
    few: dict[str, Any] = {name: least - 1}
    with pytest.raises(
        InvalidValueError,
        match=rf"^{name} must be a whole number, {least} or more;",
    ):
        replace(usual, **few)
    enough: dict[str, Any] = {name: least}
    assert getattr(replace(usual, **enough), name) == least


def test_the_time_is_that_of_all_starts(arm: Arm) -> None:
    script = Script(answers=[off(arm, 1.0)])
    result = MultiStart(solver=script, max_restarts=2).solve(arm, arm.pose(arm.home), arm.home)
    assert 0.0 <= result.seconds < 50.0


def test_the_tolerance_is_that_of_the_solver() -> None:
    tolerance = Tolerance(position=1e-4, orientation=2e-3)
    assert MultiStart(solver=DlsIk(tolerance=tolerance)).tolerance == tolerance
    nested = MultiStart(solver=MultiStart(solver=DlsIk(tolerance=tolerance)))
    assert nested.tolerance == tolerance


def test_with_restarts_every_target_inside_the_limits_is_reached(arm: Arm, plain: PlainArm) -> None:
    rng = np.random.default_rng(8)
    solver = MultiStart(solver=QpIk())
    restarted = 0
    for _ in range(80):
        target = arm.pose(rng.uniform(plain.q_min, plain.q_max))
        result = solver.solve(arm, target, arm.home)
        assert result.converged, result.explanation
        assert plain.inside(result.q)
        assert max(plain.errors(result.q, target)) < 1.1e-6
        restarted += result.restarts > 0
    assert restarted > 0


@pytest.mark.parametrize("name", ["fused", "fast"])
def test_all_of_two_thousand_poses_near_joint_limits_are_reached(name: str) -> None:
    """With 100 restarts, two or four of them were not."""
    arm, solver = arm_of("panda"), solvers()[name]
    targets = near_limits(arm, 2000, np.random.default_rng([0, 0, *b"near_limits"]))
    results = [solver.solve(arm, target, arm.home) for target in targets.targets]
    assert all(result.converged for result in results)
    far = [arm.pose_distance(t, r.q) for t, r in zip(targets.targets, results, strict=True)]
    assert np.max(far) <= 1e-6
    assert max(result.restarts for result in results) > 112


@pytest.mark.parametrize("kind", [LmIk, QpIk, MinkIk])
@pytest.mark.parametrize("chosen", ["compiled", "numpy"])
def test_joints_that_move_no_tool_stay_where_they_are(
    kind: type[LmIk | QpIk | MinkIk], chosen: str, tmp_path: Path
) -> None:
    """Also if the library was written for a robot whose head stands elsewhere at home."""
    body = """<body name="head" pos="-0.3 0 1"><joint name="pan" axis="0 0 1" range="-1.5 1.5"/>
      <geom size="0.05"/></body></worldbody>"""
    file = tmp_path / "panda_head.xml"
    file.write_text(PANDA.mjcf.read_text().replace("</worldbody>", body), encoding="utf-8")
    rng, restarted = np.random.default_rng(0), 0
    with using(chosen):
        for head in (0.0, -1.2):
            joints, home = [*PANDA.joints, "pan"], [*PANDA.home, head]
            arm = Arm(robot_from_mjcf(file, tcp="tcp", home=home, joints=joints))
            solver = MultiStart(solver=kind(max_iterations=30, stall=Stall()))
            # Where its home has it, whoever wrote the file first.
            assert library_of(arm, solver.library).q[0, 7] == head
            for _ in range(12):
                target, q_seed = arm.pose(arm.drawn(rng)), np.array([*PANDA.home, 0.7])
                found = solver.solve(arm, target, q_seed)
                restarted += found.converged and found.restarts > 0
                assert found.q[7] == 0.7
    assert restarted > 3
