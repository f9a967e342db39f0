"""Gains of an observer against scipy's placement of poles."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from robo47_qp.control.pole_placement import observer_gains


@given(st.floats(1e-3, 0.4), st.floats(-0.95, -0.3), st.floats(0.1, 0.95), st.floats(2e-4, 4e-3))
def test_gains_are_those_of_scipy_to_the_bit(
    omega_dt: float, real: float, imaginary: float, dt: float
) -> None:
    # Imported here, where it is used: that takes as long as a hundred tests.
    from scipy.signal import place_poles

    F, H = np.array([[1, dt, dt * dt], [0, 1, dt], [0, 0, 1]]), np.array([[1.0, 0.0, 0.0]])
    pair = complex(np.exp(omega_dt * complex(real, imaginary)))
    alone = float(np.exp(-omega_dt))
    gains = observer_gains(F, H @ F, (alone, pair))
    expected = place_poles(F.T, (H @ F).T, [alone, pair, pair.conjugate()]).gain_matrix[0].real
    np.testing.assert_array_equal(gains, expected)
    found = np.linalg.eigvals(F - np.outer(gains, H @ F))
    for pole in (alone, pair, pair.conjugate()):
        assert np.abs(found - pole).min() < 1e-6
