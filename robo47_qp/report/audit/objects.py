"""Audit of free objects: that they move by their velocities, and change these by forces alone."""

import numpy as np
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.report.audit.finding import Finding, at_most
from robo47_qp.run.scenario import Run
from robo47_qp.run.signals import angle_between

_ROUNDING = 1e-12
"""What rounding may leave unexplained in a period, in metres or radians: 6e-15 were seen."""
_RESIDUAL = 1e-4
"""Largest unexplained change of speed in a period [m/s].

Contacts are solved to a tolerance: 8e-6 m/s were seen. Friction alone changes the speed of a
sliding item by 25 times as much in a period.
"""
_TURNING = 2e-3
"""Largest unexplained change of turning speed in a period [rad/s], likewise.

Of a light peg, 2e-4 rad/s were seen. Friction alone changes that of a cube on a table by 100 times
as much.
"""


def object_jumps(run: Run) -> list[Finding]:
    """Check that no free object was moved but by physics.

    MuJoCo's integrator takes positions on by the new velocity, p' = p + T v' and likewise for the
    rotation, and the velocity of the centre of mass by the acceleration that contacts and gravity
    give it, v' = v + T a, and likewise its turning speed. What is left is what something else has
    done to an object between two periods, or before the first one, after the task had put it there.
    """
    if not len(run.rows):
        return []
    for name in run.objects:
        # The last row has no acceleration yet that led anywhere.
        known = run.rows[f"objects/{name}"], _twist(run, name), _change(run, name)[:-1]
        if not all(np.isfinite(values).all() for values in known):
            return [at_most(f"object jump ({name})", "m", np.array([np.nan]), _ROUNDING)]
    found, before = [], {name: _before(run, name) for name in run.objects}
    for k, (title, unit, part, slack) in enumerate(_PARTS if run.objects else ()):
        # One number for each row: nothing follows the last.
        sizes = {name: np.append(part(run, name), 0.0) for name in run.objects}
        for name, size in sizes.items():
            size[0] = max(size[0], before[name][k])
        name = max(sizes, key=lambda one: float(sizes[one].max()))
        found.append(at_most(f"{title} ({name})", unit, sizes[name], slack))
    return found


def _before(run: Run, name: str) -> Vector:
    """Return what has changed before the first row since the task put an object there (4,).

    Of its position, rotation, speed and turning speed.
    """
    pose, twist = run.rows[f"objects/{name}"][:1], _twist(run, name)[0]
    begun = run.begun[name]
    return np.array(
        [
            np.linalg.norm(pose[0, :3] - begun[:3]),
            angle_between(begun[None, 3:7], pose[:, 3:])[0, 0],
            np.linalg.norm(twist[:3] - begun[7:10]),
            np.linalg.norm(twist[3:] - begun[10:]),
        ]
    )


def _moved(run: Run, name: str) -> Vector:
    position, twist = run.rows[f"objects/{name}"][:, :3], _twist(run, name)
    return _size(np.diff(position, axis=0) - TIMESTEP * twist[1:, :3])


def _turned(run: Run, name: str) -> Vector:
    quaternion = run.rows[f"objects/{name}"][:, 3:]
    half = 0.5 * TIMESTEP * _twist(run, name)[1:, 3:]
    w, x, y, z = quaternion[:-1].T
    a, (b, c, d) = np.cos(_size(half)), (np.sinc(_size(half) / np.pi) * half.T)
    expected = np.column_stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ]
    )
    return angle_between(expected, quaternion[1:])[:, 0]


def _kicked(run: Run, name: str) -> Vector:
    twist, left = _twist(run, name), _left(run, name)
    turning, turned = twist[:-1, 3:], np.diff(twist[:, 3:], axis=0)
    # The frame goes around a centre of mass c beside it with ω x (ω x c), of which the integrator
    # takes the change in this period on, to first order.
    c = np.broadcast_to(run.objects[name].centre, turned.shape)
    around = np.cross(turned, np.cross(turning, c)) + np.cross(turning, np.cross(turned, c))
    beside = np.cross(left[:, 3:], c) + TIMESTEP * around
    wxyz = run.rows[f"objects/{name}"][:-1, 3:]
    in_world = Rotation.from_quat(wxyz, scalar_first=True).apply(beside)
    return _size(left[:, :3] + in_world)


def _spun(run: Run, name: str) -> Vector:
    turning, inertia = _twist(run, name)[:, 3:], run.objects[name].moments
    before, turned = turning[:-1], np.diff(turning, axis=0)
    # The integrator takes the change of the gyroscopic torque ω x I ω in this period on, likewise.
    gyroscopic = np.cross(turned, before @ inertia) + np.cross(before, turned @ inertia)
    return _size(_left(run, name)[:, 3:] + TIMESTEP * np.linalg.solve(inertia, gyroscopic.T).T)


def _left(run: Run, name: str) -> Matrix:
    """Return the changes of the twist that the accelerations leave unexplained (N - 1, 6)."""
    left: Matrix = np.diff(_twist(run, name), axis=0) - TIMESTEP * _change(run, name)[:-1]
    return left


def _change(run: Run, name: str) -> Matrix:
    return run.rows[f"motion/{name} acceleration"]


def _twist(run: Run, name: str) -> Matrix:
    return run.rows[f"motion/{name} velocity"]


def _size(vectors: Matrix) -> Vector:
    size: Vector = np.linalg.norm(vectors, axis=1)
    return size


_PARTS = (
    ("object jump", "m", _moved, _ROUNDING),
    ("object turn", "rad", _turned, _ROUNDING),
    ("object kick", "m/s", _kicked, _RESIDUAL),
    ("object spin", "rad/s", _spun, _TURNING),
)
