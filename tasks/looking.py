"""Looking: where a thing is, from as many frames of the camera as its noise calls for."""

from collections.abc import Generator

import numpy as np
from mink import SE3, SO3
from scipy.spatial.transform import Rotation

from robo47_qp.simulation import Simulation
from robo47_qp.steps import Step, Wait

_GOOD_ENOUGH = 1e-3
"""Standard deviation of a position that is worked with [m]."""
_FRAME = 1.0 / 30.0
"""Time between two frames of the camera [s]."""


def look(
    simulation: Simulation, name: str, height: float | None = None
) -> Generator[Step, None, SE3]:
    """Stand still and look at an object that stands still; with a noisy camera, for a while.

    Independent errors of n frames leave σ/√n in their mean.

    Args:
        simulation: The world.
        name: Of the object.
        height: Of its frame in the world, where it is known otherwise; taken for that in place
            of what a noisy camera sees [m].
    """
    frames = max(1, int(np.ceil((simulation.camera_noise / _GOOD_ENOUGH) ** 2)))
    seen = [simulation.seen_pose(name)]
    for _ in range(frames - 1):
        yield Wait(name=f"look at {name}", seconds=_FRAME)
        seen.append(simulation.seen_pose(name))
    if frames == 1:
        return seen[0]
    turns = Rotation.from_quat([pose.rotation().wxyz for pose in seen], scalar_first=True)
    position = np.mean([pose.translation() for pose in seen], axis=0)
    if height is not None:
        position[2] = height
    quaternion = turns.mean().as_quat(scalar_first=True)
    return SE3.from_rotation_and_translation(SO3(quaternion), position)
