"""Measurement of a grasped item's mass by the force sensor at the wrist."""

from collections.abc import Generator

import numpy as np
from mink import SE3

from robo47_qp.model.payload import Payload
from robo47_qp.motion.waypoint import Motion, Waypoint
from robo47_qp.run.compliance import Compliance
from robo47_qp.run.contact_steps import Comply
from robo47_qp.run.failure import Cause, Condition
from robo47_qp.run.steps import StepLike, Wait
from robo47_qp.sim.sensed import Sensed
from robo47_qp.tasks.handling.wrist import FreeWrist

_UP = 0.01
"""Height of the lift [m]; an unmodelled mass Δm sags by Δm·g over the stiffness, 4 mm for 0.3
kg."""
_STILL, _READ = 0.25, 0.1
"""Time to come to rest, and to average the sensor [s]."""
_TOLERANCE = 0.3
"""Standard deviation of the mass of an item from its nominal one that is expected [-]."""
_LEAST, _MOST = 1.0 - 3.0 * _TOLERANCE, 1.0 + 3.0 * _TOLERANCE
"""Least mass that counts as lifted, and largest that is expected, as shares of the nominal one
[-]."""
_TRIES = 4
"""How often it is weighed at most where the mass is none that is expected."""
_GRAVITY = 9.81
"""Gravity [m/s²]."""


def measure_mass(
    sensed: Sensed, name: str, expected: Payload, held: Condition, free: FreeWrist
) -> Generator[StepLike, None, float]:
    """Lift a grasped item slightly and measure its mass; fails with GRASP.

    The arm is compliant meanwhile: a stiff arm would leave its straight line under an unmodelled
    weight. At rest, the sensor reads -m g and what it read when the wrist was free, which drifts.
    As the change by the drift is about the weight of a light item, the mass is the mean of what
    was measured and of what is expected, weighted by how well each is known. A mass that is none
    that is expected is measured again: something may have pushed.

    Args:
        sensed: What is sensed.
        name: Name of the item.
        expected: Assumed payload.
        held: Condition that the item is held.
        free: Reading of the wrist before the item was touched.

    Returns:
        Mass of the item [kg].
    """
    readings: list[float] = []

    def read() -> None:
        readings.append(-float(sensed.felt_force()[2] - free.force[2]) / _GRAVITY)

    def beyond() -> float:
        """Return by how much the mass is beyond what is expected, negative below it [kg]."""
        mass, unsure = float(np.mean(readings)), 3.0 * free.drift(sensed) / _GRAVITY
        low, high = _LEAST * expected.mass - unsure, _MOST * expected.mass + unsure
        return mass - float(np.clip(mass, low, high))

    def against() -> str | None:
        mass = float(np.mean(readings))
        if beyond() >= 0.0:
            return None
        return (
            f"the sensor at the wrist reads {mass:.3f} kg, the {name} was taken to weigh "
            f"{expected.mass:.3f} kg"
        )

    lifted = Condition(name=f"the {name} is lifted", cause=Cause.GRASP, against=against)
    up = SE3.from_translation(np.array([0.0, 0.0, _UP])) @ sensed.tool_pose()
    springs, way = Compliance(), Waypoint(name="take up", target=up, motion=Motion.LIN)
    yield Comply(
        name="take up",
        waypoints=(way,),
        compliance=springs,
        carried=expected,
        seconds=_STILL,
        stay=True,
        after=(held,),
    )
    for left in reversed(range(_TRIES)):
        readings.clear()
        yield Comply(
            name="weigh",
            waypoints=(),
            compliance=springs,
            seconds=_READ,
            observe=read,
            after=() if left else (lifted,),
        )
        if not beyond():
            break
        if left:
            yield Wait(name="settle", seconds=_STILL)
    measured = (free.drift(sensed) / _GRAVITY) ** 2
    nominal = (_TOLERANCE * expected.mass) ** 2
    trust = nominal / (nominal + measured)
    return expected.mass + trust * (float(np.mean(readings)) - expected.mass)
