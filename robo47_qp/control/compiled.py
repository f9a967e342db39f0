"""CompiledControl: a control period in the compiled core, for the laws that it knows."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp._core.library import Structure, backend, functions, pointer
from robo47_qp._core.mujoco_functions import dynamics, function, structure
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.control.cartesian_impedance import CartesianImpedance
from robo47_qp.control.computed_torque import ComputedTorque
from robo47_qp.control.controller import Controller
from robo47_qp.control.joint_impedance import FeedForward, JointImpedance
from robo47_qp.control.joint_stops import JointStops
from robo47_qp.control.tool_space import LIGHTEST
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.model.chain import MAX_JOINTS

COMPUTED_TORQUE, JOINT_IMPEDANCE, CARTESIAN_IMPEDANCE = 1, 2, 3
"""Laws of the core, as control.h numbers them."""


class CompiledControl:
    """Observer, law and limits of one controller and arm as one call; see `ActiveController`.

    The numbers that change from period to period are those of the core, in arrays that keep their
    place; the caller brings single numbers in and out.
    """

    def __init__(
        self,
        law: dict[str, Any],
        arm: Arm,
        stops: JointStops,
        dt: float,
        observer: dict[str, Any] | None,
    ) -> None:
        """Set the structure up.

        Args:
            law: Number and gains of the law; see `law_of`.
            arm: The belief.
            stops: The springs at the joint limits.
            dt: Control period [s].
            observer: Arrays of the observer; None without one.
        """
        n, robot = arm.n, arm.robot
        self.last, self.commanded, self.bump = np.zeros(n), np.zeros(n), np.zeros(n)
        low, high = stops.inside(arm)
        self._structure = Structure(
            "r47_control",
            n=n,
            arm=arm.derived(_dynamics),
            **law,
            rate=robot.tau_rate_max * dt,
            most=robot.tau_max.copy(),
            low=low,
            high=high,
            stop=stops.strength * robot.tau_max,
            square=(stops.margin * (arm.q_high - arm.q_low)) ** 2,
            q_min=arm.q_min,
            q_max=arm.q_max,
            last=self.last,
            commanded=self.commanded,
            bump=self.bump,
            observed=int(observer is not None),
            **(observer or {}),
        )
        self._arm = arm
        self.c = self._structure.pointer
        """The structure `r47_control`."""
        self._given: Matrix = np.zeros((5, n))
        self._tau: Vector = np.zeros(n)
        self._arguments = [pointer(row) for row in (*self._given, self._tau)]
        self._torques = functions().r47_torques

    def torque(self, reference: JointReference, state: JointState) -> Vector:
        """Return the torque for a period (n,) [N·m], within the limits."""
        given = self._given
        given[0], given[1], given[2] = reference
        given[3], given[4] = state
        self._torques(self.c, 1, *self._arguments)
        return self._tau.copy()

    def torques(self, references: JointReference, states: JointState) -> Matrix:
        """Return the torques for many periods (N, n) [N·m], from q, v, a and q, v (N, n) each."""
        given = [np.ascontiguousarray(values) for values in (*references, *states)]
        tau = np.empty_like(given[0])
        self._torques(self.c, len(tau), *map(pointer, given), pointer(tau))
        return tau

    def run(
        self,
        world: Structure,
        periods: int,
        references: JointReference,
        rows: Matrix,
        command: int,
        filled: NDArray[np.int64],
    ) -> tuple[int, bool]:
        """Run control periods in a world, and fill a row for each.

        Args:
            world: The structure `r47_world`.
            periods: How many.
            references: q, v, a (N, n) of them, and maybe of more.
            rows: The rows (N, columns).
            command: First column of the commanded torques.
            filled: Gets one more for every row that is complete (1,).

        Returns:
            How many were run, and whether the row of the last is complete; see loop.h.
        """
        arrays = [np.ascontiguousarray(values[:periods]) for values in references]
        done: int = functions().r47_run(
            self.c,
            world.pointer,
            periods,
            *map(pointer, arrays),
            pointer(rows),
            rows.shape[1],
            command,
            pointer(filled),
        )
        return (done, True) if done > 0 else (-done, False)


def law_of(controller: Controller, arm: Arm) -> dict[str, Any] | None:
    """Return a law as the compiled core has it; None if it has not, or numpy was chosen."""
    if backend() == "numpy" or arm.has_dry_friction or arm.n > MAX_JOINTS:
        return None
    if type(controller) is ComputedTorque:
        omega, ratio = controller.frequency, controller.damping_ratio
        law = {"stiffness": omega**2, "damping": 2.0 * ratio * omega}
        return {"law": COMPUTED_TORQUE, **law, **_springs(controller.springs(arm))}
    if type(controller) is JointImpedance and controller.feed_forward is FeedForward.FULL:
        return {"law": JOINT_IMPEDANCE, **_springs(controller.springs(arm))}
    if type(controller) is CartesianImpedance:
        return {"law": CARTESIAN_IMPEDANCE, "impedance": _impedance(controller, arm)}
    return None


def _springs(found: tuple[Vector, Vector] | None) -> dict[str, Vector]:
    return {} if found is None else dict(zip("KD", found, strict=True))


def _impedance(controller: CartesianImpedance, arm: Arm) -> Structure:
    return Structure(
        "r47_impedance",
        space=arm.derived(_tool_space, controller.frame == "tool"),
        stiffness=controller.stiffness.copy(),
        most=controller.error_max.copy(),
        rate=2.0 * controller.damping_ratio * np.sqrt(controller.stiffness),
        posture_stiffness=controller.posture_frequency**2,
        posture_damping=controller.posture_damping,
    )


def _dynamics(arm: Arm) -> Structure:
    return dynamics(arm.model, arm.scratch)


def _tool_space(arm: Arm, in_tool: bool) -> Structure:
    m, d, site, n = arm.model, arm.scratch, arm.tool_site, arm.n
    at_reference = mujoco.MjData(m)
    return Structure(
        "r47_tool_space",
        arm=arm.derived(_dynamics),
        jacobian=function("mj_jacSite"),
        jacobian_rate=function("mj_jacDot"),
        site=site,
        body=int(m.site_bodyid[site]),
        position=d.site_xpos[site],
        quaternion=d.site_xquat[site],
        data=structure(at_reference),
        q=at_reference.qpos,
        position_ref=at_reference.site_xpos[site],
        quaternion_ref=at_reference.site_xquat[site],
        rotation_ref=at_reference.site_xmat[site],
        in_tool=int(in_tool),
        lightest=LIGHTEST,
        J=np.zeros((6, n)),
        J_over_M=np.zeros((6, n)),
        inertia=np.zeros((6, 6)),
        error=np.zeros(3),
        rotation=np.zeros(4),
    )
