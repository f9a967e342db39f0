"""The damped inverse against numpy's own, and its bound at singularities."""

import numpy as np
import pytest

from robo47_qp.ik.stream.target_velocity import DampedInverse


@pytest.mark.parametrize("shape", [(6, 7), (6, 6)])
def test_far_from_singularities_it_is_the_pseudo_inverse(
    shape: tuple[int, int], rng: np.random.Generator
) -> None:
    for _ in range(20):
        J = rng.normal(size=shape)
        twist, v = rng.normal(size=6), rng.normal(size=shape[1])
        inverse = DampedInverse(J, 1e-4)
        np.testing.assert_allclose(inverse.velocities(twist), np.linalg.pinv(J) @ twist, rtol=1e-7)
        np.testing.assert_allclose(
            inverse.null(v), v - np.linalg.pinv(J) @ J @ v, rtol=1e-6, atol=1e-9
        )


def test_on_the_way_into_a_singularity_it_stays_bounded(rng: np.random.Generator) -> None:
    U, _, Vt = np.linalg.svd(rng.normal(size=(6, 7)), full_matrices=False)
    threshold = 0.05
    gains = []
    for smallest in (0.06, 0.05, 0.03, 0.01, 1e-4, 1e-12, 0.0):
        sigma = np.array([1.0, 0.8, 0.6, 0.4, 0.2, smallest])
        inverse = DampedInverse((U * sigma) @ Vt, threshold)
        gains.append(np.linalg.norm(inverse.velocities(U[:, 5])))
        # Directions that are not nearly lost are inverted exactly.
        np.testing.assert_allclose(inverse.velocities(U[:, 4]), Vt[4] / 0.2, rtol=1e-6, atol=1e-7)
    assert gains[0] == pytest.approx(1 / 0.06)
    assert gains[1] == pytest.approx(1 / 0.05)
    assert max(gains) <= 2 / threshold
    assert gains[-1] == pytest.approx(0.0, abs=1e-5)
    assert np.isfinite(gains).all()


def test_null_motion_leaves_the_tool_at_rest_near_singularities_too(
    rng: np.random.Generator,
) -> None:
    U, _, Vt = np.linalg.svd(rng.normal(size=(6, 7)), full_matrices=False)
    for smallest in (0.5, 0.02, 1e-4):
        J = (U * np.array([1.0, 0.8, 0.6, 0.4, 0.2, smallest])) @ Vt
        v = DampedInverse(J, 0.05).null(rng.normal(size=7))
        assert np.linalg.norm(J @ v) < 1e-10
        assert np.linalg.norm(v) > 0.01


def test_a_robot_with_fewer_joints_than_the_tool_has_directions(rng: np.random.Generator) -> None:
    J = rng.normal(size=(6, 4))
    v = rng.normal(size=4)
    inverse = DampedInverse(J, 1e-4)
    np.testing.assert_allclose(inverse.velocities(J @ v), v, rtol=1e-6)
    np.testing.assert_allclose(inverse.null(v), np.zeros(4), atol=1e-9)


def test_no_motion_at_all_is_no_division_by_zero() -> None:
    inverse = DampedInverse(np.zeros((6, 3)), 0.05)
    assert (inverse.velocities(np.ones(6)) == 0.0).all()


def test_around_the_threshold_it_is_what_singular_values_say(rng: np.random.Generator) -> None:
    """By singular values one by one: where some are damped, where none is, and in between."""
    threshold = 0.05
    for smallest in np.geomspace(0.005, 0.5, 60):
        U, _, Vt = np.linalg.svd(rng.normal(size=(6, 7)), full_matrices=False)
        sigma = 3.0 * np.array([1.0, 0.9, 0.8, 0.5, 0.3, smallest])
        zero = threshold * sigma[0]
        damping = np.maximum(zero**2 - sigma**2, 0.0) ** 2 / (4.0 * zero**2)
        expected = Vt.T @ np.diag(sigma / (sigma**2 + damping)) @ U.T
        inverse = DampedInverse((U * sigma) @ Vt, threshold)
        told = np.column_stack([inverse.velocities(twist) for twist in np.eye(6)])
        np.testing.assert_allclose(told, expected, atol=1e-8)
        v = rng.normal(size=7)
        np.testing.assert_allclose(inverse.null(v), v - Vt.T @ (Vt @ v), atol=1e-9)
