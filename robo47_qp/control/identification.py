"""Identification: payload, dry friction and heavier links from a short motion."""

from dataclasses import dataclass

import numpy as np
from mink import SE3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.model.payload import Payload

_MOVING = 0.05
"""Speed above which the sign of dry friction is certain [rad/s]."""
_POINT, _OFFSET = 1e-9, 0.05
"""Moments of a mass that is almost a point [kg·m²]; where such masses are tried [m]."""
_CONDITION_MAX = 1e4
"""Largest ratio of the best to the worst determined parameter, each in its own unit [-]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Identified:
    """What a motion has shown about an arm."""

    link_mass: float
    """By how much the links are heavier than believed, as a share [-]."""
    payload_mass: float
    """Mass at the main tool beyond the believed payload [kg]."""
    payload_com: Vector
    """Its centre of mass in the tool frame (3,) [m]; zeros where there is less than 10 g."""
    friction: Vector
    """Dry friction beyond what the model declares (n,) [N·m]."""
    deviation: float
    """Root mean square of the torque that this does not explain [N·m]."""


class Identification:
    """Collects what a disturbance observer sees while the arm moves, and explains it.

    The torque that the belief cannot explain, -M d, is linear in the mass m of a payload, its
    first moments m c, a share by which all links are heavier, and the dry friction of each joint
    (Atkeson, An and Hollerbach, IJRR 5(3), 1986). They are found by least squares. The columns
    are differences of the arm's own inverse dynamics with small masses at the tool. The motion
    should turn the tool about horizontal axes and move each joint both ways; a few seconds do.
    """

    def __init__(self, arm: Arm) -> None:
        """Start without samples.

        Args:
            arm: The belief while the motion is made; it bears no payload.

        Raises:
            InvalidValueError: It bears one.
        """
        if arm.payloads:
            raise InvalidValueError("arm", "one with a payload", "one that bears none")
        self._arm = arm
        self._at_tool = _loaded(arm, np.zeros(3))
        self._around = [
            tuple(_loaded(arm, side * _OFFSET * axis) for side in (1.0, -1.0)) for axis in np.eye(3)
        ]
        self._own = np.diag(arm.model.dof_armature)
        self._rows: list[Matrix] = []
        self._torques: list[Vector] = []

    def add(self, q: Vector, v: Vector, a: Vector, d: Vector) -> None:
        """Add a sample; the joints that hardly move count without friction and are left out.

        Args:
            q: Positions (n,) [rad].
            v: Velocities (n,) [rad/s].
            a: Accelerations (n,) [rad/s²].
            d: `ObservedJoints.disturbance` (n,) [rad/s²].
        """
        arm, moving = self._arm, np.abs(v) > _MOVING
        if not moving.any():
            return
        bare = arm.inverse_dynamics(q, v, a)
        links = bare - self._own @ a - arm.model.dof_damping * v
        point = self._at_tool.inverse_dynamics(q, v, a) - bare
        shifted = [
            (ahead.inverse_dynamics(q, v, a) - behind.inverse_dynamics(q, v, a)) / (2.0 * _OFFSET)
            for ahead, behind in self._around
        ]
        columns = np.column_stack([links, point, *shifted, np.diag(np.sign(v))])
        self._rows.append(columns[moving])
        self._torques.append(-(arm.mass_matrix(q) @ d)[moving])

    def solve(self) -> Identified:
        """Return what explains the samples best.

        Raises:
            InvalidValueError: The motion does not tell the parameters apart.
        """
        n = self._arm.n
        rows = np.vstack([np.zeros((0, 5 + n)), *self._rows])
        torques = np.concatenate([np.zeros(0), *self._torques])
        told = len(rows) >= 5 + n and np.linalg.cond(rows) <= _CONDITION_MAX
        if not told:
            found = f"{len(self._rows)} samples that do not"
            raise InvalidValueError("motion", found, "one that tells the parameters apart")
        x = np.linalg.lstsq(rows, torques, rcond=None)[0]
        mass = float(x[1])
        return Identified(
            link_mass=float(x[0]),
            payload_mass=mass,
            payload_com=x[2:5] / mass if abs(mass) > 0.01 else np.zeros(3),
            friction=x[5:],
            deviation=float(np.sqrt(np.mean((rows @ x - torques) ** 2))),
        )


def _loaded(arm: Arm, position: Vector) -> Arm:
    """Return the arm with a point of 1 kg at a position in the tool frame (3,) [m]."""
    point = Payload(
        mass=1.0, inertia=(_POINT, _POINT, _POINT), T_tcp_com=SE3.from_translation(position)
    )
    return arm.with_payload(point)
