"""Poses of objects at rest, from as many camera images as the noise requires."""

from collections.abc import Generator, Sequence
from math import ceil, exp

import numpy as np
from mink import SE3, SO3
from scipy.spatial.transform import Rotation
from scipy.special import bdtrc

from robo47_qp.run.steps import Look, StepLike
from robo47_qp.sim.sensed import Sensed

GOOD_ENOUGH = 0.9e-3
"""Accepted standard deviation of a position [m]."""
_DEVIATIONS = 4.0
"""Standard deviations from the median beyond which an image is left out, per axis."""
_ALIKE = 1e-6
"""Distance from the median within which images agree [m]: what rests creeps a little."""
_UNLUCKY, _MOST = 1e-4, 300
"""Accepted probability that the median is of images that are wrong altogether, and how many images
are taken for it at most."""
_FROM_FOCUS = 0.3
"""Distance of an item from the point about which the camera's calibration is turned [m]."""
_CORNER = 0.045
"""Distance of an item's corner from its centre [m]."""
_LATE = 1.0
"""Time beyond the expected one in which images have to arrive [s]; without any, it is hidden."""


def estimate_pose(
    sensed: Sensed,
    name: str,
    height: float | None = None,
    good_enough: float = GOOD_ENOUGH,
) -> Generator[StepLike, None, SE3]:
    """Estimate the pose of an object at rest, or of a marker, while the arm stands still.

    Args:
        sensed: What is sensed.
        name: Name of the object or the marker.
        height: Known height of its frame in the world; replaces the one of a camera that errs [m].
        good_enough: Accepted standard deviation of a coordinate, but for the calibration [m].

    Returns:
        T_world_object.
    """
    seen = yield from estimate_poses(sensed, (name,), good_enough)
    return at_height(sensed, seen[name], height)


def at_height(sensed: Sensed, T_world_object: SE3, height: float | None) -> SE3:
    """Return a seen pose with the known height of its frame; see `estimate_pose`."""
    if height is None or not camera_errs(sensed):
        return T_world_object
    x, y, _ = T_world_object.translation()
    return SE3.from_rotation_and_translation(T_world_object.rotation(), np.array([x, y, height]))


def estimate_poses(
    sensed: Sensed, names: Sequence[str], good_enough: float = GOOD_ENOUGH
) -> Generator[StepLike, None, dict[str, SE3]]:
    """Estimate the poses of several objects or markers from the same images.

    Images that were taken before the call are not used, as the object may have moved in them;
    nor are those far from the median, which are wrong altogether. What the error of the camera's
    calibration makes wrong is the same in all images, and remains.

    Returns:
        T_world_object by name.
    """
    if not names:
        return {}
    start, period = sensed.time, 1.0 / float(sensed.sheet.noise["camera_rate"])
    frames = frames_needed(sensed, good_enough)
    end = start + 1.5 * frames * period + float(sensed.sheet.noise["camera_latency"]) + _LATE
    taken: dict[str, dict[float, SE3]] = {name: {} for name in names}
    while True:
        for name, images in taken.items():
            if sensed.seen_time(name) >= start - 1e-9:
                images[sensed.seen_time(name)] = sensed.seen_pose(name)
        awaited = [taken[name] for name in names if not hidden(sensed, name, start)]
        if all(len(images) >= frames for images in awaited) or sensed.time > end:
            break
        left = start + frames * period - sensed.time
        yield Look(name=f"look at {', '.join(names)}", seconds=period, lasts=left)
    # Of what is hidden from the camera, the last that it saw is known.
    return {
        name: _mean(list(images.values()) or [sensed.seen_pose(name)], sensed.camera_noise)
        for name, images in taken.items()
    }


def hidden(sensed: Sensed, name: str, since: float) -> bool:
    """Return whether the camera has not seen an object since a time [s], and does not see it."""
    taken, latency = sensed.seen_time(name), float(sensed.sheet.noise["camera_latency"])
    return taken < since - 1e-9 and sensed.time > since + latency + _LATE


def camera_errs(sensed: Sensed) -> bool:
    """Return whether the data sheet tells of an error of seen poses."""
    noise = sensed.sheet.noise
    names = ("pose_noise", "pose_bias", "rotation_bias", "heading_noise")
    return any(noise[name] for name in names)


def coordinate_error(sensed: Sensed) -> float:
    """Return the standard deviation of an estimated coordinate of an item, by the data sheet [m].

    That of `GOOD_ENOUGH` images, and of the camera's calibration, which is the same in all.
    """
    noise = sensed.sheet.noise
    turned = _FROM_FOCUS * float(noise["rotation_bias"])
    return float(np.linalg.norm([GOOD_ENOUGH, float(noise["pose_bias"]), turned]))


def frames_needed(sensed: Sensed, good_enough: float) -> int:
    """Return how many images give a mean coordinate of this standard deviation [m].

    A heading counts as what it moves an item's corner by.

    Errors σ of successive images have the correlation φ = exp(-T / τ), so that the mean of n has
    the variance σ²/n (1 + φ)/(1 - φ), for many (Priestley, Spectral Analysis and Time Series,
    1981, sec. 5.3.2). In more than half of the images, the object has to be where it is.
    """
    noise = sensed.sheet.noise
    tau = float(noise["pose_noise_time"])
    kept = exp(-1.0 / (float(noise["camera_rate"]) * tau)) if tau else 0.0
    alike = (1.0 + kept) / (1.0 - kept)
    each = max(sensed.camera_noise, _CORNER * float(noise["heading_noise"]))
    frames = max(1, ceil(alike * (each / good_enough) ** 2))
    wrong = float(noise["outliers"])
    while frames < _MOST and bdtrc((frames - 1) // 2, frames, wrong) > _UNLUCKY:
        frames += 1
    return frames


def _mean(poses: Sequence[SE3], noise: float) -> SE3:
    """Return the mean of poses without those that are far from the median."""
    if len(poses) == 1:
        return poses[0]
    positions = np.array([pose.translation() for pose in poses])
    off = np.abs(positions - np.median(positions, axis=0)).max(axis=1)
    near = off <= max(_DEVIATIONS * noise, float(np.median(off)), _ALIKE)
    wxyz = np.array([pose.rotation().wxyz for pose in poses])[near]
    quaternion = Rotation.from_quat(wxyz, scalar_first=True).mean().as_quat(scalar_first=True)
    return SE3.from_rotation_and_translation(SO3(quaternion), positions[near].mean(axis=0))
