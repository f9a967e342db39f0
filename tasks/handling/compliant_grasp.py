"""Compliant grasp of an item whose position is uncertain."""

from collections.abc import Generator
from dataclasses import replace

import numpy as np
from mink import SE3

from robo47_qp.model.gripper import Grip
from robo47_qp.run.compliance import Compliance
from robo47_qp.run.contact_steps import Press
from robo47_qp.run.failure import Cause, Condition
from robo47_qp.run.steps import Grasp, StepLike
from robo47_qp.sim.sensed import Sensed
from robo47_qp.tasks.handling.pose_estimate import camera_errs, coordinate_error
from robo47_qp.tasks.item import Item

_DEVIATIONS = 3.0
"""Distance of each finger from the item up to which the gripper closes fast, in standard deviations
of where the item is."""
_GENTLY = 0.01
"""Rate of the opening width when one finger touches before the other, as one does even where the
item's pose is known [m/s]. At the gripper's full speed, the impact exceeds the rated acceleration
of the joints, at 20 mm/s still that of the wrist of an iiwa14."""
_SOFTLY = 0.005
"""The same for an item that tips over easily [m/s]: it is caught between a finger and a stiff arm
that goes towards it."""
_FEELS = 0.1
"""Force on a finger that touches [N], a third of what tips a slender peg over."""
_BACK, _BACK_MASS, _CLOSING = 1.0, 4.0, 8.0
"""Force and mass of the admittance with which an arm goes back from a finger [N, kg], and how long
fingers may close [s]."""
_YIELDING = np.array([800.0, 50.0, 800.0, 40.0, 40.0, 40.0])
"""Stiffness of the tool, in its own frame [N/m, N·m/rad]. Along y, where the fingers
close, 2 mm take 0.1 N: a slender peg tips over at 0.3 N."""


def compliant_grasp(
    sensed: Sensed, item: Item, T_world_item: SE3, grasp: Grasp, *, tips: bool = False
) -> Generator[StepLike, None, None]:
    """Close the fingers on an item, slowly, and so that they centre if the camera errs.

    Fingers that are not centred on the item push it and the arm aside. A compliant arm lets them
    centre, as far as friction in its joints does: for items that tip over more easily, see
    `centre`. Fails with GRASP where only one finger touches such an item.

    Args:
        sensed: What is sensed.
        item: The item between the fingers.
        T_world_item: Its estimated pose.
        grasp: The grasp to use if the pose is known.
        tips: Whether the item tips over at less than that friction.
    """
    grasp = replace(grasp, speed=_GENTLY)
    if camera_errs(sensed) and tips:
        grasp = replace(grasp, speed=_SOFTLY)
        yield from centre(sensed, item, T_world_item, grasp)
    elif camera_errs(sensed):
        yield from _close_around(sensed, item, T_world_item, grasp)
        springs = Compliance(stiffness=_YIELDING, frame="tool")
        grasp = replace(grasp, compliance=springs)
    yield grasp


def centre(
    sensed: Sensed, item: Item, T_world_item: SE3, grasp: Grasp
) -> Generator[StepLike, None, float]:
    """Close the fingers until both touch an item that tips over easily, and hardly press on it.

    Fails with GRASP where only one does.

    Args:
        sensed: What is sensed.
        item: The item between the fingers.
        T_world_item: Its estimated pose.
        grasp: The grasp that is to follow.

    Returns:
        The opening width from which they closed slowly [m].
    """
    width = yield from _close_around(sensed, item, T_world_item, grasp)
    yield _centre(sensed, replace(grasp, speed=_SOFTLY))
    return width


def _close_around(
    sensed: Sensed, item: Item, T_world_item: SE3, grasp: Grasp
) -> Generator[StepLike, None, float]:
    near = width_around(sensed, item, T_world_item)
    if near < sensed.width():
        yield Grasp(name="close around", force=grasp.force, width=near)
    return near


def _centre(sensed: Sensed, grasp: Grasp) -> Press:
    """Return the step that centres closing fingers on an item until both touch it.

    The stiff arm goes back from the finger that touches alone, twice as fast as that closes: as it
    soon no longer touches, it hardly pushes the item along.
    """

    def felt() -> float:
        first, second = sensed.finger_forces() > _FEELS
        return _BACK * (1.0 - float(first) + float(second))

    def against() -> str | None:
        first, second = sensed.finger_forces()
        return None if min(first, second) > _FEELS else f"they feel {first:.1f} and {second:.1f} N"

    return Press(
        name=grasp.name,
        axis=sensed.tool_pose().rotation().as_matrix()[:, 1],
        force=_BACK,
        mass=_BACK_MASS,
        damping=_BACK / grasp.speed,
        felt=felt,
        meanwhile=Grip(width=grasp.width, force=grasp.force, speed=grasp.speed),
        seconds=_CLOSING,
        until=Condition(name="both fingers touch", cause=Cause.GRASP, against=against),
    )


def width_around(
    sensed: Sensed, item: Item, T_world_item: SE3, deviations: float = _DEVIATIONS
) -> float:
    """Return the opening width up to which fingers may close fast around a seen item [m].

    No more than they are open, and than they may open: a soft end stop gives way a little.

    Args:
        sensed: What is sensed.
        item: The item.
        T_world_item: Where it is seen.
        deviations: Standard deviations of what the camera errs that are left on both sides.
    """
    room = 2.0 * deviations * coordinate_error(sensed)
    wanted = item.width(sensed.tool_pose(), T_world_item) + room
    return min(wanted, sensed.width(), sensed.gripper.width_max)
