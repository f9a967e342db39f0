"""Least squares in a box: scipy's, to the bit."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.optimize

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.tool_demand import FULL
from robo47_qp.model.arm import Arm
from robo47_qp.motion.following.least_squares import Ending, least_squares
from tests.robots import robot_named

ENDING = Ending(step=1e-12, gain=1e-4, slope=1e-12, evaluations=60)


@pytest.mark.parametrize("name", ["panda", "hinge6", "slider6"])
def test_it_is_dogbox_of_scipy_to_the_bit(name: str, rng: np.random.Generator) -> None:
    """On poses near and far, from starts inside, on a side, and where several joints are at limits;
    with and without room for all evaluations."""
    arm, ends = Arm(robot_named(name)), set[int]()
    for k in range(60):
        q = rng.uniform(arm.q_min, arm.q_max)
        for i in rng.permutation(arm.n)[: k % 4]:
            q[i] = (arm.q_min, arm.q_max)[rng.integers(2)][i]
        target = arm.pose(q + rng.normal(size=arm.n) * (0.0, 0.003, 0.05, 0.2)[k // 2 % 4])

        def error(x: Vector, target: object = target) -> Vector:
            return FULL.error(arm, target, x)  # type: ignore[arg-type]

        def jacobian(x: Vector, target: object = target) -> Matrix:
            return -FULL.jacobian(arm, target, x)  # type: ignore[arg-type]

        low, high = np.maximum(arm.q_min, q - 0.1), np.minimum(arm.q_max, q + 0.1)
        start = q.copy() if k % 2 else rng.uniform(low, high)
        ending = ENDING._replace(evaluations=5 if k % 5 == 0 else 60)
        judge = scipys(error, jacobian, start, (low, high), ending)
        found = least_squares(error, jacobian, start, (low, high), ending)
        assert found.tobytes() == judge.x.tobytes()
        ends.add(judge.status)
    # It has run out of evaluations, had no slope left, and gained too little.
    assert {0, 1, 2} <= ends


def scipys(
    error: Callable[[Vector], Vector],
    jacobian: Callable[[Vector], Matrix],
    start: Vector,
    box: tuple[Vector, Vector],
    ending: Ending,
) -> Any:
    return scipy.optimize.least_squares(
        error,
        start,
        jac=jacobian,
        bounds=box,
        method="dogbox",
        xtol=ending.step,
        ftol=ending.gain,
        gtol=ending.slope,
        max_nfev=ending.evaluations,
    )


@pytest.mark.parametrize("start", [(0.0, 0.0), (0.005, -0.009), (-1.798, -1.234), (-1.9, 1.5)])
@pytest.mark.parametrize("evaluations", [4, 9, 60])
def test_steps_are_as_long_as_they_are_in_scipy(
    start: tuple[float, float], evaluations: int
) -> None:
    """In a wide box: steps grow and shrink along the valley of Rosenbrock's function."""

    def error(x: Vector) -> Vector:
        return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])

    def jacobian(x: Vector) -> Matrix:
        return np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])

    box = np.array([-2.0, -2.0]), np.array([2.0, 3.0])
    ending = ENDING._replace(evaluations=evaluations)
    found = least_squares(error, jacobian, np.array(start), box, ending)
    judge = scipys(error, jacobian, np.array(start), box, ending)
    assert found.tobytes() == judge.x.tobytes()


def test_what_does_not_move_is_left_where_it_is() -> None:
    """A column of zeros; the other end of the box is the answer."""
    J = np.array([[1.0, 0.0], [0.0, 0.0]])

    def error(x: Vector) -> Vector:
        return J @ x - [3.0, 0.0]

    box = np.zeros(2), np.array([2.0, 1.0])
    found = least_squares(error, lambda _: J, np.array([0.5, 0.25]), box, ENDING)
    assert found.tolist() == [2.0, 0.25]
