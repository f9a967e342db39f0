"""How fast pairs of geoms close."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.levers import moved_by


class Closing:
    """Rates of the pairs of one model, from the joint axes of its state."""

    def __init__(
        self, m: mujoco.MjModel, data: mujoco.MjData, pairs: tuple[tuple[int, int], ...]
    ) -> None:
        """Look at pairs of geoms; `data` is brought up to date by `mj_comPos` before `rates`."""
        bodies = m.geom_bodyid[np.array(pairs)]
        moves = moved_by(m)
        self._sign = moves[bodies[:, 0]] - moves[bodies[:, 1]]
        self._centre: Vector = data.subtree_com[m.body_rootid[m.jnt_bodyid[0]]]
        self._twists: Matrix = data.cdof
        self._skew = _skew()
        self._p = np.ones((len(pairs), 4))
        self._products = np.zeros((len(pairs), 3, 4))

    def rates(self, pair: NDArray[np.intp], distance: Vector, segment: Matrix) -> Matrix:
        """How fast pairs close per joint (k, n): n . (J_a - J_b), n from the first to the second.

        MuJoCo's `cdof` holds the twist (w, v) of each joint about the centre of mass c: it moves
        a point p along n by n . (v + w x (p - c)) = Σ_ik n_i S_ik (p - c, 1)_k with
        S = ([w]×, v). The two nearest points lie on one line along n, so either will do for both
        Jacobians.

        Args:
            pair: Which of the pairs (k,).
            distance: Their signed distances, none of them zero (k,) [m].
            segment: Nearest points on the first and the second geom of each (k, 6) [m].
        """
        k = len(pair)
        p, products = self._p[:k], self._products[:k]
        n = segment[:, 3:] - segment[:, :3]
        n /= distance[:, None]
        np.subtract(segment[:, :3], self._centre, out=p[:, :3])
        np.multiply(n[:, :, None], p[:, None, :], out=products)
        out: Matrix = products.reshape(k, 12) @ (self._skew @ self._twists.T)
        out *= self._sign.take(pair, axis=0)
        return out


def _skew() -> Matrix:
    """Maps (w, v) to ([w]×, v), row by row (12, 6)."""
    out = np.zeros((3, 4, 6))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i, k, j], out[i, j, k], out[i, 3, 3 + i] = 1.0, -1.0, 1.0
    return out.reshape(12, 6)
