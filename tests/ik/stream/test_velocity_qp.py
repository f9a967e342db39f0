"""What gives way, and in which order: joint bounds never, near pairs last."""

import numpy as np
import pytest
from scipy.optimize import minimize

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import UnknownNameError
from robo47_qp.ik.stream.clearance_bounds import VelocityRows
from robo47_qp.ik.stream.joint_bounds import VelocityBox
from robo47_qp.ik.stream.settings import Event
from robo47_qp.ik.stream.velocity_qp import VelocityQp

N = 4


def box(low: float = -1.0, high: float = 1.0) -> VelocityBox:
    return VelocityBox(low=np.full(N, low), high=np.full(N, high), recovering=False)


def rows(A: Matrix, upper: Vector, room: float | Vector = 0.05) -> VelocityRows:
    return VelocityRows(A, upper, np.broadcast_to(room, upper.shape), np.arange(len(upper)))


def test_it_is_the_closest_velocity_that_may_be_had(rng: np.random.Generator) -> None:
    qp, active = VelocityQp("daqp", N), 0
    for _ in range(25):
        M = rng.normal(size=(6, N))
        H, v_ref = M.T @ M + 1e-2 * np.eye(N), rng.normal(size=N)
        A, upper = rng.normal(size=(3, N)), rng.uniform(0.0, 0.5, 3)
        v, told = qp.nearest(H, v_ref, box(), rows(A, upper))
        expected = minimize(
            lambda x, H=H, r=v_ref: 0.5 * (x - r) @ H @ (x - r),
            np.zeros(N),
            jac=lambda x, H=H, r=v_ref: H @ (x - r),
            bounds=[(-1.0, 1.0)] * N,
            constraints={"type": "ineq", "fun": lambda x, A=A, b=upper: b - A @ x},
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 500},
        )
        assert told is None
        np.testing.assert_allclose(v, expected.x, atol=1e-5)
        active += bool((A @ v_ref > upper).any())
    assert active > 10


def test_what_may_be_had_is_had_to_the_bit() -> None:
    v_ref = np.array([0.1, -0.2, 0.3, 0.0])
    qp = VelocityQp("daqp", N)
    free = rows(np.ones((1, N)), np.array([0.5]))
    assert (qp.nearest(np.eye(N), v_ref, box(), free)[0] == v_ref).all()
    assert (qp.nearest(np.eye(N), v_ref, box(), None)[0] == v_ref).all()


def test_without_rows_the_box_alone_decides() -> None:
    none = rows(np.zeros((0, N)), np.zeros(0))
    for given in (None, none):
        v, told = VelocityQp("daqp", N).nearest(np.eye(N), np.array([3.0, 0, -3, 0]), box(), given)
        assert v.tolist() == [1.0, 0.0, -1.0, 0.0]
        assert told is None


def test_rows_give_way_to_the_box_and_it_is_told() -> None:
    """The pair has to part at 2 m/s, the joints can do 1 m/s: they do all they can."""
    A = np.array([[1.0, 0.0, 0.0, 0.0]])
    v, told = VelocityQp("daqp", N).nearest(
        np.eye(N), np.array([1.0, 0.5, 0, 0]), box(), rows(A, np.array([-2.0]))
    )
    assert told is Event.CLEARANCE_RELAXED
    assert v[0] == pytest.approx(-1.0, abs=1e-3)
    assert v[1] == pytest.approx(0.5, abs=1e-6)


def test_of_two_pairs_the_one_with_more_room_gives_way_first() -> None:
    """Between two walls, each of which asks to be left at 0.3 m/s."""
    A = np.array([[1.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0]])
    upper, qp = np.array([-0.3, -0.3]), VelocityQp("daqp", N)
    near_first, told = qp.nearest(
        np.eye(N), np.zeros(N), box(), rows(A, upper, np.array([0.0, 0.05]))
    )
    assert told is Event.CLEARANCE_RELAXED
    assert near_first[0] < -0.2
    even, _ = qp.nearest(np.eye(N), np.zeros(N), box(), rows(A, upper, 0.01))
    assert even[0] == pytest.approx(0.0, abs=1e-3)


def test_the_box_holds_to_the_bit_whatever_is_asked(rng: np.random.Generator) -> None:
    qp = VelocityQp("daqp", N)
    for _ in range(300):
        low = rng.uniform(-1.0, 0.5, N)
        limits = VelocityBox(low=low, high=low + rng.uniform(0.0, 0.02, N), recovering=False)
        k = int(rng.integers(1, 12))
        wall = rows(rng.normal(size=(k, N)), rng.normal(size=k), rng.uniform(-0.01, 0.1, k))
        v, told = qp.nearest(np.eye(N), 10 * rng.normal(size=N), limits, wall)
        assert (v >= limits.low).all()
        assert (v <= limits.high).all()
        assert told in (None, Event.CLEARANCE_RELAXED)


def test_where_the_solver_fails_the_arm_brakes_and_it_is_told() -> None:
    limits = VelocityBox(low=np.full(N, 0.2), high=np.full(N, 0.4), recovering=False)
    v, told = VelocityQp("daqp", N).nearest(np.eye(N), np.full(N, np.nan), limits, None)
    assert told is Event.NO_ANSWER
    assert v.tolist() == [0.2] * N


def test_an_unknown_solver_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="No QP solver is called 'nosuch'"):
        VelocityQp("nosuch", N)
