"""Stacking: it succeeds, notices what goes wrong, and says why."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.scenario import Run
from robo47_qp.run.steps import Move, as_step
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.heading import upright
from robo47_qp.tasks.stack.stack import Stack
from tests.robots import GRIPPER
from tests.runs import Meddler, at_rest, carry_out, live, make_runner

TWO = Stack(cubes=Stack.cubes[:2])
"""A short tower."""
RED, GREEN, BLUE = (cube.name for cube in Stack.cubes)
GOAL = np.array([*Stack.goal, 0.0])


def names(run: Run) -> list[str]:
    return [phase.name for phase in run.phases]


def puts(name: str, where: tuple[float, float, float]) -> Callable[[Simulation], None]:
    """Puts a cube somewhere."""
    return lambda simulation: simulation.place_object(name, upright(where, 0.2))


def on_goal(level: int, turn: float = 0.0) -> SE3:
    """Pose of a cube in the tower."""
    x, y, _ = GOAL
    return upright([x, y, 0.02 + 0.04 * level], turn)


def begun(task: Stack, standing: int = 1) -> Callable[..., Run]:
    """A run of a tower that is partly built."""
    runner, simulation = make_runner(task)
    for level, cube in enumerate(task.cubes[:standing]):
        simulation.place_object(cube.name, on_goal(level))
    return runner.run


# Runs


def test_the_default_run_builds_the_tower() -> None:
    run = carry_out(Stack())
    assert run.failure is None
    assert [finding.signal for finding in audit(run) if not finding.ok] == []
    ends = np.array([run.rows[f"objects/{name}"][-1, :3] for name in (RED, GREEN, BLUE)])
    np.testing.assert_allclose(ends[:, :2], np.tile(GOAL[:2], (3, 1)), atol=1e-3)
    np.testing.assert_allclose(np.sort(ends[:, 2]), [0.02, 0.06, 0.10], atol=1e-3)
    assert names(run).count("close gripper") == 3
    assert names(run).count("home") == 1
    assert run.measures["stack_error_m"] < 1e-3


def test_a_cube_lost_on_the_way_is_fetched() -> None:
    meddler = Meddler("carry", puts(GREEN, (0.5, 0.15, 0.02)), after=0.5)
    run = begun(TWO)(observers=[meddler])
    assert meddler.done == 1
    assert run.failure is None
    assert names(run).count("carry") == 2
    assert names(run).count("back off") == 1


def test_a_tower_that_falls_while_a_cube_is_picked_is_rebuilt() -> None:
    meddler = Meddler("lift", puts(RED, (0.40, 0.05, 0.02)), after=0.5)
    run = begun(TWO)(observers=[meddler])
    assert meddler.done == 1
    assert run.failure is None
    assert names(run).count("close gripper") == 3
    # What it held when it saw that was put back where it was, not onto nothing.
    green = run.rows[f"objects/{GREEN}"]
    first = next(phase.start for phase in run.phases if phase.name == "retreat")
    np.testing.assert_allclose(green[first, :3], [0.52, 0.12, 0.02], atol=1e-3)


def test_a_cube_on_its_side_is_stacked_and_does_not_count() -> None:
    runner, simulation = make_runner(TWO)
    simulation.place_object(RED, on_goal(0))
    # Its x axis up: the turn about the vertical shows in the others alone.
    c, s = np.cos(0.4), np.sin(0.4)
    turned = SO3.from_matrix(np.array([[0.0, c, -s], [0.0, s, c], [1.0, 0.0, 0.0]]))
    where = np.array([0.5, 0.1, 0.02])
    simulation.place_object(GREEN, SE3.from_rotation_and_translation(turned, where))
    run = runner.run()
    assert names(run).count("close gripper") == 1
    assert run.measures["stack_error_m"] < 1e-3
    assert run.failure is not None
    assert run.failure.cause is Cause.PLACE
    assert f"the {GREEN}, number 2 from below, is tilted by 90.0°" in run.failure.evidence


def test_a_cube_on_one_that_is_in_the_way_goes_aside_first() -> None:
    runner, simulation = make_runner(TWO)
    beside = SE3.from_translation(np.array([0.014, 0.0, 0.0]))
    for level, name in enumerate((GREEN, RED)):
        simulation.place_object(name, beside @ on_goal(level))
    run = runner.run()
    assert run.failure is None
    # The audit tells of the test's own hand alone.
    assert [f.signal for f in audit(run) if not f.ok] == [f"object jump ({RED})"]
    red = run.rows[f"objects/{RED}"]
    first = next(phase.start for phase in run.phases if phase.name == "retreat")
    assert red[first, 2] == pytest.approx(0.02, abs=1e-3)
    assert np.linalg.norm(red[first, :2] - GOAL[:2]) == pytest.approx(0.2, abs=0.02)
    assert names(run).count("close gripper") == 3


def test_a_cube_that_is_always_missed_is_reported() -> None:
    places = iter([(0.5, 0.0, 0.02), (0.52, 0.12, 0.02)] * 3)

    def act(simulation: Simulation) -> None:
        puts(GREEN, next(places))(simulation)

    meddler = Meddler("descend", act, times=9, after=0.5)
    run = begun(replace(TWO, retries=0))(observers=[meddler])
    assert run.failure is not None
    assert run.failure.cause is Cause.GRASP
    assert f"the {GREEN} measures 40.0 mm" in run.failure.evidence
    # As many attempts as cubes, if all goes well.
    assert names(run).count("close gripper") == 2
    assert names(run)[-2:] == ["home", "end"]


def test_a_cube_too_heavy_to_hold_is_a_drop() -> None:
    heavy = tuple(replace(cube, mass=10.0) for cube in TWO.cubes)
    run = begun(replace(TWO, cubes=heavy, retries=0, force_max=200.0))()
    assert run.failure is not None
    assert run.failure.cause is Cause.DROP


def test_a_cube_out_of_reach_is_a_failure_of_ik() -> None:
    runner, simulation = make_runner(TWO)
    simulation.place_object(RED, upright([0.85, 0.3, 0.02], 0.0))
    simulation.place_object(GREEN, upright([0.85, -0.3, 0.02], 0.0))
    run = runner.run()
    assert run.failure is not None
    assert run.failure.cause is Cause.IK


def test_a_tower_that_falls_at_the_end_is_a_failure_of_place() -> None:
    meddler = Meddler("end", puts(BLUE, (0.3, 0.3, 0.02)), after=0.1)
    run = begun(Stack(), standing=3)(observers=[meddler])
    assert run.failure is not None
    assert run.failure.cause is Cause.PLACE
    assert f"the {BLUE}, number" in run.failure.evidence
    assert names(run) == ["end"]


# Verdict


@pytest.fixture
def done() -> tuple[Stack, Simulation]:
    """A world in which all is as it should be at the end."""
    task = Stack()
    simulation = Simulation(PANDA, task.build_scene)
    task.reset(simulation, None)
    # Any order will do.
    for level, name in enumerate((BLUE, RED, GREEN)):
        simulation.place_object(name, on_goal(level, level * np.pi / 2))
    at_rest(simulation)
    return task, simulation


def shifted(done: tuple[Stack, Simulation], name: str, by: tuple[float, ...]) -> Failure | None:
    task, simulation = done
    pose = simulation.object_pose(name)
    simulation.place_object(name, SE3.from_translation(np.array(by)) @ pose)
    return task.verdict(simulation)


def test_all_as_it_should_be_is_success(done: tuple[Stack, Simulation]) -> None:
    task, simulation = done
    assert task.verdict(simulation) is None
    assert task.measures(simulation) == {
        "stack_error_m": pytest.approx(0.0, abs=1e-12),
        "stack_turn_rad": pytest.approx(0.0, abs=1e-12),
        "stack_tilt_rad": pytest.approx(0.0, abs=1e-12),
    }


@pytest.mark.parametrize("name", [RED, GREEN, BLUE])
@pytest.mark.parametrize(
    ("by", "evidence"),
    [
        ((4.9e-3, 0, 0), None),
        ((0, -4.9e-3, 0), None),
        ((0, 0, 1.9e-3), None),
        ((5.1e-3, 0, 0), "5.1 mm beside the goal"),
        ((-3e-3, 4.1e-3, 0), "5.1 mm beside the goal"),
        ((0, 0, -2.1e-3), "-2.1 mm off its height"),
        ((0, 0, 2.1e-3), "+2.1 mm off its height"),
    ],
)
def test_every_cube_must_be_in_place(
    done: tuple[Stack, Simulation], name: str, by: tuple[float, ...], evidence: str | None
) -> None:
    failure = shifted(done, name, by)
    if evidence is None:
        assert failure is None
        assert done[0].measures(done[1])["stack_error_m"] == pytest.approx(np.hypot(by[0], by[1]))
    else:
        assert failure is not None
        assert failure.cause is Cause.PLACE
        assert evidence in failure.evidence
        assert f"the {name}, number" in failure.evidence


@pytest.mark.parametrize("name", [RED, GREEN, BLUE])
def test_a_cube_in_motion_is_not_placed(done: tuple[Stack, Simulation], name: str) -> None:
    task, simulation = done
    simulation.data.joint(simulation.model.body(name).jntadr[0]).qvel[:3] = [0, 0.002, 0]
    failure = task.verdict(simulation)
    assert failure is not None
    assert "moves at 2.0 mm/s" in failure.evidence


def test_an_arm_that_is_not_home_is_not_the_end(done: tuple[Stack, Simulation]) -> None:
    task, simulation = done
    simulation.data.joint(PANDA.joints[3]).qpos[0] += 0.011
    failure = task.verdict(simulation)
    assert failure is not None
    assert "a joint is 0.011 rad from home" in failure.evidence


def test_a_closed_gripper_is_not_the_end(done: tuple[Stack, Simulation]) -> None:
    task, simulation = done
    for finger in GRIPPER.joints:
        simulation.data.joint(finger).qpos[0] = 0.039
    failure = task.verdict(simulation)
    assert failure is not None
    assert "the gripper is open 78.0 mm" in failure.evidence


# Starts


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_random_starts_leave_room_for_the_hand(seed: int) -> None:
    task = Stack()
    simulation = _world()
    task.reset(simulation, np.random.default_rng(seed))
    goal = simulation.marker_pose("goal").translation()
    places = np.array([simulation.object_pose(cube.name).translation() for cube in task.cubes])
    assert goal[2] == 0.0
    np.testing.assert_allclose(places[:, 2], 0.02)
    apart = np.linalg.norm(places[:, None] - places, axis=2) + np.eye(3)
    assert apart.min() >= 0.11
    assert np.linalg.norm((places - goal)[:, :2], axis=1).min() >= 0.19


@cache
def _world() -> Simulation:
    return Simulation(PANDA, Stack().build_scene)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_variants_are_cubes_that_fit_the_hand(seed: int) -> None:
    task = Stack().variant(np.random.default_rng(seed))
    assert 0.035 <= task.edge <= 0.05
    assert len({cube.size for cube in task.cubes}) == 1
    assert all(0.05 <= cube.mass <= 0.2 for cube in task.cubes)
    assert [cube.name for cube in task.cubes] == [RED, GREEN, BLUE]


def test_the_cube_is_carried_above_the_tower() -> None:
    task = Stack()
    steps = [as_step(step) for step in task.preview(live(_world()))]
    carries = [step for step in steps if isinstance(step, Move) and step.name == "carry"]
    lowers = [step for step in steps if isinstance(step, Move) and step.name == "lower"]
    for level, (carry, lower) in enumerate(zip(carries, lowers, strict=True)):
        high, low = (step.waypoints[0].target for step in (carry, lower))
        assert isinstance(high, SE3)
        assert isinstance(low, SE3)
        assert low.translation()[2] == pytest.approx(0.02 + 0.04 * level)
        # Its bottom passes over two cubes with the clearance.
        assert high.translation()[2] - 0.02 == pytest.approx(0.08 + task.clearance)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cubes": Stack.cubes[:1]}, r"cubes must be 2 to 3 cubes of one edge"),
        ({"cubes": (*Stack.cubes, Stack.cubes[0])}, r"cubes must be 2 to 3 cubes of one edge"),
        (
            {"cubes": (Stack.cubes[0], replace(Stack.cubes[1], size=(0.04, 0.04, 0.05)))},
            r"cubes must be 2 to 3 cubes of one edge",
        ),
        (
            {"cubes": tuple(replace(cube, round=True) for cube in Stack.cubes)},
            r"cubes must be 2 to 3 cubes of one edge",
        ),
        ({"goal": (0.4, np.nan)}, r"goal must be two finite numbers"),
        ({"goal": (-0.4, 0.3)}, r"goal must be on the table .*found \(-0.4, 0.3\)"),
        ({"tolerance": 0.0}, r"^tolerance must be above 0 and finite"),
        ({"height_tolerance": -1.0}, r"height_tolerance must be above 0 and finite"),
        ({"grip_force": np.nan}, r"grip_force must be above 0 and finite"),
        ({"retries": -1}, r"retries must be a whole number, 0 or more; found -1"),
        ({"clearance": 0.0}, r"clearance must be above 0 and finite"),
    ],
)
def test_impossible_settings_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        replace(Stack(), **change)  # type: ignore[arg-type]
