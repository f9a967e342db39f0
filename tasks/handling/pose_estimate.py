"""Pose of objects at rest, averaged over as many camera images as the noise requires."""

from collections.abc import Generator, Sequence

import numpy as np
from mink import SE3, SO3
from scipy.spatial.transform import Rotation

from robo47_qp.run.steps import StepLike, Wait
from robo47_qp.sim.simulation import Simulation

_GOOD_ENOUGH = 1e-3
"""Accepted standard deviation of a position [m]."""
_FRAME = 1.0 / 30.0
"""Time between two images of the camera [s]."""


def estimate_pose(
    simulation: Simulation, name: str, height: float | None = None
) -> Generator[StepLike, None, SE3]:
    """Estimate the pose of an object at rest, or of a marker, while the arm stands still.

    Args:
        simulation: The simulated world.
        name: Name of the object or the marker.
        height: Known height of its frame in the world; replaces the one of a noisy camera [m].

    Returns:
        T_world_object.
    """
    seen = yield from estimate_poses(simulation, (name,))
    T_world_object = seen[name]
    if height is None or not simulation.camera_noise:
        return T_world_object
    x, y, _ = T_world_object.translation()
    return SE3.from_rotation_and_translation(T_world_object.rotation(), np.array([x, y, height]))


def estimate_poses(
    simulation: Simulation, names: Sequence[str]
) -> Generator[StepLike, None, dict[str, SE3]]:
    """Estimate the poses of several objects or markers from the same images; see `look`.

    The mean of n images with independent errors σ has the error σ/√n.

    Returns:
        T_world_object by name.
    """
    frames = max(1, int(np.ceil((simulation.camera_noise / _GOOD_ENOUGH) ** 2)))
    seen = [[_seen(simulation, name)] for name in names]
    for _ in range(frames - 1 if names else 0):
        yield Wait(name=f"look at {', '.join(names)}", seconds=_FRAME)
        for poses, name in zip(seen, names, strict=True):
            poses.append(_seen(simulation, name))
    return {name: _mean(poses) for name, poses in zip(names, seen, strict=True)}


def _seen(simulation: Simulation, name: str) -> SE3:
    if name in simulation.markers:
        return simulation.seen_marker(name)
    return simulation.seen_pose(name)


def _mean(poses: Sequence[SE3]) -> SE3:
    if len(poses) == 1:
        return poses[0]
    turns = Rotation.from_quat([pose.rotation().wxyz for pose in poses], scalar_first=True)
    position = np.mean([pose.translation() for pose in poses], axis=0)
    quaternion = turns.mean().as_quat(scalar_first=True)
    return SE3.from_rotation_and_translation(SO3(quaternion), position)
