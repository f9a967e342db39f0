"""Reaching: poses that can be reached, each held, nothing touched."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError, ModelError, PlanError
from robo47_qp.model.arm import Arm
from robo47_qp.model.cell import in_cell
from robo47_qp.model.loading import robot_from_mjcf
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.branch_choice import BranchChoice
from robo47_qp.motion.waypoint import Waypoint
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.failure import Cause
from robo47_qp.run.runner import Runner
from robo47_qp.run.steps import Move, StepLike, Wait
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.reach.reach import Reach
from robo47_qp.tasks.task_state import hide_marker
from tests.examples import shifted
from tests.robots import MODELS, robot_or_skip
from tests.runs import Meddler, carry_out, live, make_runner


@cache
def _world() -> Simulation:
    return Simulation(PANDA, Reach().build_scene)


def distance(T: SE3, target: SE3) -> tuple[float, float]:
    """Position [m] and angle [rad]."""
    off = target.inverse() @ T
    angle = np.arccos(np.clip((np.trace(off.rotation().as_matrix()) - 1) / 2, -1.0, 1.0))
    return float(np.linalg.norm(off.translation())), float(angle)


@pytest.mark.parametrize("name", ["panda", "fr3", "ur5e", "xarm7", "iiwa14"])
def test_the_default_poses_are_in_reach_of_every_robot_as_it_stands(name: str) -> None:
    robot, task = in_cell(robot_or_skip(name), "reach"), Reach()
    simulation = Simulation(robot, task.build_scene)
    legs = Runner(ClassicalStack().scenario(robot, task), simulation).rehearse()
    assert len(legs) >= task.count == 5


@pytest.mark.parametrize("seed", [None, 0])
def test_every_pose_is_held(seed: int | None) -> None:
    task = Reach(count=2 if seed is None else 3)
    runner, simulation = make_runner(task, seed=seed)
    targets = {f"pose {i + 1}": simulation.marker_pose(f"pose {i + 1}") for i in range(task.count)}
    run = runner.run()
    assert run.failure is None
    assert [finding.signal for finding in audit(run) if not finding.ok] == []
    for name, target in targets.items():
        (hold,) = (i for i, phase in enumerate(run.phases) if phase.name == f"hold {name}")
        rows = slice(run.phases[hold].start, run.phases[hold + 1].start)
        # 0.2 s tell the speed, and 0.2 s are for certainty.
        assert 900 <= rows.stop - rows.start < 1000
        for pose in run.rows["tool/pose"][rows][-500::20]:
            position, angle = distance(SE3(np.concatenate([pose[3:], pose[:3]])), target)
            assert position < 1e-3
            assert angle < np.deg2rad(0.5)
    assert np.abs(run.rows["contact/links"]).max() == 0.0
    assert np.abs(run.rows["contact/tool"]).max() == 0.0
    assert run.measures["home_error_rad"] < 1e-3
    assert run.measures["poses_left"] == 0.0


def test_the_arm_goes_home_between_poses() -> None:
    steps = Reach(count=2).preview(live(_world()))
    names = [step.name for step in steps if isinstance(step, Move)]
    assert names == ["pose 1", "home", "pose 2", "home"]


# Poses


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_random_poses_lie_in_the_workspace(seed: int) -> None:
    task, simulation = Reach(), _world()
    before = simulation.data.qpos.copy()
    task.reset(simulation, np.random.default_rng(seed))
    np.testing.assert_array_equal(simulation.data.qpos, before)
    poses = [simulation.marker_pose(f"pose {i + 1}") for i in range(task.count)]
    for pose in poses:
        x, y, z = pose.translation()
        assert 0.35 <= np.hypot(x, y) <= 0.75
        assert x >= 0
        assert 0.15 <= z <= 0.60
        assert pose.rotation().as_matrix()[2, 2] <= -0.5
    task.reset(simulation, np.random.default_rng(seed))
    again = [simulation.marker_pose(f"pose {i + 1}") for i in range(task.count)]
    np.testing.assert_array_equal(
        [pose.wxyz_xyz for pose in poses], [pose.wxyz_xyz for pose in again]
    )


def test_random_poses_are_spread() -> None:
    task, simulation = Reach(), _world()
    poses = []
    for seed in range(12):
        task.reset(simulation, np.random.default_rng(seed))
        poses += [simulation.marker_pose(f"pose {i + 1}") for i in range(task.count)]
    places = np.array([pose.translation() for pose in poses])
    axes = np.array([pose.rotation().as_matrix()[:, 2] for pose in poses])
    assert places[:, 1].min() < -0.3
    assert places[:, 1].max() > 0.3
    assert places[:, 2].max() > 0.45
    assert np.median(np.rad2deg(np.arccos(-axes[:, 2]))) > 25.0


def test_every_robot_reaches_its_random_poses(robot: Robot) -> None:
    task = Reach()
    simulation = Simulation(robot, task.build_scene)
    task.reset(simulation, np.random.default_rng(0))
    scenario = ClassicalStack(ik="lm").scenario(robot, task)
    arm, ik = Arm(robot, obstacles=task.obstacles), scenario.planner.ik
    targets = [simulation.marker_pose(f"pose {i + 1}") for i in range(task.count)]
    if robot.name == "slider6":
        with pytest.raises(ModelError, match="none of its 8 geoms makes a pair"):
            ik.solve(arm, targets[0], np.array(robot.home))
        return
    results = [ik.solve(arm, target, np.array(robot.home)) for target in targets]
    assert all(result.converged for result in results)


def _with_knobs(path: Path) -> Robot:
    """An arm whose elbow folds up until its links meet, which MuJoCo passes over."""
    xml = (MODELS / "hinge6.xml").read_text()
    upper, fore = (
        '<geom fromto="0 0 0 0 0.38 0"/>',
        '<geom fromto="0 0 0 0.02 0.28 0" size="0.035"/>',
    )
    knobs = [(0.07 * side * np.sin(2.2), 0.4 + 0.07 * np.cos(2.2)) for side in (-1, 1)]
    balls = "".join(f'<geom type="sphere" size="0.03" pos="{x} {y} 0"/>' for x, y in knobs)
    path.write_text(
        xml.replace(upper, upper + balls).replace(
            fore, fore + '<geom type="sphere" size="0.03" pos="0 0.07 0"/>'
        )
    )
    return robot_from_mjcf(path, tcp="pointer", home=[0.0, -0.4, -0.8, 0.0, -1.2, 0.0])


def test_poses_for_which_links_meet_are_not_taken(tmp_path: Path) -> None:
    """A pose tells the angle of this elbow but for its sign, and there is a knob on both sides."""
    robot, task = _with_knobs(tmp_path / "knobs.xml"), Reach()
    simulation = Simulation(robot, task.build_scene)
    arm = Arm(robot, obstacles=task.obstacles)
    ik = ClassicalStack(ik="lm").scenario(robot, task).planner.ik
    for seed in range(8):
        task.reset(simulation, np.random.default_rng(seed))
        for i in range(task.count):
            result = ik.solve(arm, simulation.marker_pose(f"pose {i + 1}"), np.array(robot.home))
            assert result.converged, result.explanation


def test_a_workspace_out_of_reach_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robo47_qp.tasks.reach.reach._DISTANCE", (2.0, 3.0))
    monkeypatch.setattr("robo47_qp.tasks.reach.reach._DRAWS", 50)
    with pytest.raises(InvalidValueError, match=r"none of 50 configurations of panda in it"):
        Reach().reset(_world(), np.random.default_rng(0))


def test_configurations_that_touch_something_are_not_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Below the table the tool cannot be without the arm being in it."""
    monkeypatch.setattr("robo47_qp.tasks.reach.reach._HEIGHT", (-0.03, 0.0))
    monkeypatch.setattr("robo47_qp.tasks.reach.reach._DRAWS", 3000)
    with pytest.raises(InvalidValueError, match=r"none of 3000 configurations"):
        Reach().reset(_world(), np.random.default_rng(0))


