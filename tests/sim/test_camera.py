"""The camera's errors, over many seeds."""

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.sim.camera import CameraNoise, ObjectCamera

NOISE = CameraNoise(position=5e-3, heading=0.05, bias=3e-3, rate=30.0)
T = {
    "left": SE3.from_rotation_and_translation(SO3.from_x_radians(0.4), np.array([0.4, 0.1, 0.0])),
    "right": SE3.from_translation(np.array([0.5, -0.1, 0.2])),
}


def errors(seed: int, frames: int = 5) -> np.ndarray:
    """What is seen less the truth: position and turn, (objects, frames, 4)."""
    camera = ObjectCamera(tuple(T), NOISE, seed)
    found = []
    for k in range(frames):
        camera.watch(k / 30.0, T.__getitem__)
        for name, truth in T.items():
            seen = camera.seen(name)
            turn = (seen.rotation() @ truth.rotation().inverse()).log()
            assert turn[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
            found.append([*(seen.translation() - truth.translation()), turn[2]])
    return np.array(found).reshape(frames, len(T), 4).swapaxes(0, 1)


def test_errors_are_as_large_as_asked_for_and_new_in_every_frame() -> None:
    found = np.array([errors(seed) for seed in range(300)])  # seeds, objects, frames, 4
    within = found - found.mean(axis=2, keepdims=True)
    frame = np.sqrt((within**2).sum(axis=(0, 1, 2)) / (300 * 2 * 4))
    assert frame == pytest.approx([5e-3, 5e-3, 5e-3, 0.05], rel=0.06)
    means = found.mean(axis=2).reshape(-1, 4)
    lasting = means.var(axis=0) - frame**2 / 5
    assert np.sqrt(lasting[:3]) == pytest.approx([3e-3] * 3, rel=0.15)
    assert lasting[3] < 0.005**2
    assert means.mean(axis=0) == pytest.approx(np.zeros(4), abs=4e-3)
    assert means.mean(axis=0)[:3] == pytest.approx(np.zeros(3), abs=6e-4)


def test_errors_are_independent_of_each_other() -> None:
    found = np.array([errors(seed) for seed in range(300)])
    columns = found.reshape(300, -1)  # objects, frames, coordinates
    corner = np.corrcoef(columns.T)
    objects, _, axes = np.indices(found.shape[1:]).reshape(3, -1)
    # Frames of one object share its bias, coordinate by coordinate; nothing else is shared.
    shared = (objects[:, None] == objects) & (axes[:, None] == axes) & (axes < 3)
    assert np.abs(corner[~shared & ~np.eye(len(corner), dtype=bool)]).max() < 0.25
    alike = corner[shared & ~np.eye(len(corner), dtype=bool)]
    assert alike.mean() == pytest.approx(9 / (9 + 25), abs=0.05)


def test_a_frame_that_is_taken_again_shows_the_new_place_with_the_same_error() -> None:
    camera = ObjectCamera(("left",), NOISE, 1)
    camera.take(0.0, T.__getitem__)
    before = camera.seen("left").translation() - T["left"].translation()
    camera.watch(0.03, lambda _: T["right"])
    assert camera.seen("left").translation() - T["left"].translation() == pytest.approx(before)
    camera.take(0.03, lambda _: T["right"])
    assert camera.seen("left").translation() - T["right"].translation() == pytest.approx(before)
