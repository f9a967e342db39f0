"""The main job: it succeeds, notices what goes wrong, and says why."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.metrics import metrics
from robo47_qp.run.failure import Cause
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.steps import as_step
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.item import Item
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.runs import Meddler, Witness, carry_out, live, moves_cube, picked_and_placed

ELSEWHERE = (0.50, 0.10)


GOAL = np.array([0.40, -0.20, 0.02])


def cube(*, edge: float = 0.04, mass: float = 0.1) -> Item:
    return Item(name="cube", size=(edge, edge, edge), mass=mass)


def names(run: Run) -> list[str]:
    return [phase.name for phase in run.phases]


def is_home(run: Run) -> bool:
    rows = run.rows
    away = np.abs(rows["joints/q"][-1] - PANDA.home).max()
    return bool(away < 1e-3 and rows["gripper/width"][-1, 0] > 0.079)


def moves_cube_along(places: Sequence[tuple[float, float]]) -> Callable[[Simulation], None]:
    """Puts the cube at the next place each time."""
    left = iter(places)

    def act(simulation: Simulation) -> None:
        moves_cube(*next(left))(simulation)

    return act


def test_a_camera_that_is_calibrated_wrong_does_not_move_the_goal() -> None:
    """Seen with an error of some millimetres and 1°, item and goal are off by the same."""
    task, wrong = PickPlace(), Disturbance(pose_bias=4e-3, rotation_bias=float(np.radians(1.0)))
    simulation = DisturbedSimulation(PANDA, task.build_scene, wrong, np.random.default_rng(6))
    run = Runner(ClassicalStack().scenario(PANDA, task), simulation).run()
    seen = (
        simulation.seen_marker("goal").translation() - simulation.marker_pose("goal").translation()
    )
    assert np.linalg.norm(seen[:2]) > 3e-3
    assert run.failure is None
    # What is left is the turn of the calibration over the last 12 mm.
    assert run.measures["place_error_m"] < 1e-3


def test_item_and_goal_are_looked_at_in_the_same_images() -> None:
    task = PickPlace()
    rng, wrong = np.random.default_rng(6), Disturbance(pose_noise=1e-3)
    noisy = DisturbedSimulation(PANDA, task.build_scene, wrong, rng)
    run = Runner(ClassicalStack().scenario(PANDA, task), noisy).run()
    assert run.failure is None
    first, second, *_ = dict.fromkeys(names(run))
    assert (first, second) == ("look at goal, cube", "approach")


def test_the_default_run_places_the_cube() -> None:
    run = picked_and_placed()
    assert run.failure is None
    assert run.failed_steps == 0
    cube = run.rows["objects/cube"][-1]
    assert np.linalg.norm(cube[:3] - GOAL) <= 3e-3
    assert metrics(run)["place_error_m"] <= 3e-3
    # The measure judges after the last row, from which the cube, at rest, does not differ.
    assert metrics(run)["place_error_m"] == pytest.approx(np.linalg.norm(cube[:3] - GOAL), abs=1e-6)
    assert is_home(run)


def test_the_default_run_lifts_the_cube_before_it_carries_it() -> None:
    rows = picked_and_placed().rows
    cube = rows["objects/cube"]
    away = np.linalg.norm(cube[:, :2] - cube[0, :2], axis=1)
    to_go = np.linalg.norm(cube[:, :2] - GOAL[:2], axis=1)
    between = (away > 0.02) & (to_go > 0.02)
    assert between.sum() > 500
    assert cube[between, 2].min() > 0.08
    np.testing.assert_allclose(cube[0, :3], [0.40, 0.20, 0.02], atol=1e-9)


def test_the_default_run_follows_its_plan_within_a_third_of_a_milliradian() -> None:
    assert np.abs(picked_and_placed().rows["errors/q"]).max() <= 0.3e-3


def test_the_cube_is_squeezed_as_hard_as_asked_while_it_is_carried() -> None:
    run = picked_and_placed()
    carry = next(phase for phase in run.phases if phase.name == "carry")
    force = run.rows["gripper/force"][carry.start : carry.start + 1000]
    asked = PickPlace().item.grip_force(PickPlace.grip_force, 6.0)
    assert asked == 10.0
    np.testing.assert_allclose(force, asked, atol=0.5)


@pytest.mark.parametrize("seed", range(3))
def test_random_starts_and_goals_succeed_within_all_limits(seed: int) -> None:
    run = picked_and_placed(seed=seed)
    assert run.failure is None
    assert run.measures["place_error_m"] <= 3e-3
    assert [finding.signal for finding in audit(run) if not finding.ok] == []
    assert np.abs(run.rows["errors/q"]).max() <= 0.3e-3
    assert is_home(run)


def heading(quaternion: Vector) -> float:
    """Turn about the vertical of an upright cube, up to quarter turns [rad]."""
    w, x, y, z = quaternion
    angle = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return float((angle + np.pi / 4) % (np.pi / 2) - np.pi / 4)


@pytest.mark.parametrize("seed", range(3))
def test_the_cube_is_placed_with_the_heading_of_the_goal(seed: int) -> None:
    run = picked_and_placed(seed=seed)
    task = run.scenario.task
    simulation = Simulation(PANDA, task.build_scene)
    task.reset(simulation, np.random.default_rng(seed))
    goal = heading(simulation.marker_pose("goal").rotation().wxyz)
    off = heading(run.rows["objects/cube"][-1, 3:]) - goal
    assert abs((off + np.pi / 4) % (np.pi / 2) - np.pi / 4) < 0.01


def test_half_the_speed_takes_twice_the_time_and_succeeds() -> None:
    slow, fast = picked_and_placed(speed=0.5), picked_and_placed()
    assert slow.failure is None
    for leg, other in zip(slow.legs, fast.legs, strict=True):
        ratio = leg.trajectory.duration / other.trajectory.duration
        assert ratio == pytest.approx(2.0, rel=0.02)


def test_a_grasp_that_always_misses_is_tried_three_times_and_reported() -> None:
    places = [ELSEWHERE, (0.40, 0.20), ELSEWHERE, (0.40, 0.20)]
    meddler = Meddler("descend", moves_cube_along(places), times=9, after=0.5)
    witness = Witness()
    run = carry_out(PickPlace(), observers=[meddler, witness])
    assert meddler.done == 3
    assert names(run).count("close gripper") == 3
    assert names(run).count("back off") == 3
    assert run.failed_steps == 3
    assert "lift" not in names(run)
    assert run.failure is not None
    assert run.failure.cause is Cause.GRASP
    # They are noticed to be too close as soon as they are.
    assert "the fingers are 36.8 mm apart, the cube measures 40.0 mm" in run.failure.evidence
    assert is_home(run)
    assert names(run)[-2:] == ["home", "end"]
    assert witness.notes[-1][1:] == (f"failed (grasp): {run.failure.evidence}", "ERROR")


def test_the_number_of_retries_is_a_choice() -> None:
    meddler = Meddler("descend", moves_cube(*ELSEWHERE), after=0.5)
    run = carry_out(PickPlace(retries=0), observers=[meddler])
    assert names(run).count("close gripper") == 1
    assert run.failure is not None
    assert run.failure.cause is Cause.GRASP
    assert is_home(run)


def test_a_cube_pushed_away_once_is_picked_where_it_is_then() -> None:
    run = carry_out(PickPlace(), observers=[Meddler("approach", moves_cube(*ELSEWHERE), after=0.5)])
    assert run.failure is None
    assert run.measures["place_error_m"] <= 3e-3
    grasps = [leg.T_world_goal.translation() for leg in run.legs if leg.waypoint.name == "descend"]
    np.testing.assert_allclose(grasps[0], [0.40, 0.20, 0.02], atol=1e-3)
    np.testing.assert_allclose(grasps[1], [*ELSEWHERE, 0.02], atol=1e-3)
    assert len(grasps) == 2


def test_a_cube_that_moves_before_the_first_look_is_picked_at_once() -> None:
    """A nudge that leaves it between the fingers: lift, carry and lower go by what is held.

    They are 1 mm beside an item whose pose is known, and 4 mm are along their pads.
    """

    def nudge(simulation: Simulation) -> None:
        T = simulation.object_pose("cube")
        turned = SO3.from_z_radians(0.01) @ T.rotation()
        moved = T.translation() + np.array([0.004, 0.0006, 0.0])
        simulation.place_object("cube", SE3.from_rotation_and_translation(turned, moved))

    run = carry_out(PickPlace(), observers=[Meddler("descend", nudge, after=0.5)])
    assert run.failure is None
    assert names(run).count("close gripper") == 1
    assert run.measures["place_error_m"] <= 3e-3


def test_a_cube_that_gets_under_a_finger_ends_the_run_by_name() -> None:
    def under(simulation: Simulation) -> None:
        T = simulation.object_pose("cube")
        moved = T.translation() + np.array([0.0, 0.005, 0.0])
        simulation.place_object("cube", SE3.from_rotation_and_translation(T.rotation(), moved))

    run = carry_out(PickPlace(), observers=[Meddler("descend", under, after=0.5)])
    assert run.failure is not None
    assert run.failure.cause is Cause.COLLISION
    assert "the contact force on the tool is" in run.failure.evidence


@pytest.mark.parametrize("phase", ["lift", "carry", "lower"])
def test_a_cube_lost_on_the_way_is_noticed(phase: str) -> None:
    meddler = Meddler(phase, moves_cube(*ELSEWHERE), after=0.5)
    run = carry_out(PickPlace(retries=0), observers=[meddler])
    assert run.failure is not None
    assert run.failure.cause is Cause.DROP
    assert "mm apart, the cube measures 40.0 mm" in run.failure.evidence
    assert run.failure.step == phase
    assert run.failure.condition == "the fingers hold the cube"
    assert names(run)[-6:] == [phase, "stop", "back off", "open gripper", "home", "end"]
    assert is_home(run)


def test_a_cube_lost_on_the_way_is_fetched() -> None:
    meddler = Meddler("carry", moves_cube(*ELSEWHERE), after=0.5)
    run = carry_out(PickPlace(), observers=[meddler])
    assert run.failure is None
    assert run.measures["place_error_m"] <= 3e-3
    assert names(run).count("carry") == 2
    assert names(run).count("back off") == 1


def test_a_cube_that_gets_out_of_reach_is_a_failure_of_ik() -> None:
    meddler = Meddler("approach", moves_cube(0.85, 0.20), after=0.5)
    run = carry_out(PickPlace(), observers=[meddler])
    assert run.failure is not None
    assert run.failure.cause is Cause.IK
    assert "Waypoint 'approach' cannot be planned" in run.failure.evidence


def test_a_cube_too_heavy_to_hold_is_a_drop() -> None:
    run = carry_out(PickPlace(item=cube(mass=7.0), retries=0, force_max=200.0))
    assert run.failure is not None
    assert run.failure.cause is Cause.DROP
    assert is_home(run)


def test_fingers_that_land_on_what_is_too_wide_are_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PickPlace, "opening_needed", None)
    run = carry_out(PickPlace(item=cube(edge=0.1), retries=0))
    assert run.failure is not None
    assert run.failure.cause is Cause.COLLISION
    assert "the contact force on the tool is" in run.failure.evidence


def test_fingers_that_do_not_press_do_not_hold() -> None:
    """The fingers stand as far apart as the cube is wide, with nothing between them."""
    task = PickPlace()
    simulation = Simulation(PANDA, task.build_scene)
    program = task.program(live(simulation))
    steps = [as_step(next(program)) for _ in range(3)]
    assert [step.name for step in steps] == ["approach", "descend", "close gripper"]
    simulation.command_grip(Grip(width=task.item.height, force=30.0))
    for _ in range(600):
        simulation.step(simulation.data.qfrc_bias[:7].copy())
    (held,) = steps[-1].after
    against = held.against()
    assert against is not None
    assert "the fingers press with 0.0 N and 0.0 N, 10.0 N were asked for" in against
    assert simulation.width() == pytest.approx(task.item.height, abs=1e-4)


def test_a_stricter_tolerance_is_not_met() -> None:
    run = carry_out(PickPlace(place_tolerance=1e-9))
    assert run.failure is not None
    assert run.failure.cause is Cause.PLACE
    assert "mm from its goal" in run.failure.evidence
