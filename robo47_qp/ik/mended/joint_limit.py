"""A mink limit on position, velocity and acceleration of joints that can always be kept."""

from collections.abc import Mapping
from typing import NamedTuple

import mink
import mujoco
import numpy as np

from robo47_qp.arrays import Matrix, Range, Vector, checked_vector, frozen_vector
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.ik.stream.joint_bounds import JointBounds
from robo47_qp.model.robot import MotionProfile

_SCALAR = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
_ANY = 1e9
"""Stands for an acceleration without a limit [rad/s² or m/s²]."""


class StepBox(NamedTuple):
    """Displacements that the next step may have."""

    low: Vector
    """(nv,) [rad or m]; -inf for what the limit does not cover."""
    high: Vector
    """(nv,), nowhere below `low` [rad or m]."""


class JointLimit(mink.Limit):
    """Joint ranges, speeds and accelerations in one box, which is never empty.

    It takes the place of `mink.ConfigurationLimit` and `mink.VelocityLimit`. Those leave no room
    to brake, and together they are infeasible 0.01 rad outside a range at 2 rad/s and 2 ms.
    Here a joint may go as fast as it can still stop before the end of its range; one outside
    comes back as fast as it can stop there, inside its speed and acceleration; one too fast
    brakes. The bounds give way in this order: range, speed, and acceleration never.

    Steps are those of mink: the velocity is constant for dt, so a step is v dt. That is the
    motion of `JointBounds`, whose velocity changes linearly, seen at the middle of its ticks.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        velocities: Mapping[str, float],
        accelerations: Mapping[str, float] | None = None,
    ) -> None:
        """Limit some joints.

        Args:
            model: Any model.
            velocities: Largest speed of each joint to limit, by name [rad/s or m/s].
            accelerations: Largest acceleration of the same joints [rad/s² or m/s²]; None for
                no limit: then ranges and speeds are kept, and there is always a way back.

        Raises:
            UnknownNameError: The model has no joint of a name.
            InvalidValueError: No joint is named, one neither turns nor slides, a number is not
                positive, or the two name different joints.
        """
        if not velocities:
            raise InvalidValueError("velocities", dict(velocities), "speeds of at least one joint")
        joints = [_scalar_joint(model, name) for name in velocities]
        n, a_of = len(joints), dict.fromkeys(velocities, _ANY)
        if accelerations is not None:
            if set(accelerations) != set(velocities):
                named = f"given for the joints {sorted(velocities)}, as the velocities are"
                raise InvalidValueError("accelerations", sorted(accelerations), named)
            a_of = {name: accelerations[name] for name in velocities}
        v_max = frozen_vector("velocities", list(velocities.values()), n)
        self.a_max: Vector = frozen_vector("accelerations", list(a_of.values()), n)
        """Largest accelerations of the limited joints [rad/s² or m/s²]."""
        self._profile = MotionProfile(v_max=v_max, a_max=self.a_max, j_max=np.ones(n))
        limited = model.jnt_limited[joints].astype(bool)
        ends = np.where(limited, model.jnt_range[joints].T, [[-np.inf], [np.inf]])
        self._range = (ends[0], ends[1])
        self._places, self.dofs = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        self._rows: Matrix = np.eye(model.nv)[self.dofs]
        self._G = np.vstack([self._rows, -self._rows])
        self._nv, self._v = model.nv, np.zeros(n)
        self._bounds: dict[float, JointBounds] = {}

    def set_velocity(self, v: Vector) -> None:
        """Tell the velocity of the last step, from which the next may differ by a_max dt.

        Args:
            v: Velocity of all degrees of freedom (nv,), as `mink.solve_ik` returns it.

        Raises:
            InvalidValueError: It is not of nv finite numbers.
        """
        self._v = checked_vector("v", v, self._nv)[self.dofs]

    def box(self, configuration: mink.Configuration, dt: float) -> StepBox:
        """Return the box of the next step of length dt [s]."""
        low, high = np.full(self._nv, -np.inf), np.full(self._nv, np.inf)
        low[self.dofs], high[self.dofs] = self._ends_of_step(configuration, dt)
        return StepBox(low, high)

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        """Return G and h with G dq <= h for the step dq [rad or m]."""
        low, high = self._ends_of_step(configuration, dt)
        return mink.Constraint(G=self._G, h=np.concatenate([high, -low]))

    def _ends_of_step(self, configuration: mink.Configuration, dt: float) -> tuple[Vector, Vector]:
        bounds = self._bounds.get(dt)
        if bounds is None:
            Range(above=0.0).check("dt", dt)
            bounds = self._bounds[dt] = JointBounds(*self._range, self._profile, dt, margin=0.0)
        q = configuration.data.qpos[self._places]
        box = bounds.box(q - 0.5 * dt * self._v, self._v)
        return dt * box.low, dt * box.high


def _scalar_joint(model: mujoco.MjModel, name: str) -> int:
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    if number < 0:
        known = [model.joint(i).name for i in range(model.njnt)]
        raise UnknownNameError("joint", name, known)
    if mujoco.mjtJoint(model.jnt_type[number]) not in _SCALAR:
        raise InvalidValueError("velocities", name, "speeds of joints that turn or slide")
    return int(number)
