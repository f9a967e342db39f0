"""The mended frame tasks against the exponential and the logarithm of matrices, and mink's own."""

import importlib

import mink
import numpy as np
import pytest
from mink import SE3, SO3
from scipy.linalg import expm, logm

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.mended import FrameTask, RelativeFrameTask
from robo47_qp.model.arm import Arm
from tests.robots import arm_of

AXES = (*np.eye(3), np.array([2.0, -1.0, 2.0]) / 3.0)
ANGLES = (0.0, 1e-9, 1e-6, 9e-6, 1.1e-5, 1e-4, 0.99e-3, 1.01e-3, 0.05, 1.0, 3.0, np.pi - 1e-4)
P = np.array([0.3, -0.5, 0.2])
Task = mink.FrameTask | mink.RelativeFrameTask


@pytest.fixture
def arm() -> Arm:
    return arm_of("panda")


def configuration(arm: Arm) -> mink.Configuration:
    return mink.Configuration(arm.model, arm.home + 0.1)


def task_of(kind: type[Task]) -> Task:
    if issubclass(kind, mink.FrameTask):
        return kind("tcp", "site", [1.0, 2.0, 3.0], [0.5, 0.6, 0.7], gain=0.9, lm_damping=0.01)
    return kind("tcp", "site", "link1", "body", [1.0, 2.0, 3.0], 0.5, gain=0.9, lm_damping=0.01)


def turn(axis: Vector, angle: float) -> SO3:
    return SO3(np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis]))


def frame_pose(task: Task, c: mink.Configuration, q: Vector) -> SE3:
    """The pose of the frame at q: in the world, or in the root frame."""
    kept = c.q
    c.update(q)
    if isinstance(task, mink.FrameTask):
        pose = c.get_transform_frame_to_world("tcp", "site")
    else:
        pose = c.get_transform("tcp", "site", "link1", "body")
    c.update(kept)
    return pose


def aim(task: Task, c: mink.Configuration, rotation: SO3, p: Vector = P) -> None:
    """Set a target at a place and a turn away from the frame."""
    way = SE3.from_rotation_and_translation(rotation, p)
    task.set_target(frame_pose(task, c, c.q) @ way)


def error_pose(task: Task, c: mink.Configuration, q: Vector) -> Matrix:
    """The pose (4, 4) whose logarithm the error is."""
    frame = frame_pose(task, c, q).as_matrix()
    if isinstance(task, mink.FrameTask):
        assert task.transform_target_to_world is not None
        return np.asarray(np.linalg.inv(frame) @ task.transform_target_to_world.as_matrix())
    assert task.transform_target_to_root is not None
    return np.asarray(np.linalg.inv(task.transform_target_to_root.as_matrix()) @ frame)


def generator(twist: Vector) -> Matrix:
    x, y, z = twist[3:]
    out = np.zeros((4, 4))
    out[:3, :3], out[:3, 3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]], twist[:3]
    return out


def check_error_and_jacobian(task: Task, c: mink.Configuration) -> None:
    """exp(e) is the pose, and exp(e + J dq) follows it as the joints move: at half a turn, too."""
    e, J = task.compute_error(c), task.compute_jacobian(c)
    assert np.abs(expm(generator(e)) - error_pose(task, c, c.q)).max() < 1e-12
    assert np.linalg.norm(e[3:]) <= np.pi + 1e-12
    h = 1e-6
    for j, column in enumerate(J.T):
        dq = h * np.eye(len(c.q))[j]
        expected = error_pose(task, c, c.q + dq) - error_pose(task, c, c.q - dq)
        ends = expm(np.stack([generator(e + h * column), generator(e - h * column)]))
        assert np.abs(ends[0] - ends[1] - expected).max() / (2 * h) < 1e-8


