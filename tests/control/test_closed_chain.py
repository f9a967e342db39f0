"""Two hands that hold one body: what they may do about disturbances."""

import numpy as np
import pytest
from mink import SE3
from scipy.optimize import LinearConstraint, minimize

from robo47_qp.arrays import Vector
from robo47_qp.control.closed_chain import ClosedChain
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda_pair import panda_pair

ARM = Arm(panda_pair())
BOTH = (0, 1)


def configuration(seed: int) -> Vector:
    return ARM.home + np.random.default_rng(seed).uniform(-0.4, 0.4, ARM.n)


def relative(q: Vector) -> SE3:
    return ARM.pose(q, 0).inverse() @ ARM.pose(q, 1)


def moved(q: Vector, v: Vector) -> Vector:
    """Rate of the relative pose of the hands, by differences (6,)."""
    h = 1e-6
    return (relative(q - h * v).inverse() @ relative(q + h * v)).log() / (2.0 * h)


@pytest.mark.parametrize("seed", range(5))
def test_what_goes_on_along_the_chain_keeps_the_hands_together(seed: int) -> None:
    q, d = configuration(seed), np.random.default_rng(seed).normal(size=ARM.n)
    along = ClosedChain.of(ARM, BOTH, q).along @ d
    assert np.abs(moved(q, d)).max() > 0.1
    np.testing.assert_allclose(moved(q, along), 0.0, atol=1e-7)
    assert np.linalg.norm(along) > 0.1


@pytest.mark.parametrize("seed", range(3))
def test_it_is_how_a_body_between_the_hands_would_let_them_accelerate(seed: int) -> None:
    """By Gauss's principle of least constraint, with the relative motion by differences."""
    q, d = configuration(seed), np.random.default_rng(seed).normal(size=ARM.n)
    M = ARM.mass_matrix(q)
    apart = np.column_stack([moved(q, column) for column in np.eye(ARM.n)])
    found = minimize(
        lambda a: 0.5 * (a - d) @ M @ (a - d),
        np.zeros(ARM.n),
        jac=lambda a: M @ (a - d),
        hess=lambda _: M,
        method="trust-constr",
        constraints=LinearConstraint(apart, 0.0, 0.0),
        options={"gtol": 1e-10, "xtol": 1e-14},
    )
    np.testing.assert_allclose(ClosedChain.of(ARM, BOTH, q).along @ d, found.x, atol=1e-6)


def test_a_force_between_the_hands_is_left_to_springs() -> None:
    """Equal and opposite at one point: it moves nothing, and is not followed in full."""
    q = configuration(7)
    p = 0.5 * (ARM.pose(q, 0).translation() + ARM.pose(q, 1).translation())
    force, tau = np.array([3.0, -5.0, 2.0]), np.zeros(ARM.n)
    for i, sign in zip(BOTH, (1.0, -1.0), strict=True):
        at = ARM.pose(q, i).inverse()
        wrench = np.append(force, np.cross(p - ARM.pose(q, i).translation(), force))
        R = at.rotation().as_matrix()
        tau += sign * ARM.jacobian(q, i).T @ np.append(R @ wrench[:3], R @ wrench[3:])
    d, chain = np.linalg.solve(ARM.mass_matrix(q), tau), ClosedChain.of(ARM, BOTH, q)
    np.testing.assert_allclose(chain.along @ d, 0.0, atol=1e-9 * np.abs(d).max())
    np.testing.assert_allclose(chain.shares @ d, 0.95 * d, rtol=1e-6, atol=1e-9)
