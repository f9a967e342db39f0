"""The camera's errors, over many seeds."""

from typing import Any

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.sim.camera import FOCUS, ObjectCamera
from robo47_qp.sim.sensing import SensorErrors

FRAME = 1.0 / 30.0
T = {
    "left": SE3.from_rotation_and_translation(SO3.from_x_radians(0.4), np.array([0.4, 0.1, 0.0])),
    "right": SE3.from_translation(np.array([0.5, -0.1, 0.2])),
}


def camera(seed: int = 1, **errors: Any) -> ObjectCamera:
    made = ObjectCamera(tuple(T), SensorErrors(**errors), seed)
    made.start(0.0, T.__getitem__)
    return made


def errors(seed: int, frames: int = 5, **wrong: Any) -> np.ndarray:
    """What is seen less the truth: position and rotation vector, (objects, frames, 6)."""
    made, found = camera(seed, **wrong), []
    for k in range(frames):
        made.watch(k * FRAME, T.__getitem__)
        for name, truth in T.items():
            seen = made.seen(name).pose
            turn = (seen.rotation() @ truth.rotation().inverse()).log()
            found.append([*(seen.translation() - truth.translation()), *turn])
    return np.array(found).reshape(frames, len(T), 6).swapaxes(0, 1)


def test_noise_is_as_large_as_asked_for_and_without_a_time_new_in_every_frame() -> None:
    found = np.array([errors(seed, pose_noise=5e-3, heading_noise=0.05) for seed in range(300)])
    assert found.std(axis=(0, 1, 2)) == pytest.approx([5e-3] * 3 + [0, 0, 0.05], rel=0.05, abs=1e-9)
    assert found.mean(axis=(0, 1, 2)) == pytest.approx(np.zeros(6), abs=3e-3)
    columns = found[..., [0, 1, 2, 5]].reshape(300, -1)  # objects, frames, coordinates
    assert np.abs(np.corrcoef(columns.T) - np.eye(columns.shape[1])).max() < 0.25


@pytest.mark.parametrize("time_constant", [0.1, 0.3])
def test_noise_fades_with_its_time_constant(time_constant: float) -> None:
    wrong = {"pose_noise": 2e-3, "heading_noise": 0.05, "pose_noise_time": time_constant}
    found = np.array([errors(seed, 20, **wrong) for seed in range(200)])[..., [0, 1, 2, 5]]
    scaled = found / [2e-3, 2e-3, 2e-3, 0.05]
    assert scaled.std() == pytest.approx(1.0, rel=0.06)
    for frames in (1, 5, 15):
        fit = (scaled[:, :, frames:] * scaled[:, :, :-frames]).mean()
        assert fit == pytest.approx(np.exp(-frames * FRAME / time_constant), abs=0.06)
    one, other = scaled[:, 0].ravel(), scaled[:, 1].ravel()
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.08


def test_the_bias_is_one_rigid_motion_of_everything_that_stays() -> None:
    for seed in range(20):
        made, moves = camera(seed, pose_bias=3e-3, rotation_bias=0.02), []
        for k in range(3):
            made.watch(k * FRAME, T.__getitem__)
            moves += [made.seen(name).pose @ truth.inverse() for name, truth in T.items()]
        for move in moves:
            assert move.as_matrix() == pytest.approx(moves[0].as_matrix(), abs=1e-12)
    drawn = []
    for seed in range(600):
        made = camera(seed, pose_bias=3e-3, rotation_bias=0.02)
        move = made.seen("left").pose @ T["left"].inverse()
        drawn.append([*(move @ FOCUS - FOCUS), *move.rotation().log()])
    assert np.std(drawn, axis=0) == pytest.approx([3e-3] * 3 + [0.02] * 3, rel=0.1)
    assert np.mean(drawn, axis=0) == pytest.approx(np.zeros(6), abs=2.5e-3)
    assert np.abs(np.corrcoef(np.transpose(drawn)) - np.eye(6)).max() < 0.15


def falling(time: float) -> dict[str, SE3]:
    """Both things, 1 m/s to the left."""
    return {name: SE3.from_translation(np.array([0.0, time, 0.0])) @ at for name, at in T.items()}


def watched(made: ObjectCamera, seconds: float) -> np.ndarray:
    """How old what is seen is, in every millisecond [s]; by its stamp and by its place."""
    ages = []
    for k in range(1, round(seconds * 1000)):
        now = 1e-3 * k
        made.watch(now, falling(now).__getitem__)
        seen = made.seen("left")
        ages.append([now - seen.time, now - (seen.pose.translation()[1] - 0.1)])
    return np.array(ages)