# Failures


def test_a_pose_out_of_reach_is_a_failure_of_ik() -> None:
    runner, simulation = make_runner(Reach(count=1))
    simulation.place_marker("pose 1", SE3.from_translation(np.array([2.0, 0.0, 0.5])))
    run = runner.run()
    assert run.failure is not None
    assert run.failure.cause is Cause.IK
    assert "pose 1" in run.failure.evidence


def test_a_tool_that_never_holds_its_pose_is_a_failure_of_tracking() -> None:
    def move(simulation: Simulation) -> None:
        simulation.place_marker(
            "pose 1", shifted(simulation.marker_pose("pose 1"), np.array([0.0, 2e-3, 0.0]))
        )

    meddler = Meddler("hold pose 1", move, after=0.1)
    run = carry_out(Reach(count=1), observers=[meddler])
    assert meddler.done == 1
    assert run.failure is not None
    assert run.failure.cause is Cause.TRACK
    assert run.failure.step == "hold pose 1"
    assert run.failure.evidence.startswith("the tool is 2.0")


def test_a_pose_is_held_anew_after_a_push() -> None:
    def pushed(force: float) -> Callable[[Simulation], None]:
        def push(simulation: Simulation) -> None:
            simulation.data.xfrc_applied[simulation.model.body("hand").id, 1] = force

        return push

    meddlers = [
        Meddler("hold pose 1", pushed(40.0), after=0.1),
        Meddler("hold pose 1", pushed(0.0), after=0.5),
    ]
    run = carry_out(Reach(count=1), observers=meddlers)
    assert run.failure is None
    assert run.rows["errors/tool_position"].max() > 2e-3