@pytest.mark.parametrize("kind", [FrameTask, RelativeFrameTask])
@pytest.mark.parametrize("angle", [*ANGLES, np.pi])
def test_error_and_jacobian_are_right_at_every_angle(
    kind: type[Task], angle: float, arm: Arm
) -> None:
    c, task = configuration(arm), task_of(kind)
    for axis in AXES if angle in (1e-6, np.pi) else AXES[3:]:
        aim(task, c, turn(axis, angle))
        check_error_and_jacobian(task, c)


@pytest.mark.parametrize(
    ("kind", "angle"), [(FrameTask, 1e-4), (FrameTask, 2.0), (RelativeFrameTask, 1e-6)]
)
def test_the_jacobian_is_the_slope_of_the_logarithm_of_matrices(
    kind: type[Task], angle: float, arm: Arm
) -> None:
    c, task = configuration(arm), task_of(kind)
    aim(task, c, turn(AXES[3], angle))
    h = 1e-6

    def error(q: Vector) -> Vector:
        twist = np.real(logm(error_pose(task, c, q)))
        return np.array([*twist[:3, 3], twist[2, 1], twist[0, 2], twist[1, 0]])

    assert task.compute_error(c) == pytest.approx(error(c.q), abs=1e-9)
    for step, column in zip(h * np.eye(len(c.q)), task.compute_jacobian(c).T, strict=True):
        slope = (error(c.q + step) - error(c.q - step)) / (2 * h)
        assert column == pytest.approx(slope, abs=1e-7)


@pytest.mark.parametrize(
    ("kind", "plain"),
    [(FrameTask, mink.FrameTask), (RelativeFrameTask, mink.RelativeFrameTask)],
)
@pytest.mark.parametrize("angle", [2e-3, 0.05, 1.0, 3.1])
def test_elsewhere_it_is_the_task_of_mink(
    kind: type[Task], plain: type[Task], angle: float, arm: Arm
) -> None:
    c, ours, theirs = configuration(arm), task_of(kind), task_of(plain)
    for task in (ours, theirs):
        aim(task, c, turn(AXES[3], angle))
    for a, b in zip(ours.compute_qp_residual(c), theirs.compute_qp_residual(c), strict=True):
        assert a == pytest.approx(b, abs=1e-10)
    assert ours.compute_error(c) == pytest.approx(theirs.compute_error(c), abs=1e-10)
    assert ours.compute_jacobian(c) == pytest.approx(theirs.compute_jacobian(c), abs=1e-8)


@pytest.mark.parametrize("kind", [FrameTask, RelativeFrameTask])
@pytest.mark.parametrize("angle", [0.0, 5e-6, 0.5, np.pi])
def test_the_objective_is_made_of_error_and_jacobian(
    kind: type[Task], angle: float, arm: Arm
) -> None:
    """|C (J dq + gain e)|² / 2, and the damping."""
    c, task = configuration(arm), task_of(kind)
    aim(task, c, turn(AXES[2], angle))
    W, e, damping = task.compute_qp_residual(c)
    H, g = task.compute_qp_objective(c)
    assert pytest.approx(task.cost[:, None] * task.compute_jacobian(c), abs=1e-9) == W
    assert e == pytest.approx(-0.9 * task.cost * task.compute_error(c), abs=1e-12)
    assert damping == pytest.approx(0.01 * float(e @ e))
    assert pytest.approx(W.T @ W + damping * np.eye(len(c.q))) == H
    assert g == pytest.approx(-W.T @ e)


@pytest.mark.parametrize("kind", [FrameTask, RelativeFrameTask])
@pytest.mark.parametrize("angle", [1e-6, np.pi])
def test_solve_ik_takes_it_to_the_target(kind: type[Task], angle: float, arm: Arm) -> None:
    """From a start that is exactly a small turn, or half a turn, away from the target."""
    c = configuration(arm)
    task = task_of(kind)
    task.cost, task.gain, task.lm_damping = np.ones(6), 1.0, 0.0
    aim(task, c, turn(AXES[2], angle), 1e-3 * P)
    free = mink.Configuration(c.model, c.q)
    for _ in range(30):
        v = mink.solve_ik(free, [task], 1.0, "daqp", damping=1e-9, limits=[])
        free.integrate_inplace(np.clip(v, -0.3, 0.3), 1.0)
    assert np.abs(error_pose(task, c, free.q) - np.eye(4)).max() < 1e-9