@pytest.mark.parametrize("latency", [0.0, 0.05, 0.2])
def test_poses_come_late_by_the_latency_and_tell_when_they_were_taken(latency: float) -> None:
    ages = watched(camera(camera_latency=latency), 2.0)
    assert ages[:, 0] == pytest.approx(ages[:, 1], abs=1e-9)
    later = ages[round(1000 * latency) + 40 :, 0]
    assert later.min() == pytest.approx(latency, abs=1.1e-3)
    assert later.max() == pytest.approx(latency + FRAME, abs=1.1e-3)


def test_lost_frames_are_so_many_and_leave_the_last_one() -> None:
    ages = watched(camera(dropped_frames=0.3), 60.0)
    frames = 1 + np.count_nonzero(np.diff(ages[:, 0]) < 0)
    assert frames / (60.0 * 30) == pytest.approx(0.7, abs=0.03)
    assert ages[:, 0].max() > 2 * FRAME
    assert ages[:, 0] == pytest.approx(ages[:, 1], abs=1e-9)


def test_outliers_are_so_many_and_so_far_off_in_any_direction() -> None:
    found = np.array([errors(seed, 50, outliers=0.1, outlier_size=0.03) for seed in range(60)])
    away = np.linalg.norm(found[..., :3], axis=-1)
    wrong = away > 1e-9
    assert wrong.mean() == pytest.approx(0.1, abs=0.012)
    assert away[wrong] == pytest.approx(0.03)
    assert found[wrong][:, :3].mean(axis=0) == pytest.approx(np.zeros(3), abs=3e-3)
    # Those of a frame and those of things are independent.
    assert (wrong[:, 0] & wrong[:, 1]).mean() == pytest.approx(0.01, abs=0.005)
    assert (wrong[..., 1:] & wrong[..., :-1]).mean() == pytest.approx(0.01, abs=0.005)


def test_what_is_hidden_stays_where_it_was_seen() -> None:
    hidden = {"left"}
    made = ObjectCamera(tuple(T), SensorErrors(occlusion=1), 1, hidden.__contains__)
    made.start(0.0, T.__getitem__)
    assert made.seen("left").pose.as_matrix() == pytest.approx(T["left"].as_matrix())
    made.watch(0.5, falling(0.5).__getitem__)
    assert (made.seen("left").time, made.seen("right").time) == (0.0, 0.5)
    hidden.clear()
    made.watch(0.6, falling(0.6).__getitem__)
    assert made.seen("left").time == 0.6


def test_a_thing_that_is_put_elsewhere_is_seen_there_with_the_same_error() -> None:
    wrong: dict[str, Any] = {
        "pose_noise": 5e-3,
        "pose_bias": 3e-3,
        "camera_latency": 0.1,
        "outliers": 0.5,
    }
    made = camera(**wrong)
    before = made.seen("left").pose.translation() - T["left"].translation()
    made.watch(FRAME, T.__getitem__)
    made.place("left", 0.0, T["right"])
    after = made.seen("left").pose.translation() - T["right"].translation()
    assert np.linalg.norm(after) > 1e-4
    made.start(0.0, T.__getitem__)
    assert made.seen("left").pose.translation() - T["left"].translation() == pytest.approx(before)
    made.place("left", 0.0, T["right"])
    assert made.seen("left").pose.translation() - T["right"].translation() == pytest.approx(before)


def test_a_hidden_marker_tells_nothing_of_the_camera() -> None:
    """Where it is put is known: what is seen less that would be the calibration's error."""
    hidden = SE3.from_translation(np.array([0.0, 0.0, -1.0]))
    things = {**T, "done": hidden, "fallen": hidden}
    wrong = SensorErrors(pose_bias=0.01, rotation_bias=0.05, pose_noise=5.0, heading_noise=0.1)
    made = ObjectCamera(tuple(things), wrong, 1, put_away=lambda name, _: name == "done")
    made.start(0.0, things.__getitem__)
    for k in range(20):
        made.watch(k * FRAME, things.__getitem__)
        assert made.seen("done").pose.wxyz_xyz.tolist() == hidden.wxyz_xyz.tolist()
        for name in ("left", "right", "fallen"):
            off = made.seen(name).pose.translation() - things[name].translation()
            assert np.linalg.norm(off) > 1e-3
