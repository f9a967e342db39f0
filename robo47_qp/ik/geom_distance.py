"""The signed distance between two geoms."""

import mujoco
import numpy as np

from robo47_qp.arrays import Vector

_FAR = 1e3
"""Larger than any distance in a cell [m]: a cut-off that cuts nothing off."""


class GeomDistance:
    """Measures pairs of geoms at the last `mj_kinematics` of a state.

    MuJoCo's `mj_geomDistance`, and one correction. Apart, boxes, capsules, cylinders, spheres
    and planes are exact to 1e-9 m. Overlapping, the depth is that of the shortest way out for
    spheres, capsules and planes, and an estimate of it for the others. Of a capsule whose
    axis runs through a box, MuJoCo 4.0 reports in about one of a hundred cases that it is
    clear, by centimetres: such a pair is looked at a second time here.
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
        # Not below zero: cut off there, a pair that MuJoCo takes for clear could not be told.
        far = max(0.0, min(cut_off, _FAR))
        distance = float(mujoco.mj_geomDistance(self._m, self._d, a, b, far, self.segment))
        if distance >= 0.0:
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
        inside = _inside(middle, axis, half, size)
        if inside is None:
            return distance
        along = 0.5 * (inside[0] + inside[1])
        point = [p + along * u for p, u in zip(middle, axis, strict=True)]
        k = min(range(3), key=lambda i: size[i] - abs(point[i]))
        out = np.zeros(3)
        out[k] = 1.0 if point[k] >= 0.0 else -1.0
        depth = size[k] - abs(point[k]) + radius
        on_box, on_capsule = point + (depth - radius) * out, point - radius * out
        ends = (on_capsule, on_box) if first else (on_box, on_capsule)
        self.segment[:3], self.segment[3:] = (centre + R @ end for end in ends)
        return float(-depth)


_BOX = int(mujoco.mjtGeom.mjGEOM_BOX)
_CAPSULE = int(mujoco.mjtGeom.mjGEOM_CAPSULE)


def _inside(
    middle: list[float], axis: list[float], half: float, size: list[float]
) -> tuple[float, float] | None:
    """Part of a line within a box, by its three slabs; None where it misses the box.

    (Kay and Kajiya, "Ray tracing complex scenes", 1986.)
    """
    low, high = -half, half
    for p, u, h in zip(middle, axis, size, strict=True):
        if abs(u) < 1e-12:
            if abs(p) > h:
                return None
            continue
        near, far = sorted(((-h - p) / u, (h - p) / u))
        low, high = max(low, near), min(high, far)
        if low > high:
            return None
    return low, high
