"""Objectives of a user: at their best without spoiling what comes before them."""

from collections.abc import Callable

import mink
import numpy as np
import pytest
from mink import SE3
from scipy.optimize import minimize

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.objectives import Objective
from robo47_qp.ik.solver import Reason, Tolerance
from robo47_qp.ik.tool_demand import FULL, POSITION, FreeAxis, ToolDemand
from tests.composed import ARM, elbow_at, left, several, somewhere, tasks


def best_by_brute_force(
    target: SE3, q: Vector, value: Callable[[Vector], float], demand: ToolDemand
) -> float:
    """The least value on the pose, near q: scipy's SLSQP with the pose as an equality."""
    rows = np.abs(demand.jacobian(ARM, target, q)).max(axis=1) > 1e-12
    found = minimize(
        value,
        q,
        constraints={"type": "eq", "fun": lambda x: demand.error(ARM, target, x)[rows]},
        bounds=list(zip(ARM.q_min, ARM.q_max, strict=True)),
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 300},
    )
    assert max(demand.distance(ARM, target, found.x)) < 1e-5
    return float(found.fun)


@pytest.mark.parametrize("demand", [FULL, FreeAxis()], ids=repr)
def test_a_lasting_objective_is_at_its_best_and_does_not_spoil_the_pose(
    demand: ToolDemand,
) -> None:
    rng = np.random.default_rng(6)
    moved = 0
    for _ in range(6):
        q, q_wanted = somewhere(rng, 0.2), somewhere(rng, 0.2)
        target = ARM.pose(q)
        plain = MinkIk(tolerance=Tolerance(demand=demand))
        ik = plain.composed([elbow_at(q_wanted)])
        result = ik.solve(ARM, target, q)
        assert result.converged
        assert max(left(demand, result.q, target)) < 1e-6

        def value(x: Vector, q_wanted: Vector = q_wanted) -> float:
            return 0.5 * float((x - q_wanted) @ (x - q_wanted))

        best = best_by_brute_force(target, result.q, value, demand)
        assert value(result.q) <= best + 1e-6
        moved += value(q) > value(result.q) + 0.1
    assert moved >= 3


def test_along_the_whole_null_space_no_configuration_nearby_is_better() -> None:
    """The self-motion of the Panda, followed by small steps of an integrator, both ways."""
    rng = np.random.default_rng(7)
    q, q_wanted = somewhere(rng, 0.25), somewhere(rng, 0.25)
    target = ARM.pose(q)
    result = MinkIk(objectives=[elbow_at(q_wanted)]).solve(ARM, target, q)
    assert result.converged
    least = float(np.sum((result.q - q_wanted) ** 2))
    for sign in (-1.0, 1.0):
        x, way = result.q.copy(), sign * np.linalg.svd(ARM.jacobian(result.q))[2][-1]
        for _ in range(100):
            free = np.linalg.svd(ARM.jacobian(x))[2][-1]
            way = free * np.sign(free @ way)
            x = x + 2e-3 * way
            for _ in range(3):
                x = x + np.linalg.lstsq(ARM.jacobian(x), ARM.pose_error(target, x))[0]
            if not ((x >= ARM.q_min) & (x <= ARM.q_max)).all():
                break
            assert np.sum((x - q_wanted) ** 2) >= least - 1e-9


def test_levels_do_not_spoil_those_before() -> None:
    """Pointing at priority 1 is exact, and a posture at priority 2 gets what is left."""
    rng = np.random.default_rng(8)
    for _ in range(4):
        q = somewhere(rng, 0.25)
        target = ARM.pose(q)
        first, second = somewhere(rng, 0.25), somewhere(rng, 0.25)
        asked = Tolerance(demand=POSITION)
        one = mink.PostureTask(ARM.model, cost=[1.0, 1.0, 0, 0, 0, 0, 0])
        one.set_target(first)
        alone = MinkIk(tolerance=asked, objectives=[one]).solve(ARM, target, q)
        both = MinkIk(
            tolerance=asked, objectives=[Objective(one, 1), Objective(elbow_at(second), 2)]
        ).solve(ARM, target, q)
        assert alone.converged
        assert both.converged
        far = [np.sum((result.q - first)[:2] ** 2) for result in (alone, both)]
        assert far[1] <= far[0] + 1e-5
        assert np.sum((both.q - second) ** 2) <= np.sum((alone.q - second) ** 2) + 1e-5


@pytest.mark.parametrize("name", tasks())
@pytest.mark.parametrize("priority", [0, 1])
def test_each_task_of_mink_runs(name: str, priority: int) -> None:
    make = tasks()[name]
    rng = np.random.default_rng(9)
    objective = Objective(make, priority)
    for _ in range(3):
        q = somewhere(rng, 0.2)
        target = ARM.pose(q)
        plain = MinkIk().solve(ARM, target, q + 0.05)
        result = MinkIk(objectives=[objective]).solve(ARM, target, q + 0.05)
        if priority:
            assert result.converged, result.explanation
            task = make(ARM)
            if isinstance(task, mink.Task):
                before, after = (
                    float(
                        np.linalg.norm(
                            task.cost * task.compute_error(mink.Configuration(ARM.model, q=x))
                        )
                    )
                    for x in (plain.q, result.q)
                )
                assert after <= before + 1e-6
        elif not result.converged:
            assert result.explanation


def test_objectives_that_pull_at_the_same_priority_are_named() -> None:
    ik = several(objectives=[Objective(elbow_at(ARM.home + 0.3), priority=0)])
    result = ik.solve(ARM, ARM.pose(ARM.home - 0.2), ARM.home)
    assert result.reason is not None
    assert "PostureTask (error" in result.explanation
    assert "which pulls at the same priority" in result.explanation


def test_an_objective_with_a_tolerance_has_to_be_reached() -> None:
    rng = np.random.default_rng(10)
    q = somewhere(rng, 0.3)

    class Third(mink.Task):
        """The third joint, at an angle."""

        def __init__(self, angle: float) -> None:
            super().__init__(np.ones(1))
            self.angle = angle

        def compute_error(self, configuration: mink.Configuration) -> Vector:
            return np.array([configuration.q[2] - self.angle])

        def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
            return np.eye(1, 7, 2)

    reached = several(objectives=[Objective(Third(q[2]), 1, 1e-6)]).solve(
        ARM, ARM.pose(q), ARM.home
    )
    assert reached.converged, reached.explanation
    assert reached.q[2] == pytest.approx(q[2], abs=1e-6)
    # Within its tolerance it counts as reached, though another pulls it away.
    both = [Objective(Third(q[2] + off), 1, 0.2) for off in (0.1, -0.1)]
    near = several(objectives=both).solve(ARM, ARM.pose(q), ARM.home)
    assert near.converged, near.explanation
    assert abs(near.q[2] - q[2]) < 0.1
    alone = MinkIk(objectives=both, stall=None).solve(ARM, ARM.pose(q), near.q + 0.05)
    assert alone.converged
    assert alone.iterations < MinkIk().max_iterations
    impossible = several(objectives=[Objective(Third(9.0), 1, 1e-6)])
    result = impossible.solve(ARM, ARM.pose(q), ARM.home)
    assert result.reason is Reason.NOT_CONVERGED
    assert "the pose is reached, but not Third (error" in result.explanation
