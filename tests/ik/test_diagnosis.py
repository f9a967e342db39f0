"""Reasons of failed searches, each claim checked by scipy on MuJoCo's kinematics alone."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.diagnosis import diagnosed
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import (
    IkResult,
    ReachEvidence,
    Reason,
    Tolerance,
    judged,
)
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import Robot
from tests.examples import shifted, turned
from tests.plain_arm import PlainArm, welded_file
from tests.small_robots import gantry

SOLVER = MultiStart(solver=LmIk(max_iterations=20, stall=Stall()), max_restarts=60)
ENOUGH = 4
"""Failures of each kind to look at."""
Failure = tuple[SE3, IkResult]


def residual(plain: PlainArm, target: SE3, rows: int) -> Callable[[Vector], Vector]:
    R_target = target.rotation().as_matrix()

    def error(q: Vector) -> Vector:
        position, R = plain.tool(q)
        turn = Rotation.from_matrix(R_target @ R.T).as_rotvec()
        return np.concatenate([target.translation() - position, turn])[:rows]

    return error


def pose_matrix(plain: PlainArm, q: Vector) -> Matrix:
    T = np.eye(4)
    T[:3, 3], T[:3, :3] = plain.tool(q)
    return T


def slope(plain: PlainArm, rows: int) -> Callable[[Vector], Matrix]:
    """Of the residual but for the turn's bend: the slope of its square is exact."""
    m, d = plain.full, mujoco.MjData(plain.full)
    joints = [m.joint(name) for name in plain.robot.joints]
    places = [int(joint.qposadr[0]) for joint in joints]
    columns = [int(joint.dofadr[0]) for joint in joints]
    site, Jp, Jr = m.site(plain.robot.tcp).id, np.zeros((3, m.nv)), np.zeros((3, m.nv))

    def J(q: Vector) -> Matrix:
        d.qpos[places] = q
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_jacSite(m, d, Jp, Jr, site)
        return -np.vstack([Jp, Jr])[:rows, columns]

    return J


def least_error(
    plain: PlainArm,
    target: SE3,
    bounds: tuple[Vector, Vector],
    *,
    rows: int = 6,
    starts: int,
    rng: np.random.Generator,
) -> float:
    """Norm of what remains at best, from random configurations inside the limits."""
    found = []
    error, J = residual(plain, target, rows), slope(plain, rows)
    for _ in range(starts):
        q_start = rng.uniform(plain.q_min, plain.q_max)
        ends = least_squares(error, q_start, J, bounds, method="dogbox", max_nfev=40)
        found.append(float(np.linalg.norm(ends.fun)))
        if found[-1] < 1e-7:
            break
    return min(found)


@pytest.fixture(scope="module")
def failures(arm: Arm) -> dict[str, list[Failure]]:
    """What is not reached of poses thrown into the room, by the kind of reason."""
    rng = np.random.default_rng(6)
    found: dict[str, list[Failure]] = {"limits": [], "orientation": [], "reach": []}
    boxes = (
        (np.array([-0.15, -0.15, -0.1]), np.array([0.15, 0.15, 0.5])),
        (np.array([-0.85, -0.85, -0.3]), np.array([0.85, 0.85, 1.15])),
    )
    for k in range(300):
        wxyz = rng.normal(size=4)
        rotation = SO3(wxyz / np.linalg.norm(wxyz))
        target = SE3.from_rotation_and_translation(rotation, rng.uniform(*boxes[k % 2]))
        if len(found[("limits", "reach")[k % 2]]) >= ENOUGH:
            continue
        result = SOLVER.solve(arm, target, arm.home)
        if result.reason is Reason.JOINT_LIMITS:
            found["limits"].append((target, result))
        elif result.reason is Reason.NOT_CONVERGED:
            found["orientation"].append((target, result))
        elif result.bound is ReachEvidence.SEARCH:
            found["reach"].append((target, result))
    assert all(len(kind) >= ENOUGH for kind in found.values())
    return found