@pytest.mark.parametrize("kind", [FrameTask, RelativeFrameTask])
def test_without_a_target_it_says_so(kind: type[Task], arm: Arm) -> None:
    c, task = configuration(arm), task_of(kind)
    for compute in (task.compute_error, task.compute_jacobian, task.compute_qp_residual):
        with pytest.raises(mink.TargetNotSet, match=kind.__name__):
            compute(c)


def test_what_it_returns_is_the_callers(arm: Arm) -> None:
    c, task = configuration(arm), task_of(FrameTask)
    aim(task, c, turn(AXES[0], 1e-5))
    error, J = task.compute_error(c), task.compute_jacobian(c)
    kept = error.copy(), J.copy()
    aim(task, c, turn(AXES[1], 1.0), -P)
    task.compute_qp_residual(c)
    assert task.compute_error(c) is not error
    assert error.tolist() == kept[0].tolist()
    assert J.tolist() == kept[1].tolist()


# What plain mink does ---------------------------------------------------------------------------


@pytest.mark.xfail(reason="mink 1.3: SO3.log of a quaternion with w = 0 is zero")
def test_mink_sees_half_a_turn() -> None:
    assert SO3(np.array([0.0, 1.0, 0.0, 0.0])).log() == pytest.approx([np.pi, 0.0, 0.0])


@pytest.mark.xfail(reason="mink 1.3: the same, where its compiled part is missing")
@pytest.mark.parametrize("plain", [mink.FrameTask, mink.RelativeFrameTask])
def test_without_its_compiled_part_minks_task_sees_half_a_turn(
    plain: type[Task], arm: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.import_module(plain.__module__), "_native", None)
    c, task = mink.Configuration(arm.model, np.zeros(7)), task_of(plain)
    for axis in np.eye(4)[1:]:
        aim(task, c, SO3(axis), np.zeros(3))
        assert np.linalg.norm(task.compute_error(c)) > 3.0


@pytest.mark.parametrize("kind", [FrameTask, RelativeFrameTask])
def test_the_mended_task_sees_it_without_the_compiled_part(
    kind: type[Task], arm: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.import_module("mink.tasks.frame_task"), "_native", None)
    monkeypatch.setattr(importlib.import_module("mink.tasks.relative_frame_task"), "_native", None)
    c, task = mink.Configuration(arm.model, np.zeros(7)), task_of(kind)
    for axis in np.eye(4)[1:]:
        aim(task, c, SO3(axis), np.zeros(3))
        assert np.linalg.norm(task.compute_error(c)) == pytest.approx(np.pi)
        check_error_and_jacobian(task, c)


@pytest.mark.xfail(reason="mink 1.3: SE3.jlog is the identity below 1e-5 rad")
@pytest.mark.parametrize("plain", [mink.FrameTask, mink.RelativeFrameTask])
def test_the_jacobian_of_minks_task_is_right_for_small_turns(plain: type[Task], arm: Arm) -> None:
    c, task = configuration(arm), task_of(plain)
    aim(task, c, turn(AXES[3], 5e-6))
    check_error_and_jacobian(task, c)


@pytest.mark.xfail(reason="mink 1.3: SE3.jlog is the identity below 1e-5 rad")
def test_the_slope_of_minks_logarithm_is_right_for_small_turns() -> None:
    pose, h = SE3.from_rotation_and_translation(turn(AXES[3], 5e-6), P), 1e-3
    for step, column in zip(h * np.eye(6), pose.jlog().T, strict=True):
        slope = (pose.plus(step).log() - pose.plus(-step).log()) / (2 * h)
        assert column == pytest.approx(slope, abs=1e-4)
