"""Watchdog: bounds that end a run at once."""

from dataclasses import dataclass
from math import inf
from typing import Annotated, TypeAlias

import numpy as np

from robo47_qp.arrays import Checked, Range, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.sim.simulation import Simulation

Bound: TypeAlias = Annotated[float, Range(above=0.0, infinite=True)]


@dataclass(frozen=True, kw_only=True)
class Watchdog(Checked):
    """Bounds that are checked every few control periods; a violation ends the run."""

    joint_error_max: Bound = 0.2
    """Largest distance of a joint from its reference while the arm is stiff [rad or m]."""
    links_force_max: Bound = 1.0
    """Largest contact force on the links before the tool [N]."""
    time_limit: Bound | None = None
    """Simulated time for the arm to do the task in, in place of `Task.time_limit` [s]."""

    def check(
        self,
        simulation: Simulation,
        arm: Arm,
        reference: JointReference,
        *,
        stiff: bool,
        force_max: float,
        fixed_force_max: float = inf,
        time_limit: float = inf,
    ) -> Failure | None:
        """Return the failure if a bound is violated now; None otherwise.

        Args:
            simulation: The world.
            arm: The arm with its joint limits.
            reference: Joint reference of this instant.
            stiff: Whether the arm has to follow its reference.
            force_max: Largest contact force on a tool and what it holds [N].
            fixed_force_max: Largest contact force of a tool itself with what stands fixed since
                the last check [N].
            time_limit: When it has to be done [s].
        """
        touched = self._touched(simulation, force_max, fixed_force_max)
        if touched is not None:
            return Failure(cause=Cause.COLLISION, evidence=touched)
        q, joints = simulation.true_state().q, arm.robot.joints
        room = np.minimum(q - arm.q_min, arm.q_max - q)
        if room.min() < 0.0:
            i = int(room.argmin())
            unit = arm.robot.units[i]
            return Failure(
                cause=Cause.LIMIT,
                evidence=f"{joints[i]} is at {q[i]:.4f} {unit}, {-room[i]:.4f} outside its limits",
            )
        error = np.abs(q - reference.q)
        if stiff and error.max() > self.joint_error_max:
            i = int(error.argmax())
            return Failure(
                cause=Cause.TRACK,
                evidence=f"{joints[i]} is {error[i]:.3f} {arm.robot.units[i]} from its reference; "
                f"allowed are {self.joint_error_max:.3f}",
            )
        if simulation.time > time_limit + 0.5 * TIMESTEP:
            return Failure(
                cause=Cause.TIMEOUT,
                evidence=f"the run has taken {simulation.time:.1f} s; "
                f"allowed are {time_limit:.1f} s",
            )
        return None

    def _touched(
        self, simulation: Simulation, force_max: float, fixed_force_max: float
    ) -> str | None:
        force = _largest(simulation, "contact/links", np.array([simulation.last_links_force()]))
        if force > self.links_force_max:
            return (
                f"the contact force on the links before the tool is {force:.1f} N; "
                f"allowed are {self.links_force_max:.1f} N"
            )
        for i, (label, tool) in enumerate(simulation.robot.tool_labels()):
            which = f"{tool.name} tool" if label else "tool"
            force = simulation.fixed_force_peak(i)
            if force > fixed_force_max:
                return (
                    f"the {which} itself touched the table, or what else stands fixed, with "
                    f"{force:.1f} N; allowed are {fixed_force_max:.1f} N"
                )
            force = _largest(simulation, f"contact/{label}tool", simulation.last_tool_force(i))
            if force > force_max:
                return (
                    f"the contact force on the {which} is {force:.1f} N; "
                    f"allowed are {force_max:.1f} N"
                )
        return None


def _largest(simulation: Simulation, signal: str, last: Vector) -> float:
    """Return the largest force in the control periods since the last check, or of the last [N]."""
    rows = last[None] if simulation.lately is None else simulation.lately(signal)
    return float(np.sqrt(np.square(rows).sum(axis=1).max()))