def test_where_limits_are_the_reason_nothing_inside_them_reaches_the_pose(
    plain: PlainArm, failures: dict[str, list[Failure]], rng: np.random.Generator
) -> None:
    inside = plain.q_min, plain.q_max
    for target, result in failures["limits"][:ENOUGH]:
        assert least_error(plain, target, inside, starts=12, rng=rng) > 1e-4
        assert plain.inside(result.q)
        assert result.beyond_reach == 0.0
        assert result.bound is None


def test_with_the_joints_that_are_named_let_loose_by_as_much_as_is_said_it_is_reached(
    plain: PlainArm, failures: dict[str, list[Failure]], rng: np.random.Generator
) -> None:
    said = re.compile(r"(\w+) is (\d+\.\d{3}) rad outside \[(-?\d+\.\d{3}), (-?\d+\.\d{3})\]")
    for target, result in failures["limits"][:3]:
        numbers = said.findall(result.explanation)
        assert tuple(name for name, *_ in numbers) == result.joints
        low, high = plain.q_min.copy(), plain.q_max.copy()
        for name, beyond, *limits in numbers:
            i = plain.robot.joints.index(name)
            assert [float(end) for end in limits] == pytest.approx([low[i], high[i]], abs=6e-4)
            assert float(beyond) > 0.0
            low[i] -= float(beyond) + 1e-3
            high[i] += float(beyond) + 1e-3
        assert least_error(plain, target, (low, high), starts=60, rng=rng) < 1e-6


def test_where_it_is_the_orientation_the_position_alone_is_reached(
    plain: PlainArm, failures: dict[str, list[Failure]], rng: np.random.Generator
) -> None:
    everywhere = np.full(plain.n, np.inf)
    for target, result in failures["orientation"][:4]:
        assert re.match(
            r"the position is reached, but not with this orientation: \S+ mm and \S+° remain "
            r"after \d+ iterations from 61 starts$",
            result.explanation,
        )
        inside = plain.q_min, plain.q_max
        assert least_error(plain, target, inside, rows=3, starts=20, rng=rng) < 1e-6
        assert least_error(plain, target, (-everywhere, everywhere), starts=5, rng=rng) > 1e-3
        assert result.joints == ()
        assert result.beyond_reach == 0.0


def test_what_is_out_of_reach_is_so_by_the_least_distance(
    plain: PlainArm, failures: dict[str, list[Failure]], rng: np.random.Generator
) -> None:
    for target, result in failures["reach"][:6]:
        inside = plain.q_min, plain.q_max
        least = least_error(plain, target, inside, rows=3, starts=4, rng=rng)
        assert result.reason is Reason.OUT_OF_REACH
        assert least > 1e-4
        assert result.beyond_reach == pytest.approx(least, abs=3e-3)
        assert result.explanation == (
            f"the tool comes no closer than {result.beyond_reach:.4f} m to the position, "
            "without regard to its orientation"
        )
        assert result.joints == ()


def test_a_pose_within_reach_is_said_to_be_so_where_no_start_found_it(
    arm: Arm, plain: PlainArm
) -> None:
    """One step is too few, and the diagnosis has more."""
    hasty = MultiStart(solver=LmIk(max_iterations=1), max_restarts=2)
    target = turned(shifted(arm.pose(arm.home), np.array([0.1, 0.15, -0.1])), 0, 0.5)
    result = hasty.solve(arm, target, arm.home)
    assert result.reason is Reason.NOT_CONVERGED
    assert re.match(
        r"the pose is within reach, but \S+ mm and \S+° remain after \d+ iterations from 3 starts$",
        result.explanation,
    )
    assert (result.joints, result.bound, result.beyond_reach) == ((), None, 0.0)


def lost(arm: Arm, target: SE3) -> IkResult:
    """A search that ended at home."""
    result = judged(arm, target, arm.home, Tolerance(), 5)
    assert result.reason is Reason.NOT_CONVERGED
    return result


