"""The signed distance between two geoms."""

import mujoco
import numpy as np

from robo47_qp.arrays import Vector

FAR = 1e3
"""Largest cut-off [m], beyond any distance in a cell."""


class GeomDistance:
    """Measures pairs of geoms at the last `mj_kinematics` of a state.

    It is MuJoCo's `mj_geomDistance` with one correction. Distances of separate boxes, capsules,
    cylinders, spheres and planes are exact to 1e-9 m; where geoms overlap, the depth is that of
    the shortest way out, for cylinders to about 1e-6 m. But for a capsule whose axis crosses a
    box, MuJoCo 4.0 reports centimetres of clearance in about one of a hundred cases, and wrong
    depths: such a pair is measured here.
    """

    def __init__(self, m: mujoco.MjModel, d: mujoco.MjData) -> None:
        """Measure in a model and one of its states."""
        self._m, self._d = m, d
        self._type = m.geom_type.tolist()
        self.segment: Vector = np.zeros(6)
        """Nearest points on the first and the second geom (6,) [m], of the last pair measured
        that was closer than its cut-off."""

    def between(self, a: int, b: int, cut_off: float) -> float:
        """Return the signed distance of two geoms, `cut_off` at most [m]."""
        # Not below zero, where MuJoCo's margins end.
        far = max(0.0, min(cut_off, FAR))
        distance = float(mujoco.mj_geomDistance(self._m, self._d, a, b, far, self.segment))
        capsule, box = self.capsule_and_box(a, b)
        if capsule >= 0:
            distance = self._checked(capsule, box, distance, first=capsule == a)
        return cut_off if distance >= far else min(distance, cut_off)

    def capsule_and_box(self, a: int, b: int) -> tuple[int, int]:
        """Return which of two geoms is a capsule and which a box; else -1, -1."""
        kinds = self._type[a], self._type[b]
        if kinds == (_CAPSULE, _BOX):
            return a, b
        return (b, a) if kinds == (_BOX, _CAPSULE) else (-1, -1)

    def _checked(self, capsule: int, box: int, distance: float, *, first: bool) -> float:
        """Return the distance given, or minus the depth if the capsule's axis crosses the box."""
        m, d = self._m, self._d
        centre, R = d.geom_xpos[box], d.geom_xmat[box].reshape(3, 3)
        radius, half = m.geom_size[capsule, :2].tolist()
        middle = (d.geom_xpos[capsule] - centre).dot(R).tolist()
        axis = d.geom_xmat[capsule].reshape(3, 3)[:, 2].dot(R).tolist()
        found = _penetration(middle, axis, half, m.geom_size[box].tolist())
        if found is None:
            return distance
        depth, out, point = found[0] + radius, R @ found[1], centre + R @ found[2]
        on_capsule = point - radius * out
        ends = (on_capsule, on_capsule + depth * out)
        self.segment[:3], self.segment[3:] = ends if first else ends[::-1]
        return float(-depth)


_BOX = int(mujoco.mjtGeom.mjGEOM_BOX)
_CAPSULE = int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_PARALLEL = 1e-9
"""Sine of an angle below which a line is parallel to an axis."""


def _penetration(
    middle: list[float], axis: list[float], half: float, size: list[float]
) -> tuple[float, Vector, Vector] | None:
    """Return how deep a line segment is inside a box, in the box's frame; None if it is outside.

    By the separating axes: the box's normals and their cross products with the segment. The
    smallest overlap along one of them is the depth (Gottschalk, Lin and Manocha, "OBBTree", 1996).

    Returns:
        Depth [m], unit vector of the shortest way out, deepest point of the segment.
    """
    for i in range(3):
        if abs(middle[i]) >= size[i] + half * abs(axis[i]):
            return None
    p, u, h = (np.array(numbers) for numbers in (middle, axis, size))
    least, out, which = np.inf, p, 0
    for k, normal in enumerate([*np.eye(3), *_crosses(axis)]):
        length = np.sqrt(normal.dot(normal))
        if length < _PARALLEL:
            continue
        n: Vector = normal / (length if p.dot(normal) >= 0.0 else -length)
        overlap = float(h.dot(np.abs(n)) + half * abs(u.dot(n)) - p.dot(n))
        if overlap <= 0.0:
            return None
        # By more than rounding: a normal of the box is preferred to an equal cross product.
        if overlap < least - 1e-12:
            least, out, which = overlap, n, k
    if which < 3:
        end: Vector = p - np.sign(u.dot(out)) * half * u
        return least, out, end
    edge = np.eye(3)[which - 3]
    across = np.cross(u, edge)
    along = np.cross(h * np.sign(out) - p, edge).dot(across) / across.dot(across)
    crossing: Vector = p + np.clip(along, -half, half) * u
    return least, out, crossing


def _crosses(u: list[float]) -> list[Vector]:
    """Return the cross products of a vector with the three axes."""
    x, y, z = u
    return [np.array([0.0, z, -y]), np.array([-z, 0.0, x]), np.array([y, -x, 0.0])]
