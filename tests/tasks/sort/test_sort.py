"""Sorting: every item ends in the bin of its colour, or the run says why not."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.perturbation import Perturbation
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.failure import Cause
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.steps import Move, as_step
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.heading import heading, upright
from robo47_qp.tasks.item import GREEN, RED, Item
from robo47_qp.tasks.sort.sort import Sort
from robo47_qp.tasks.table import TABLE_TOP
from tests.robots import GRIPPER
from tests.runs import Meddler, at_rest, carry_out, live

ALL = Sort()
ONE = Sort(items=Sort.items[1:2])
"""The blue box alone."""
FEW = Sort(items=(Sort.items[0], Sort.items[2], Sort.items[5]))
"""Two items for one bin and one for the other, one of them round."""
RED_BIN, BLUE_BIN = Sort.bins
START = (0.36, -0.14)


def names(run: Run) -> list[str]:
    return [phase.name for phase in run.phases]


def moves(name: str, x: float, y: float, z: float = 0.02) -> Callable[[Simulation], None]:
    return lambda simulation: simulation.place_object(name, upright([x, y, z], 0.0))


# Runs


def test_every_item_is_sorted() -> None:
    run = carry_out(FEW)
    assert run.failure is None
    assert [finding.signal for finding in audit(run) if not finding.ok] == []
    assert run.measures == {"sorted": 3.0}
    assert names(run).count("close gripper") == 3
    assert names(run).count("home") == 1
    ends = {item.name: run.rows[f"objects/{item.name}"][-1] for item in FEW.items}
    for item in FEW.items:
        # In the bins' own numbers, and not by what the task says of them.
        x, y, z = ends[item.name][:3]
        assert abs(x - 0.45) < 0.105
        assert abs(y - (0.37 if item.rgba == RED else -0.37)) < 0.075
        assert z == pytest.approx(0.5 * item.height, abs=1e-3)
    # One item to a slot.
    places = np.array([end[:2] for end in ends.values()])
    apart = np.linalg.norm(places[:, None] - places, axis=2) + np.eye(3)
    assert apart.min() > 0.05


def test_items_that_are_looked_at_again_are_looked_at_less() -> None:
    task = Sort(items=FEW.items[:2])
    noisy = TaskEpisode(
        robot=PANDA, task=task, perturbation=Perturbation(pose_noise=2e-3, pose_noise_time=0.3)
    )
    scenario = noisy.scenario(81000)
    run = Runner(scenario, noisy.simulation(scenario, 81000, drawn=False)).run()
    assert run.failure is None
    ends = [phase.start for phase in run.phases[1:]] + [len(run.rows)]
    took: dict[str, list[float]] = {}
    for phase, end in zip(run.phases, ends, strict=True):
        took.setdefault(phase.name, []).append(1e-3 * (end - phase.start))
    # Once as well as the goals of other tasks are, and long enough to loosen the joints.
    first, *later = took["look at red box, red cylinder"]
    assert first > 2.5
    assert len(later) == 2
    assert 0.9 < min(later) <= max(later) < 1.5
    # What has just been seen is grasped: each is looked at again in the hand, before it is carried,
    # above its bin and beside the ground, and no better than bins call for.
    for name in ("red box", "red cylinder"):
        assert len(took[f"look at {name}"]) == 3
        assert max(took[f"look at {name}"]) < 1.0


@pytest.mark.parametrize(("seed", "off"), [(81213, 0.01897), (81073, -0.01805)])
def test_a_camera_that_errs_in_height_brings_no_hand_to_the_table(seed: int, off: float) -> None:
    """More than 10 mm, by the calibration alone: what the data sheet tells is within reach."""
    noisy = TaskEpisode(robot=PANDA, task=ONE, perturbation=Perturbation(pose_bias=6e-3))
    scenario = noisy.scenario(seed)
    simulation = noisy.simulation(scenario, seed, drawn=False)
    item = scenario.task.items[0]  # type: ignore[attr-defined]
    truth = simulation.object_pose(item.name).translation()[2]
    assert simulation.seen_pose(item.name).translation()[2] - truth == pytest.approx(off, abs=1e-4)
    run = Runner(scenario, simulation).run()
    assert run.failure is None
    # At its middle, once, and put down and not pressed into the table.
    assert names(run).count("close gripper") == 1
    start = run.phases[names(run).index("close gripper")].start
    assert run.rows["tool/pose"][start][2] == pytest.approx(0.5 * item.height, abs=1.5e-3)
    assert run.rows["contact/fixed"].max() < 5.0
    assert run.rows["contact/tool"].max() < 10.0


@pytest.mark.parametrize(("bias", "higher"), [(0.0, 0.01), (4e-3, 0.0223), (8e-3, 0.0342)])
def test_what_stands_on_the_table_is_told_by_the_data_sheet(bias: float, higher: float) -> None:
    """10 mm, and three times sqrt(0.9² + bias²) mm, if the camera errs."""
    wrong = Disturbance(pose_bias=bias, pose_noise=1e-12)
    exact = Simulation(PANDA, ONE.build_scene)
    errs = DisturbedSimulation(PANDA, ONE.build_scene, wrong, np.random.default_rng(1))
    sensed, item = live(errs if bias else exact), ONE.items[0]
    for off, stands in ((-0.05, True), (higher - 2e-4, True), (higher + 2e-4, False)):
        hand = ONE._hand(sensed, item, upright([0.4, 0.1, 0.5 * item.height + off], 0.0))
        assert hand.resting == (0.5 * item.height if stands else None)


@pytest.mark.parametrize(("off", "inside"), [(0.021, True), (0.024, False)])
def test_an_item_that_the_camera_sees_above_the_rim_is_in_its_bin(off: float, inside: bool) -> None:
    """The centre of one that stands is 20 mm below the rim."""
    wrong = Disturbance(pose_bias=4e-3, pose_noise=1e-12)
    errs = DisturbedSimulation(PANDA, ONE.build_scene, wrong, np.random.default_rng(1))
    item = ONE.items[0]
    seen = upright([0.45, -0.37, 0.5 * item.height + off], 0.0)
    assert ONE._seen_in(live(errs), item, seen) == inside
    beside = upright([0.45, -0.2, 0.5 * item.height], 0.0)
    assert not ONE._seen_in(live(errs), item, beside)
    # One that lies on its side, by its height there.
    tall = replace(item, size=(0.025, 0.025, 0.05))
    lying = SE3.from_rotation(SO3.from_x_radians(0.5 * np.pi))
    for higher, stands in ((0.021, True), (0.03, False)):
        at = upright([0.45, -0.37, 0.5 * 0.025 + higher], 0.0) @ lying
        assert ONE._seen_in(live(errs), tall, at) == stands


def test_an_item_that_falls_beside_its_bin_is_sorted_again() -> None:
    meddler = Meddler("retreat", moves("blue box", 0.5, 0.1), after=0.3)
    run = carry_out(ONE, observers=[meddler])
    assert meddler.done == 1
    assert run.failure is None
    assert names(run).count("close gripper") == 2


def test_an_item_that_is_always_missed_is_reported() -> None:
    places = iter([(0.5, 0.0), START] * 3)
    meddler = Meddler(
        "descend",
        lambda s: s.place_object("blue box", upright([*next(places), 0.02], 0.0)),
        times=9,
        after=0.5,
    )
    run = carry_out(replace(ONE, retries=0), observers=[meddler])
    assert run.failure is not None
    assert run.failure.cause is Cause.GRASP
    assert names(run)[-3:] == ["open gripper", "home", "end"]


def test_an_item_knocked_out_at_the_end_is_a_failure_of_place() -> None:
    meddler = Meddler("home", moves("blue box", 0.5, 0.1), after=0.3)
    run = carry_out(ONE, observers=[meddler])
    assert run.failure is not None
    assert run.failure.cause is Cause.PLACE
    assert "the blue box is at (0.500, 0.100, 0.020) m" in run.failure.evidence
    assert "not all of it is in the blue bin: x 0.345 to 0.555 m" in run.failure.evidence
    assert run.measures == {"sorted": 0.0}


# Verdict


@pytest.fixture
def done() -> tuple[Sort, Simulation]:
    """A world in which all is as it should be at the end."""
    simulation = Simulation(PANDA, ALL.build_scene)
    ALL.reset(simulation, None)
    for i, item in enumerate(ALL.items):
        x, y = (RED_BIN if item.rgba == RED else BLUE_BIN).slots[i // 2]
        simulation.place_object(item.name, upright([x, y, 0.5 * item.height], float(i)))
    at_rest(simulation)
    return ALL, simulation


def test_all_as_it_should_be_is_success(done: tuple[Sort, Simulation]) -> None:
    task, simulation = done
    assert task.verdict(simulation) is None
    assert task.measures(simulation) == {"sorted": 6.0}


@pytest.mark.parametrize("item", ALL.items, ids=lambda item: item.name)
@pytest.mark.parametrize("where", ["other bin", "on the wall", "on the rim", "table"])
def test_every_item_must_be_in_its_own_bin(
    done: tuple[Sort, Simulation], item: Item, where: str
) -> None:
    task, simulation = done
    name = item.name
    pose = simulation.object_pose(name)
    x, y, z = pose.translation()
    wrong = {
        "other bin": [x, -y, z],
        "on the wall": [x, np.sign(y) * 0.446, z],
        "on the rim": [x, y, 0.041],
        "table": [0.4, 0.0, z],
    }[where]
    simulation.place_object(
        name, SE3.from_rotation_and_translation(pose.rotation(), np.array(wrong))
    )
    failure = task.verdict(simulation)
    assert failure is not None
    assert failure.cause is Cause.PLACE
    assert f"the {name} is at" in failure.evidence
    assert task.measures(simulation) == {"sorted": 5.0}


@pytest.mark.parametrize("roll", [0.0, 0.02, 0.5 * np.pi, np.pi])
def test_a_cylinder_that_lies_on_its_round_side_is_not_sorted(
    done: tuple[Sort, Simulation], roll: float
) -> None:
    task, simulation = done
    x, y, _ = simulation.object_pose("red cylinder").translation()
    lying = SO3.from_z_radians(0.3) @ SO3.from_x_radians(0.5 * np.pi) @ SO3.from_z_radians(roll)
    at = SE3.from_rotation_and_translation(lying, np.array([x, y, 0.02]))
    simulation.place_object("red cylinder", at)
    failure = task.verdict(simulation)
    assert failure is not None
    assert "the red cylinder is tilted by 90.0° (allowed are 3°)" in failure.evidence


@pytest.mark.parametrize("name", ["red cylinder", "red box"])
@pytest.mark.parametrize(("tilt", "ok"), [(0.0, True), (0.05, True), (0.055, False)])
def test_an_item_may_stand_upside_down(
    done: tuple[Sort, Simulation], name: str, tilt: float, ok: bool
) -> None:
    task, simulation = done
    pose = simulation.object_pose(name)
    turned = pose @ SE3.from_rotation(SO3.from_x_radians(np.pi - tilt))
    simulation.place_object(name, turned)
    assert (task.verdict(simulation) is None) == ok


def test_a_box_on_its_side_is_not_sorted(done: tuple[Sort, Simulation]) -> None:
    task, simulation = done
    pose = simulation.object_pose("red box")
    for turn in (SO3.from_x_radians(0.5 * np.pi), SO3.from_y_radians(-0.5 * np.pi)):
        simulation.place_object("red box", pose @ SE3.from_rotation(turn))
        failure = task.verdict(simulation)
        assert failure is not None
        assert "the red box is tilted by 90.0°" in failure.evidence


def test_an_item_in_motion_is_not_sorted(done: tuple[Sort, Simulation]) -> None:
    task, simulation = done
    simulation.data.joint(simulation.model.body("red bar").jntadr[0]).qvel[:3] = [0, 0.002, 0]
    failure = task.verdict(simulation)
    assert failure is not None
    assert "moves at 2.0 mm/s" in failure.evidence


def test_the_arm_must_be_home_with_its_gripper_open(done: tuple[Sort, Simulation]) -> None:
    task, simulation = done
    simulation.data.joint(PANDA.joints[3]).qpos[0] += 0.011
    failure = task.verdict(simulation)
    assert failure is not None
    assert "a joint is 0.011 rad from home" in failure.evidence
    simulation.data.joint(PANDA.joints[3]).qpos[0] -= 0.011
    for finger in GRIPPER.joints:
        simulation.data.joint(finger).qpos[0] = 0.039
    failure = task.verdict(simulation)
    assert failure is not None
    assert "the gripper is open 78.0 mm" in failure.evidence


# Starts and way points


@cache
def _world() -> Simulation:
    return Simulation(PANDA, ALL.build_scene)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_random_starts_leave_room_for_the_fingers(seed: int) -> None:
    simulation = _world()
    ALL.reset(simulation, np.random.default_rng(seed))
    places = np.array([simulation.object_pose(item.name).translation() for item in ALL.items])
    np.testing.assert_allclose(places[:, 2], [0.5 * item.height for item in ALL.items])
    apart = np.linalg.norm(places[:, None, :2] - places[:, :2], axis=2) + np.eye(6)
    assert apart.min() >= 0.11
    assert not any(place.holds(p) for place in ALL.bins for p in places)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_items_are_put_down_across_the_bin(seed: int) -> None:
    """The fingers open along y, where there is room, whatever they hold and however."""
    simulation = _world()
    ALL.reset(simulation, np.random.default_rng(seed))
    steps = [as_step(step) for step in ALL.preview(live(simulation))]
    moves = [step.waypoints[0] for step in steps if isinstance(step, Move)]
    slots = set()
    for item, grasp, lower in zip(
        ALL.items,
        [waypoint for waypoint in moves if waypoint.name == "descend"],
        [waypoint for waypoint in moves if waypoint.name == "lower"],
        strict=True,
    ):
        assert isinstance(grasp.target, SE3)
        assert isinstance(lower.target, SE3)
        assert abs(np.sin(heading(lower.target))) < 1e-9
        held = grasp.target.inverse() @ simulation.object_pose(item.name)
        x, y, z = (lower.target @ held).translation()
        assert z == pytest.approx(TABLE_TOP + 0.5 * item.height)
        place = RED_BIN if item.rgba == RED else BLUE_BIN
        away = [np.hypot(x - a, y - b) for a, b in place.slots]
        assert min(away) < 1e-9
        slots.add((place.name, int(np.argmin(away))))
    assert len(slots) == 6


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_variants_have_items_that_fit_the_hand(seed: int) -> None:
    task = ALL.variant(np.random.default_rng(seed))
    assert [(i.name, i.rgba) for i in task.items] == [(i.name, i.rgba) for i in ALL.items]
    for item in task.items:
        assert 0.025 <= min(item.size[:2]) <= max(item.size[:2]) <= 0.045
        assert 0.035 <= item.height <= 0.05


def test_variants_are_boxes_and_cylinders() -> None:
    found = [ALL.variant(np.random.default_rng(seed)).items for seed in range(5)]
    shapes = {item.round for items in found for item in items}
    assert shapes == {True, False}


def test_the_hand_stays_above_the_rim() -> None:
    """As it lets go of the lowest item, no geom of the hand but its fingers is below the rim."""
    simulation = _world()
    model, data = simulation.model, mujoco.MjData(simulation.model)
    data.qpos[:] = simulation.model.qpos0
    hand = model.body("hand").id
    lowest = min(
        _lowest_point(model, int(geom))
        for geom in np.flatnonzero(model.geom_bodyid == hand)
        if model.geom_contype[geom]
    )
    # The tool is where the middle of the lowest item is, when it stands.
    tool = TABLE_TOP + 0.5 * 0.035
    assert tool + lowest > RED_BIN.height + 0.01


def _lowest_point(model: mujoco.MjModel, geom: int) -> float:
    """How far above the tool point a box of the hand ends, the tool down [m]."""
    tcp = model.site(PANDA.tcp).pos[2]
    return float(tcp - model.geom_pos[geom][2] - model.geom_size[geom][2])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"items": ()}, r"number of items must be 1 to 6; found 0"),
        ({"items": (replace(ALL.items[0], rgba=GREEN),)}, r"colour of 'red box' must be that of"),
        (
            {"items": tuple(replace(item, rgba=RED) for item in ALL.items)},
            r"items for 'red bin' must be one per slot at most; found 6",
        ),
        ({"grip_force": np.nan}, r"grip_force must be above 0 and finite"),
        ({"above": -1.0}, r"above must be above 0 and finite"),
        ({"retries": -1}, r"retries must be a whole number, 0 or more; found -1"),
    ],
)
def test_impossible_settings_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        replace(ALL, **change)  # type: ignore[arg-type]