def test_everything_but_the_reason_is_that_of_the_best_search(
    arm: Arm, failures: dict[str, list[Failure]]
) -> None:
    for kind in failures.values():
        target, _ = kind[0]
        best = replace(lost(arm, target), restarts=4, seconds=0.25)
        found = diagnosed(arm, target, best, [arm.home], Tolerance())
        assert found.q.tolist() == arm.home.tolist()
        for name in ("position_error", "orientation_error", "limit_margin", "iterations"):
            assert getattr(found, name) == getattr(best, name)
        assert (found.restarts, found.seconds) == (4, 0.25)
        assert not found.converged


def test_a_reason_that_is_known_is_kept(arm: Arm, plain: PlainArm) -> None:
    far = judged(arm, SE3.from_translation(np.array([9.0, 0, 0])), arm.home, Tolerance(), 5)
    beyond = arm.home.copy()
    beyond[0] = plain.q_max[0] + 0.2
    outside = judged(arm, arm.pose(beyond), beyond, Tolerance(), 5)
    reached = judged(arm, arm.pose(arm.home), arm.home, Tolerance(), 5)
    for best in (far, outside, reached):
        assert diagnosed(arm, arm.pose(arm.home), best, [arm.home], Tolerance()) is best


def test_where_the_pose_is_reached_nothing_is_said_of_it(arm: Arm) -> None:
    """Something else that was asked for is missing; but an orientation alone is not the pose."""
    reached = judged(arm, arm.pose(arm.home), arm.home, Tolerance(), 5)
    missing = replace(reached, reason=Reason.NOT_CONVERGED)
    assert diagnosed(arm, arm.pose(arm.home), missing, [arm.home], Tolerance()) is missing
    beside = shifted(arm.pose(arm.home), np.array([0.05, 0.0, 0.0]))
    found = diagnosed(arm, beside, lost(arm, beside), [arm.home], Tolerance())
    assert found.explanation.startswith("the pose is within reach, but 50 mm and")


@pytest.mark.parametrize("turns", [1, -1, 2, -3])
def test_whole_turns_do_not_count(arm: Arm, plain: PlainArm, turns: int) -> None:
    q = plain.at(np.full(8, 0.4))
    wound = q + 2.0 * np.pi * turns * (np.arange(arm.n) == arm.n - 1)
    target = arm.pose(q)
    found = diagnosed(arm, target, lost(arm, target), [wound], Tolerance())
    assert found.reason is Reason.NOT_CONVERGED
    assert found.explanation.startswith("the pose is within reach, but ")
    # What is outside after them does.
    i = 0
    wound = q + 2.0 * np.pi * turns * (np.arange(arm.n) == i)
    wound[i] += plain.q_max[i] + 0.1 - q[i]
    target = arm.pose(wound)
    found = diagnosed(arm, target, lost(arm, target), [wound], Tolerance())
    assert found.joints == (arm.robot.joints[i],)
    assert f"{arm.robot.joints[i]} is 0.100 rad outside" in found.explanation


def test_a_slide_has_no_turns(robot: Robot, tmp_path: Path) -> None:
    path = welded_file(robot, tmp_path)
    root = ET.fromstring(path.read_text(encoding="utf-8"))
    (last,) = (joint for joint in root.iter("joint") if joint.get("name") == robot.joints[-1])
    last.attrib |= {"type": "slide", "range": "-0.2 0.2"}
    path.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    home = np.where(np.arange(7) == 6, 0.0, robot.home)
    arm = Arm(replace(robot, mjcf=path, home=home, slides=robot.joints[-1:]))
    q = arm.home.copy()
    q[-1] = 6.2
    # One start, already there: 2π less would be inside.
    target = arm.pose(q)
    best = replace(lost(arm, arm.pose(arm.home + 0.1)), iterations=1)
    found = diagnosed(arm, target, best, [q], Tolerance())
    assert found.reason is Reason.JOINT_LIMITS
    assert found.joints == (robot.joints[-1],)


