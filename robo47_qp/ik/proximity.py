"""What the judge of IK says about collisions."""

from typing import NamedTuple

from robo47_qp.arm import Arm
from robo47_qp.arrays import Vector
from robo47_qp.ik.clearance import clearance_of


class Proximity(NamedTuple):
    """The closest pair of a configuration."""

    distance: float
    """Signed distance [m]."""
    pair: tuple[str, str]
    """Bodies of the robot, names of obstacles."""
    inevitable: bool
    """True where the pose of the tool settles that this is too close, whatever the joints."""


def proximity(arm: Arm, q: Vector, asked: float, leeway: float) -> Proximity:
    """The closest pair at q; one of the tool with what stands still, where that is too close.

    Args:
        arm: The arm with its obstacles.
        q: Configuration (n,) [rad].
        asked: Clearance that is asked for [m].
        leeway: How far any point of the tool may be from where the target puts it [m].
    """
    clearance = clearance_of(arm, asked)
    distance, pair = clearance.nearest(q)
    if distance < asked:
        of_tool, tool_pair = clearance.nearest_of_tool(q)
        if of_tool < asked - leeway:
            return Proximity(of_tool, tool_pair, True)
    return Proximity(distance, pair, False)


def too_close(found: Proximity, asked: float) -> str:
    """A clearance that is not kept, in words."""
    a, b = found.pair
    apart = f"are {1e3 * found.distance:.1f} mm apart"
    overlap = f"overlap by {-1e3 * found.distance:.1f} mm"
    always = ", whatever the joints" if found.inevitable else ""
    return (
        f"{a} and {b} {overlap if found.distance < 0.0 else apart}{always}; "
        f"{1e3 * asked:.3g} mm are asked"
    )
