"""HoldCriterion: poses count in turn, at rest, and for long enough; the world alone remembers."""

from dataclasses import replace
from math import inf

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.failure import Cause
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.hold_criterion import HoldCriterion
from robo47_qp.tasks.task_state import hide_marker, is_visible, task_state
from tests.runs import live

NAMES = ["first", "second"]
HELD = HoldCriterion(
    position_tolerance=1e-3, turn_tolerance=np.radians(0.5), seconds=0.2, speed=2e-3
)


def two_poses(spec: mujoco.MjSpec) -> None:
    HoldCriterion.add_state(spec)
    for name in NAMES:
        spec.worldbody.add_body(name=name, mocap=True)


@pytest.fixture
def world() -> Simulation:
    """The first pose is where the tool is, the second one is not."""
    simulation = Simulation(PANDA, two_poses)
    simulation.place_marker("first", simulation.tool_pose())
    simulation.place_marker("second", SE3.from_translation(np.array([0.5, 0.0, 0.3])))
    return simulation


def look(simulation: Simulation, times: int, held: HoldCriterion = HELD) -> list[str]:
    """Look every 20 ms; what is left then."""
    for _ in range(times):
        simulation.data.time += 0.02
        held.monitor(simulation, NAMES)
    return [name for name in NAMES if is_visible(simulation, name)]


def test_a_pose_is_held_after_its_time_and_no_sooner(world: Simulation) -> None:
    assert look(world, 10) == NAMES
    assert look(world, 1) == ["second"]
    assert look(world, 20) == ["second"]


def test_looks_may_come_at_any_rate(world: Simulation) -> None:
    for _ in range(200):
        world.data.time += 0.001
        HELD.monitor(world, NAMES)
    assert is_visible(world, "first")
    world.data.time += 0.001
    HELD.monitor(world, NAMES)
    assert not is_visible(world, "first")


@pytest.mark.parametrize(
    "off",
    [
        SE3.from_translation(np.array([0.0, 1.1e-3, 0.0])),
        SE3.from_translation(np.array([0.0, 0.0, 0.3])),
        SE3.from_rotation(SO3.from_z_radians(np.radians(0.55))),
    ],
)
def test_a_break_begins_it_anew(world: Simulation, off: SE3) -> None:
    here = world.marker_pose("first")
    look(world, 9)
    world.place_marker("first", here @ off)
    look(world, 1)
    world.place_marker("first", here)
    assert look(world, 10) == NAMES
    assert look(world, 1) == ["second"]


def test_within_the_tolerances_is_held(world: Simulation) -> None:
    off = SE3.from_rotation_and_translation(
        SO3.from_x_radians(np.radians(0.45)), np.array([0.9e-3, 0.0, 0.0])
    )
    world.place_marker("first", world.tool_pose() @ off)
    assert look(world, 11) == ["second"]


@pytest.mark.parametrize(("speed", "held"), [(2e-3, False), (4e-3, True), (inf, True)])
def test_what_moves_does_not_rest(world: Simulation, speed: float, held: bool) -> None:
    world.data.joint(PANDA.joints[4]).qvel[0] = -3e-3
    assert (look(world, 11, replace(HELD, speed=speed)) == ["second"]) == held


def test_a_pose_does_not_count_before_its_turn(world: Simulation) -> None:
    first, second = world.marker_pose("first"), world.marker_pose("second")
    world.place_marker("first", second)
    world.place_marker("second", first)
    assert look(world, 30) == NAMES
    # That its turn comes while the tool is there does not count as time before.
    hide_marker(world, "first")
    assert look(world, 10) == ["second"]
    assert look(world, 1) == []
    assert look(world, 1) == []


def test_two_poses_at_one_place_take_twice_the_time(world: Simulation) -> None:
    world.place_marker("second", world.marker_pose("first"))
    assert look(world, 21) == ["second"]
    assert look(world, 1) == []


def test_a_reset_forgets(world: Simulation) -> None:
    look(world, 9)
    assert task_state(world).any()
    here = world.tool_pose()
    world.reset()
    assert not task_state(world).any()
    world.place_marker("first", here)
    assert look(world, 10) == NAMES
    HELD.reset(world)
    assert look(world, 10) == NAMES


def test_worlds_do_not_share_what_they_remember(world: Simulation) -> None:
    other = Simulation(PANDA, two_poses)
    other.place_marker("first", other.tool_pose())
    look(world, 11)
    assert is_visible(other, "first")
    assert look(other, 10)[0] == "first"


def test_the_verdict_tells_what_is_left(world: Simulation) -> None:
    failure = HELD.verdict(world, NAMES)
    assert failure is not None
    assert failure.cause is Cause.PLACE
    assert failure.evidence == (
        "2 of 2 poses are left, first the first: each is to be held for 0.20 s within 1.00 mm, "
        "0.50° and 2.0 mrad/s"
    )
    hide_marker(world, "first")
    world.data.joint(PANDA.joints[1]).qpos[0] += 0.02
    failure = replace(HELD, speed=inf).verdict(world, NAMES)
    assert failure is not None
    assert failure.evidence == (
        "1 of 2 poses are left, second the first: each is to be held for 0.20 s within 1.00 mm, "
        "0.50°, and a joint is 0.020 rad from home; allowed are 0.01 rad"
    )
    assert HELD.measures(world, NAMES)["poses_left"] == 1.0


def test_a_program_may_look_where_the_marker_was(world: Simulation) -> None:
    """Its own steps go on after the pose counts: a marker that is hidden was held."""
    held = HELD.held(live(world), "first")
    assert held.against() == "first does not count as held yet"
    world.data.joint(PANDA.joints[1]).qpos[0] += 0.02
    against = held.against()
    assert against is not None
    assert "from first; allowed are 1.00 mm" in against
    hide_marker(world, "first")
    assert held.against() is None
