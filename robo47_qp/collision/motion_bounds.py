"""Rates at which joints change the distances of geoms, and bounds on them."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector


def approach_speed_bounds(m: mujoco.MjModel, pairs: tuple[tuple[int, int], ...]) -> Matrix:
    """Return L (pairs, n) with |d(q') - d(q)| <= L |q' - q| for the distance d of each pair.

    A joint that moves one geom of a pair changes their distance no faster than its lever arm,
    the distance from the joint to the far side of a geom. The nearest points lie on one line
    along the normal, so the geom with the shorter lever arm may be taken. Lengths along the
    links bound it in every configuration. A sliding joint has the bound 1.
    """
    moves = moved_by(m)
    ways = _ways(m)
    links, far = _links(m, ways), _far_sides(m)
    joint_body = m.jnt_bodyid
    # Later joints of its body move that against the axis of a joint.
    later = [ways[k + 1 : m.body_jntadr[b] + m.body_jntnum[b]] for k, b in enumerate(joint_body)]
    start = np.linalg.norm(m.jnt_pos, axis=1) + np.array([way.sum() for way in later])
    slides = m.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
    a, b = np.array(pairs, dtype=int).reshape(-1, 2).T
    one, other = m.geom_bodyid[a], m.geom_bodyid[b]
    reach = start + np.minimum(
        links[joint_body, one[:, None]] + far[a, None],
        links[joint_body, other[:, None]] + far[b, None],
    )
    bounds: Matrix = np.where(moves[one] != moves[other], np.where(slides, 1.0, reach), 0.0)
    return bounds


def moved_by(m: mujoco.MjModel) -> Matrix:
    """Return 1 where a joint moves a body, else 0 (bodies, n)."""
    moves = np.zeros((m.nbody, m.njnt))
    for body in range(1, m.nbody):
        moves[body] = moves[m.body_parentid[body]]
        first = m.body_jntadr[body]
        moves[body, first : first + m.body_jntnum[body]] = 1.0
    return moves


def _far_sides(m: mujoco.MjModel) -> Vector:
    """Return distances from body frames to the far side of each geom; planes are infinite [m]."""
    far: Vector = np.linalg.norm(m.geom_pos, axis=1) + m.geom_rbound
    far[m.geom_type == mujoco.mjtGeom.mjGEOM_PLANE] = np.inf
    return far


def _ways(m: mujoco.MjModel) -> Vector:
    """Return by how much each joint moves the frame of its body at most (n,) [m]."""
    slides = m.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
    aside = 2.0 * np.linalg.norm(m.jnt_pos, axis=1)
    reach = np.abs(m.jnt_range - m.qpos0[m.jnt_qposadr, None]).max(axis=1, initial=0.0)
    ways: Vector = np.where(slides, reach, aside)
    return ways


def _links(m: mujoco.MjModel, ways: Vector) -> Matrix:
    """Return the largest distances between the frames of bodies along the links [m]."""
    links = np.zeros((m.nbody, m.nbody))
    for body in range(1, m.nbody):
        length = float(np.linalg.norm(m.body_pos[body]))
        first = m.body_jntadr[body]
        for way in ways[first : first + m.body_jntnum[body]].tolist():
            length += way
        links[body, :body] = links[m.body_parentid[body], :body] + length
        links[:body, body] = links[body, :body]
    return links


class ClosingJacobian:
    """Computes the closing speed of pairs of geoms per joint, from the joint axes of a state."""

    def __init__(
        self, m: mujoco.MjModel, data: mujoco.MjData, pairs: tuple[tuple[int, int], ...]
    ) -> None:
        """Choose pairs of geoms; the caller runs `mj_comPos` on `data` before `rows`."""
        bodies = m.geom_bodyid[np.array(pairs)]
        moves = moved_by(m)
        self.sign: Matrix = moves[bodies[:, 0]] - moves[bodies[:, 1]]
        """1 where a joint moves the first geom of a pair, -1 for the second, else 0 (pairs, n)."""
        roots = m.body_rootid[m.jnt_bodyid]
        self._centre: Vector = data.subtree_com[roots[0]]
        self._twists: Matrix = data.cdof
        self._centres = data.subtree_com
        self._roots = roots if (roots != roots[0]).any() else None
        self._skew = _skew()
        self._p = np.ones((len(pairs), 4))
        self._products = np.zeros((len(pairs), 3, 4))

    def rows(self, pair: NDArray[np.intp], distance: Vector, segment: Matrix) -> Matrix:
        """Return closing speeds n . (J_a - J_b) per joint (k, n), n from first to second geom.

        MuJoCo's `cdof` holds the twist (w, v) of each joint about the centre of mass c: it moves
        a point p along n by n . (v + w x (p - c)) = Σ_ik n_i S_ik (p - c, 1)_k with
        S = ([w]×, v). Both nearest points lie on one line along n, so one serves both Jacobians.

        Args:
            pair: Indices of the pairs (k,).
            distance: Their signed distances, none of them zero (k,) [m].
            segment: Nearest points on the first and the second geom of each (k, 6) [m].
        """
        k = len(pair)
        p, products = self._p[:k], self._products[:k]
        n = segment[:, 3:] - segment[:, :3]
        n /= distance[:, None]
        np.subtract(segment[:, :3], self._centre, out=p[:, :3])
        np.multiply(n[:, :, None], p[:, None, :], out=products)
        twists = self._twists if self._roots is None else self._about_one_centre()
        out: Matrix = products.reshape(k, 12) @ (self._skew @ twists.T)
        out *= self.sign.take(pair, axis=0)
        return out

    def _about_one_centre(self) -> Matrix:
        """Return the twists of several arms about one point: MuJoCo has them about one of each."""
        twists = self._twists.copy()
        away = self._centre - self._centres[self._roots]
        # w x r, written out: np.cross takes longer than all else here.
        x, y, z = twists[:, :3].T
        rx, ry, rz = away.T
        twists[:, 3] += y * rz - z * ry
        twists[:, 4] += z * rx - x * rz
        twists[:, 5] += x * ry - y * rx
        return twists


def _skew() -> Matrix:
    """Return the map of (w, v) to the rows of ([w]×, v) (12, 6)."""
    out = np.zeros((3, 4, 6))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i, k, j], out[i, j, k], out[i, 3, 3 + i] = 1.0, -1.0, 1.0
    return out.reshape(12, 6)