def test_of_several_ways_beyond_the_limits_the_least_one_is_told(arm: Arm, plain: PlainArm) -> None:
    q = arm.home.copy()
    q[1] = plain.q_min[1] - 0.15
    target = arm.pose(q)
    free = LmIk(within_limits=False)
    rng = np.random.default_rng(1)
    ways = [q]
    while len(ways) < 5:
        end = free.solve(arm, target, q + rng.uniform(-0.6, 0.6, arm.n))
        if end.reason is Reason.JOINT_LIMITS:
            ways.append(end.q)
    beyond = [np.maximum(plain.q_min - w, w - plain.q_max).clip(0.0) for w in ways]
    order = np.argsort([b.sum() for b in beyond])
    assert len({round(float(b.sum()), 6) for b in beyond}) == 5
    names = [
        tuple(name for name, b in zip(plain.robot.joints, row, strict=True) if b > 0)
        for row in beyond
    ]
    for chosen in ([0, 1, 2, 3, 4], [4, 3, 2, 1, 0], list(order[1:]), list(order[::-1][:3])):
        starts = [ways[k] for k in chosen]
        least = min(chosen, key=lambda k: float(beyond[k].sum()))
        found = diagnosed(arm, target, lost(arm, target), starts, Tolerance())
        assert found.joints == names[least]
        for name, b in zip(plain.robot.joints, beyond[least], strict=True):
            if b > 0.0:
                assert f"{name} is {b:.3f} rad outside" in found.explanation


@pytest.mark.parametrize("beyond", [0.0, 2e-6, 1e-4, 0.95e-3, 1.05e-3])
def test_out_of_reach_begins_at_the_tolerance(tmp_path: Path, beyond: float) -> None:
    """Three slides reach 2 m, and a hinge about y never turns the tool about x."""
    arm = Arm(gantry(tmp_path, 'type="sphere" size="0.01"'))
    q = np.array([2.0 + beyond, 0.3, -0.2, 0.0])
    target = turned(arm.pose(q), 0, 0.5)
    found = diagnosed(arm, target, lost(arm, target), [arm.home], Tolerance(position=1e-6))
    if beyond > 1e-6:
        assert found.reason is Reason.OUT_OF_REACH
        assert found.bound is ReachEvidence.SEARCH
        assert found.beyond_reach == pytest.approx(beyond, rel=0.01)
    else:
        assert found.reason is Reason.NOT_CONVERGED
        assert found.explanation.startswith("the position is reached, but not with this")


def test_the_tolerance_is_that_of_the_search(arm: Arm, failures: dict[str, list[Failure]]) -> None:
    """Where a wide one is enough, nothing is out of reach."""
    target, result = failures["reach"][0]
    starts = [arm.home, result.q]
    wide = Tolerance(position=result.beyond_reach + 0.01, orientation=1e-6)
    found = diagnosed(arm, target, lost(arm, target), starts, wide)
    assert found.reason is not Reason.OUT_OF_REACH
    tight = diagnosed(arm, target, lost(arm, target), starts, Tolerance())
    assert tight.reason is Reason.OUT_OF_REACH


def test_the_distance_that_is_left_is_the_least_from_any_start(
    arm: Arm, failures: dict[str, list[Failure]], rng: np.random.Generator
) -> None:
    differ = 0
    for target, result in failures["reach"]:
        best = replace(result, reason=Reason.NOT_CONVERGED)
        starts = [arm.drawn(rng) for _ in range(8)]
        left = [
            diagnosed(arm, target, best, one, SOLVER.tolerance).beyond_reach
            for one in (starts, starts[::-1], *([start] for start in starts))
        ]
        assert left[0] == left[1] == min(left[2:])
        differ += left[2] > left[0] + 1e-3 or left[-1] > left[0] + 1e-3
    assert differ > 0
