"""What counts as wiping: marks go where the sponge presses, and the force is held."""

from dataclasses import dataclass

import numpy as np
import pytest
from mink import SE3

from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import tool_down
from robo47_qp.run.failure import Cause
from robo47_qp.run.policy.drivers import PolicyTiming
from robo47_qp.run.policy.policy import Observation, ToolTarget, vector_of
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.heading import upright
from robo47_qp.tasks.table import TABLE_TOP
from robo47_qp.tasks.task_state import task_state
from robo47_qp.tasks.wipe.board import (
    MARKS,
    WipeMonitor,
    mark,
    marks_left,
)
from robo47_qp.tasks.wipe.wipe import Wipe
from tests.examples import shifted
from tests.policies import Scripted, follow
from tests.runs import Holder


class Pressed(WipeMonitor):
    """Notes of a sponge that is pressed with a force of the test."""

    force = 0.0

    def pressed(self) -> float:
        return self.force


@pytest.fixture
def over_a_mark() -> tuple[Pressed, Simulation]:
    task = Wipe()
    simulation = Simulation(PANDA, task.build_scene)
    task.reset(simulation, None)
    at = simulation.marker_pose(mark(0)).translation() + np.array([0.0, 0.0, 0.0325])
    simulation.place_object("sponge", SE3.from_translation(at))
    return Pressed(simulation, task.sponge, task.settings), simulation


@pytest.mark.parametrize(("factor", "aside", "wiped"), [(0.9, 0.041, False), (1.1, 0.045, True)])
def test_a_mark_goes_where_the_foam_is_as_large_as_it_is(
    factor: float, aside: float, wiped: bool
) -> None:
    """The data sheet has the foam end 42.5 mm from its middle."""
    task = Wipe()
    world = DisturbedSimulation(PANDA, task.build_scene, Disturbance(object_size_factor=factor))
    task.reset(world, None)
    foam = world.model.geom("foam")
    assert (aside < foam.size[0]) == wiped
    # A larger one is placed as much higher, to stand where it stood.
    up = foam.size[2] - foam.pos[2] - 0.5 * (factor - 1.0) * task.sponge.height
    at = world.marker_pose(mark(0)).translation() + np.array([aside, 0.0, up])
    world.place_object("sponge", SE3.from_translation(at))
    monitor = Pressed(world, task.sponge, task.settings)
    monitor.force = 10.0
    monitor.update()
    assert (0 not in marks_left(world)) == wiped


@pytest.mark.parametrize(("force", "left"), [(0.0, 8), (4.99, 8), (5.01, 7)])
def test_a_mark_goes_where_the_sponge_presses(
    over_a_mark: tuple[Pressed, Simulation], force: float, left: int
) -> None:
    monitor, simulation = over_a_mark
    monitor.force = force
    monitor.update()
    assert len(marks_left(simulation)) == left
    assert (0 in marks_left(simulation)) == (left == 8)


@pytest.mark.parametrize(
    ("by", "left"),
    [((0.042, 0.0), 7), ((0.043, 0.0), 8), ((0.0, 0.0175), 7), ((0.0, -0.0185), 8)],
)
def test_a_mark_beside_the_foam_stays(
    over_a_mark: tuple[Pressed, Simulation], by: tuple[float, float], left: int
) -> None:
    monitor, simulation = over_a_mark
    sponge = shifted(simulation.object_pose("sponge"), np.array([*by, 0.0]))
    simulation.place_object("sponge", sponge)
    monitor.force = 10.0
    monitor.update()
    assert len(marks_left(simulation)) == left


def slides(simulation: Simulation, speed: float = 0.05) -> None:
    simulation.data.joint(simulation.model.body("sponge").jntadr[0]).qvel[0] = speed


@pytest.mark.parametrize(
    ("outside", "sign", "ok"), [(0, 1, True), (1, 1, True), (2, -1, False), (100, 1, False)]
)
def test_one_part_in_a_hundred_of_the_time_may_be_out_of_the_band(
    over_a_mark: tuple[Pressed, Simulation], outside: int, sign: int, ok: bool
) -> None:
    """However often it is looked at: out of the band, ten times as often as in it."""
    monitor, simulation = over_a_mark
    slides(simulation)
    for i in range(100):
        monitor.force = 10.0 + sign * (0.6 if i < outside else -0.4)
        for _ in range(10 if i < outside else 1):
            simulation.data.time += 0.001 if i < outside else 0.01
            monitor.update()
    against = monitor.against_force()
    assert (against is None) == ok
    if against is not None:
        worst = 10.0 + 0.6 * sign
        assert f"for {outside:.2f} % of the time of sliding, {worst:.2f} N at worst" in against


def test_a_sponge_that_never_slid_has_not_held_the_force(
    over_a_mark: tuple[Pressed, Simulation],
) -> None:
    assert over_a_mark[0].against_force() == "the sponge has not been led over the board"


