from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from mink import SE3

from robo47_qp.arm import Arm
from robo47_qp.arrays import Vector
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import IkResult, Reason, Tolerance, judged
from tests.plain_arm import PlainArm


@dataclass(frozen=True, kw_only=True, eq=False)
class Script:
    """A solver that answers from a list and remembers where it was started."""

    answers: list[Vector]
    seeds: list[Vector] = field(default_factory=list)
    tolerance: Tolerance = Tolerance()

    def solve(self, arm: Arm, T_world_target: SE3, q_seed: Vector) -> IkResult:
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
