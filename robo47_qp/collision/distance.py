"""The signed distance between two geoms."""

import mujoco
import numpy as np

from robo47_qp.arrays import Vector

_FAR = 1e3
"""Larger than any distance in a cell [m]: a cut-off that cuts nothing off."""


class GeomDistance:
    """Measures pairs of geoms at the last `mj_kinematics` of a state.

    MuJoCo's `mj_geomDistance`, and one correction. Apart, boxes, capsules, cylinders, spheres
    and planes are exact to 1e-9 m. Overlapping, the depth is that of the shortest way out, for
    cylinders to about 1e-6 m. But of a capsule whose axis runs through a box, MuJoCo 4.0
    reports in about one of a hundred cases that it is clear, by centimetres, and depths that
    are no way out: such a pair is measured here.
    """

    def __init__(self, m: mujoco.MjModel, d: mujoco.MjData) -> None:
        """Look at a model and one of its states."""
        self._m, self._d = m, d
        self._type = m.geom_type.tolist()
        self.segment: Vector = np.zeros(6)
        """Points on the first and on the second geom, (6,) [m], of the last pair measured
        that was closer than its cut-off."""

    def between(self, a: int, b: int, cut_off: float) -> float:
        """Distance of two geoms [m], negative where they overlap; `cut_off` if it is larger."""
        # Not below zero, where MuJoCo's margins end.
        far = max(0.0, min(cut_off, _FAR))
        distance = float(mujoco.mj_geomDistance(self._m, self._d, a, b, far, self.segment))
        kinds = self._type[a], self._type[b]
        if kinds == (_CAPSULE, _BOX):
            distance = self._checked(a, b, distance, first=True)
        elif kinds == (_BOX, _CAPSULE):
            distance = self._checked(b, a, distance, first=False)
        return cut_off if distance >= far else min(distance, cut_off)

    def _checked(self, capsule: int, box: int, distance: float, *, first: bool) -> float:
        """The distance found, or a depth if the capsule's axis runs through the box."""
        m, d = self._m, self._d
        centre, R = d.geom_xpos[box], d.geom_xmat[box].reshape(3, 3)
        radius, half = m.geom_size[capsule, :2].tolist()
        middle = (d.geom_xpos[capsule] - centre).dot(R).tolist()
        axis = d.geom_xmat[capsule].reshape(3, 3)[:, 2].dot(R).tolist()
        size = m.geom_size[box].tolist()
        found = _way_out(middle, axis, half, size)
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


def _way_out(
    middle: list[float], axis: list[float], half: float, size: list[float]
) -> tuple[float, Vector, Vector] | None:
    """Shortest way of a line out of a box, in the box's frame; None if they do not meet.

    The normals of the box and their cross products with the line are the faces of the two
    shapes' difference: the least overlap along any of them is the depth, and where one has
    none the shapes are apart (Gottschalk, Lin and Manocha, "OBBTree", 1996).

    Returns:
        Depth [m], direction in which the line leaves, point of the line that leaves last.
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
        # By more than rounding: a normal of the box goes before its double among the products.
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
    """Cross products of a vector with the three axes."""
    x, y, z = u
    return [np.array([0.0, z, -y]), np.array([-z, 0.0, x]), np.array([y, -x, 0.0])]