@dataclass(frozen=True, kw_only=True)
class Displaced:
    """Judges a tool that is somewhere near its pose."""

    simulation: Simulation
    shift: Sequence[float] = (0.0, 0.0, 0.0)
    turn: float = 0.0

    def against(self) -> str | None:
        here = self.simulation.tool_pose()
        shifted = SE3.from_translation(np.array(self.shift)) @ here
        target = shifted @ SE3.from_rotation(SO3.from_x_radians(self.turn))
        self.simulation.place_marker("pose 1", target)
        steps: Sequence[StepLike] = list(_program(self.simulation))
        step = next(s for s in steps if isinstance(s, Wait) and s.name == "hold pose 1")
        condition = step.until
        assert condition is not None
        assert condition.cause is Cause.TRACK
        return condition.against()


def _program(simulation: Simulation) -> list[StepLike]:
    return list(Reach(count=1).program(live(simulation)))


@pytest.mark.parametrize(
    ("shift", "turn", "evidence"),
    [
        ((0.99e-3, 0, 0), 0.0, None),
        ((0, -1.01e-3, 0), 0.0, "1.01 mm and 0.00° from pose 1"),
        ((0.6e-3, 0.6e-3, 0.6e-3), 0.0, "1.04 mm"),
        ((0, 0, 0), np.deg2rad(0.49), None),
        ((0, 0, 0), np.deg2rad(-0.51), "0.51° from pose 1"),
    ],
)
def test_only_what_is_close_enough_is_held(
    shift: tuple[float, ...], turn: float, evidence: str | None
) -> None:
    simulation = Simulation(PANDA, Reach().build_scene)
    against = Displaced(simulation=simulation, shift=shift, turn=turn).against()
    assert against is not None
    assert (evidence or "at pose 1 tells little of its speed yet") in against


def test_a_tool_in_motion_is_not_held() -> None:
    simulation = Simulation(PANDA, Reach().build_scene)
    simulation.data.joint(PANDA.joints[2]).qvel[0] = 0.003
    against = Reach()._held._against(simulation, "pose 1", simulation.tool_pose())
    assert against is not None
    assert "the fastest joint moves at 3.0 mrad/s" in against


def test_the_arm_must_be_home_at_the_end() -> None:
    task, simulation = Reach(), Simulation(PANDA, Reach().build_scene)
    for i in range(task.count):
        hide_marker(simulation, f"pose {i + 1}")
    assert task.verdict(simulation) is None
    simulation.data.joint(PANDA.joints[0]).qpos[0] += 0.011
    failure = task.verdict(simulation)
    assert failure is not None
    assert failure.cause is Cause.PLACE
    assert "a joint is 0.011 rad from home" in failure.evidence
    assert task.measures(simulation)["home_error_rad"] == pytest.approx(0.011)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"count": 0}, r"count must be a whole number, at least 1 and at most 5; found 0"),
        ({"count": 6}, r"count must be a whole number, at least 1 and at most 5; found 6"),
        ({"position_tolerance": 0.0}, r"position_tolerance must be above 0 and finite"),
        ({"angle_tolerance": np.nan}, r"angle_tolerance must be above 0 and finite"),
        ({"seconds": -1.0}, r"seconds must be above 0 and finite"),
    ],
)
def test_impossible_settings_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        replace(Reach(), **change)  # type: ignore[arg-type]


def test_a_pose_is_approached_in_a_branch_that_is_clear_of_open_fingers_too() -> None:
    task = Reach()
    planner, arm = (
        ClassicalStack().scenario(PANDA, task).planner,
        Arm(PANDA, obstacles=task.obstacles),
    )
    turn = SO3(np.array([-0.30300, 0.12980, 0.90310, -0.27523])).normalize()
    place = np.array([0.18587, -0.33428, 0.59618])
    pose = SE3.from_rotation_and_translation(turn, place)
    waypoint = Waypoint(name="pose 5", target=pose)
    q = planner.plan(arm, waypoint, arm.home, 1e-3).trajectory.end.q
    assert planner.collisions is not None
    assert planner.collisions.at(q) is None
    careless = replace(planner, branch_choice=BranchChoice())
    with pytest.raises(PlanError, match="link5 and left_finger come within"):
        careless.plan(arm, waypoint, arm.home, 1e-3)
