"""Searches that need not be judged: the same ends as those that are, counted the same way."""

from dataclasses import dataclass, fields, replace

import numpy as np
import pytest
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import (
    EarlyStopping,
    IkResult,
    IkSolver,
    Reason,
    Tolerance,
    Unconverged,
    attempts_of,
    judged,
)
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.tool_poses import Target

ARM = Arm(PANDA)
INNER: dict[str, LmIk | QpIk] = {
    "lm": LmIk(max_iterations=30, stall=Stall()),
    "lm by position": LmIk(position_only=True, max_iterations=6, stall=Stall()),
    "qp": QpIk(max_iterations=30, stall=Stall()),
    "clear": QpIk(max_iterations=30, stall=Stall(), clearance=0.01),
}


@dataclass(frozen=True, kw_only=True)
class Judging:
    """The same solver for those who know nothing but the protocol."""

    inside: LmIk | QpIk

    @property
    def tolerance(self) -> Tolerance:
        return self.inside.tolerance

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        return self.inside.solve(arm, T_world_target, q_seed)

    def thorough(self) -> IkSolver:
        return Judging(inside=self.inside.thorough())


def targets(count: int) -> list[SE3]:
    """Reachable ones, ones beyond the limits, and one far away."""
    rng = np.random.default_rng(11)
    q = rng.uniform(ARM.q_min, ARM.q_max, (count, ARM.n))
    q[::4] += rng.uniform(0.3, 1.0, q[::4].shape)
    return [*(ARM.pose(one) for one in q), SE3.from_translation(np.array([0.0, 0.0, 9.0]))]


def told(result: IkResult) -> dict[str, str]:
    """All but the time, to the last digit."""
    names = {field.name for field in fields(result)} - {"seconds", "q"}
    return {name: repr(getattr(result, name)) for name in names} | {"q": str(result.q.tolist())}


@pytest.mark.parametrize("inner", INNER.values(), ids=INNER)
def test_a_miss_is_a_failure_that_was_not_judged(inner: LmIk | QpIk) -> None:
    missed = 0
    rng = np.random.default_rng(5)
    for target in targets(40):
        q_start = rng.uniform(ARM.q_min, ARM.q_max)
        end = attempts_of(inner, ARM, target)(q_start)
        result = inner.solve(ARM, target, q_start)
        assert end.q.tolist() == result.q.tolist()
        assert end.iterations == result.iterations
        assert end.error == pytest.approx(result.error, rel=1e-5)
        if isinstance(end, IkResult):
            assert told(end) == told(result)
        else:
            assert result.reason is Reason.NOT_CONVERGED
            missed += 1
    assert missed >= 3


def test_a_miss_keeps_its_configuration() -> None:
    attempt = attempts_of(LmIk(max_iterations=1), ARM, targets(3)[1])
    first = attempt(ARM.home)
    kept = first.q.tolist()
    assert isinstance(first, Unconverged)
    attempt(ARM.q_min)
    assert first.q.tolist() == kept


@pytest.mark.parametrize("inner", INNER.values(), ids=INNER)
def test_restarts_come_to_the_same_without_judging_failures(inner: LmIk | QpIk) -> None:
    plain = Judging(inside=inner)
    assert isinstance(plain, EarlyStopping)
    assert not hasattr(plain, "attempts")
    reasons = set()
    for target in targets(28):
        one = MultiStart(solver=inner, max_restarts=22).solve(ARM, target, ARM.home)
        other = MultiStart(solver=plain, max_restarts=22).solve(ARM, target, ARM.home)
        assert told(one) == told(other)
        reasons.add(one.reason)
    assert {None, Reason.OUT_OF_REACH} <= reasons


def test_effort_is_all_that_changes_with_it() -> None:
    result = judged(ARM, ARM.pose(ARM.home), ARM.home, Tolerance(), 5)
    before = told(result)
    other = result.with_effort(iterations=7, restarts=3, seconds=0.5)
    assert told(other) == told(replace(result, iterations=7, restarts=3, seconds=0.5))
    assert other.seconds == 0.5
    assert told(result) == before
