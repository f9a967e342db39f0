"""Gains of an observer that give its error the poles asked for."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from robo47_qp.arrays import Matrix, Vector


def observer_gains(F: Matrix, H: Matrix, poles: tuple[float, complex]) -> Vector:
    """Return G (3,) for which F - G H has a real pole and a complex pair.

    By the eigenvectors of the dual problem (Kautsky, Nichols and van Dooren, "Robust pole
    assignment in linear state feedback", Int. J. Control 41, 1985), of which one output leaves no
    choice. The same to the bit as `scipy.signal.place_poles`, whose import takes a third of a
    second.

    Args:
        F: Transition of the state (3, 3).
        H: What is measured of it (1, 3).
        poles: The real one, and one of the pair.
    """
    A, B = F.T, H.T
    real, one = poles[0], complex(poles[1])
    first = one if one.imag < 0.0 else one.conjugate()
    ordered = np.array([real, first, first.conjugate()])
    u, z = qr(B)
    alone, pair = (_eigenvector(u, A, pole) for pole in ordered[:2])
    X: NDArray[np.complex128] = np.column_stack([alone, pair.conjugate(), pair])
    m = np.linalg.solve(X.T, np.dot(np.diag(ordered), X.T)).T
    gains: Vector = -np.linalg.solve(z[:1], np.dot(u[:, :1].T, m - A))[0].real
    return gains


def _eigenvector(u: Matrix, A: Matrix, pole: complex) -> NDArray[np.complex128]:
    """Return a unit vector x with (A - pole) x in the span of the input, by its basis u."""
    space = np.dot(u[:, 1:].T, A - pole * np.eye(3)).T
    Q, _ = qr(space)
    x: NDArray[np.complex128] = np.sum(Q[:, 2:], axis=1)
    return x / np.linalg.norm(x)