@pytest.mark.parametrize(
    ("speed", "force", "beside", "counts"),
    [
        (0.006, 7.0, 0.0, True),
        (0.004, 7.0, 0.0, False),
        (0.05, 0.9, 0.0, False),
        (0.05, 1.1, 0.0, True),
        (0.05, 7.0, 0.25, False),
    ],
)
def test_sliding_is_being_pressed_and_led_over_the_board(
    over_a_mark: tuple[Pressed, Simulation], speed: float, force: float, beside: float, counts: bool
) -> None:
    monitor, simulation = over_a_mark
    at = shifted(simulation.object_pose("sponge"), np.array([0.0, beside, 0.0]))
    simulation.place_object("sponge", at)
    slides(simulation, speed)
    monitor.force = force
    simulation.data.time += 0.02
    monitor.update()
    assert (monitor.against_force() != "the sponge has not been led over the board") == counts
    assert task_state(simulation)[0] == pytest.approx(0.02 if counts else 0.0)


@pytest.mark.parametrize(("up", "left"), [(0.001, 7), (0.003, 8), (-0.024, 7), (-0.026, 8)])
def test_a_mark_goes_where_the_foam_lies_on_it(
    over_a_mark: tuple[Pressed, Simulation], up: float, left: int
) -> None:
    """A hand that presses elsewhere while the sponge is above a mark wipes nothing off."""
    monitor, simulation = over_a_mark
    at = shifted(simulation.object_pose("sponge"), np.array([0.0, 0.0, up]))
    simulation.place_object("sponge", at)
    monitor.force = 10.0
    monitor.update()
    assert len(marks_left(simulation)) == left


def test_the_force_is_that_of_the_foam_on_the_board() -> None:
    """A light sponge on the table, then on the board, by its weight alone."""
    task = Wipe()
    light = DisturbedSimulation(PANDA, task.build_scene, Disturbance(object_mass_factor=0.5))
    task.reset(light, None)
    monitor, holder = WipeMonitor(light, task.sponge, task.settings), Holder(light)
    holder.hold(300)
    assert monitor.pressed() == 0.0
    light.place_object("sponge", upright(list(_lying(light)), 0.0))
    holder.hold(1000)
    assert monitor.pressed() == pytest.approx(0.5 * 9.81 * task.sponge.mass, rel=1e-3)


@pytest.mark.parametrize(("turn", "gone"), [(0.5 * np.pi, 2), (0.0, 0)])
def test_marks_vanish_under_whoever_presses_the_sponge_on_them(turn: float, gone: int) -> None:
    """A policy comes down on a sponge that lies on two marks, or between them, until it feels 8 N.

    The foam is 85 mm long and 36 mm wide; the marks are 40 mm apart.
    """
    task, (x, y, z) = _Lying(turn=turn), _lying(Simulation(PANDA, Wipe().build_scene))
    height = z + 0.06

    def press(seen: Observation) -> ToolTarget:
        nonlocal height
        if seen.time > 1.0 and seen.force[2] < 8.0:
            height -= 2e-4
        return ToolTarget(pose=vector_of(tool_down([x, y, height], 0.0)), width=0.0)

    run = follow(Scripted(press), task=task, timing=PolicyTiming(rate=100.0, seconds=2.6))
    assert run.failure is not None
    assert run.failure.cause is Cause.PLACE
    assert run.failure.evidence.startswith(f"{MARKS - gone} of 8 marks are left")
    assert run.measures["marks_left"] == MARKS - gone
    assert abs(run.rows["contact/tool"][2550, 2] - 8.0) < 1.5


def test_a_hand_that_presses_on_the_table_wipes_nothing_off() -> None:
    """The sponge lies on two marks meanwhile, let go."""
    height = TABLE_TOP + 0.03

    def press(seen: Observation) -> ToolTarget:
        nonlocal height
        if seen.time > 2.0 and seen.force[2] < 6.0:
            height -= 2e-4 if height > TABLE_TOP + 0.011 else 2e-5
        return ToolTarget(pose=vector_of(tool_down([0.45, 0.25, height], 0.0)), width=0.0)

    task, timing = _Lying(turn=0.5 * np.pi), PolicyTiming(rate=100.0, seconds=4.6)
    run = follow(Scripted(press), task=task, timing=timing)
    assert run.rows["contact/tool"][4400:4600, 2].min() > 5.5
    assert run.measures["marks_left"] == MARKS


def _lying(simulation: Simulation) -> np.ndarray:
    """Between the first and the third mark."""
    Wipe().reset(simulation, None)
    first, third = (simulation.marker_pose(mark(i)).translation() for i in (0, 2))
    between: np.ndarray = 0.5 * (first + third) + np.array([0.0, 0.0, 0.5 * Wipe().sponge.height])
    return between


@dataclass(frozen=True, kw_only=True)
class _Lying(Wipe):
    """The sponge lies on the board, turned."""

    turn: float

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        at = _lying(simulation)
        simulation.place_object("sponge", upright(list(at), self.turn))
