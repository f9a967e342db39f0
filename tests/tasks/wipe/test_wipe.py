"""Wiping: the force is held while the sponge slides, all marks go, what goes wrong is noticed."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from mink import SE3

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.perturbation import PRESETS, Perturbation
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.failure import Cause
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.watchdog import Watchdog
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.handling.wrist import FreeWrist
from robo47_qp.tasks.task_state import hide_marker, task_state
from robo47_qp.tasks.wipe.board import (
    BOARD,
    MARKS,
    SURFACE,
    WipeSettings,
    mark,
)
from robo47_qp.tasks.wipe.foam import FoamSpring, Touch, Unloading
from robo47_qp.tasks.wipe.wipe import Wipe
from tests.examples import shifted
from tests.robots import GRIPPER
from tests.runs import Meddler, at_rest, carry_out

WEIGHT = 9.81 * 0.04


WHOLE = 600.0
"""Longer than any run [s]."""


@cache
def wiped(seed: int, seconds: float) -> Run:
    """A run, or its first seconds."""
    task = Wipe()
    scenario = ClassicalStack().scenario(PANDA, task, seed)
    scenario = replace(scenario, watchdog=Watchdog(time_limit=seconds))
    return Runner(scenario, Simulation(PANDA, task.build_scene)).run()


def rows_of(run: Run, first: str, signal: str) -> np.ndarray:
    """Rows of a signal in all phases whose name begins so."""
    ends = [phase.start for phase in run.phases[1:]] + [len(run.rows)]
    spans = zip(run.phases, ends, strict=True)
    parts = [run.rows[signal][p.start : end] for p, end in spans if p.name.startswith(first)]
    return np.concatenate(parts)


def test_the_board_is_wiped_and_the_sponge_put_back_within_all_limits() -> None:
    run = wiped(3, WHOLE)
    assert run.failure is None
    assert run.measures["marks_left"] == 0.0
    assert run.measures["sponge_error_m"] <= 5e-3
    assert [finding.signal for finding in audit(run) if not finding.ok] == []


@pytest.mark.parametrize(
    ("seed", "seconds", "way"), [(3, WHOLE, 0.6), (79, 14.1, 0.23), (343, 16.4, 0.23)]
)
def test_the_force_is_held_while_it_slides(seed: int, seconds: float, way: float) -> None:
    """Judged from the recording alone, by a hand of its own.

    At the touch of seed 79 the force swings to and fro, at that of 343 it creeps to what is asked:
    there the way down, the first stroke and the first turn are enough.
    """
    run = wiped(seed, seconds)
    assert (run.failure is None) == (seed == 3)
    assert run.failure is None or run.failure.cause is Cause.TIMEOUT
    sponge = run.rows["objects/sponge"]
    names = np.array([phase.name for phase in run.phases])[run.rows["phase"][:, 0].astype(int)]
    wiping = np.char.startswith(names, "stroke") | np.char.startswith(names, "turn")
    speed = np.linalg.norm(np.gradient(sponge[:, :2], 1e-3, axis=0), axis=1)
    sliding = wiping & (speed > 5e-3)
    force = run.rows["contact/tool"][sliding, 2] + WEIGHT
    assert np.mean(np.abs(force - 10.0) <= 0.5) >= 0.99
    assert speed[sliding].sum() * 1e-3 > way
    assert speed[sliding].max() < 0.1


def test_it_meets_the_board_at_a_tenth_of_a_metre_per_second_and_not_too_hard() -> None:
    run = wiped(3, WHOLE)
    z = rows_of(run, "touch down", "tool/pose")[:, 2]
    assert 0.05 < -np.diff(z).min() / 1e-3 <= 0.101
    assert np.linalg.norm(run.rows["contact/tool"], axis=1).max() <= 30.0


@cache
def wiped_by_foam() -> tuple[Run, float]:
    """A run with a wrist that errs and a light sponge, up to the middle of its first stroke, and
    the weight of the sponge [N]."""
    erring = Perturbation(noise_force=0.3, force_drift=1.0, object_mass=-0.3, object_com=0.01)
    episode = TaskEpisode(robot=PANDA, task=Wipe(), perturbation=erring)
    scenario = replace(episode.scenario(80001), watchdog=Watchdog(time_limit=77.0))
    return Runner(scenario, episode.simulation(scenario, 80001)).run(), 0.7 * WEIGHT


def test_where_the_wrist_drifts_the_foam_tells_the_force() -> None:
    """The drift of the sensor is twice the band of the force; judged by a hand of its own."""
    run, weight = wiped_by_foam()
    assert run.failure is not None
    assert run.failure.cause is Cause.TIMEOUT
    stroke = rows_of(run, "stroke 1", "contact/tool")[:, 2]
    assert len(stroke) > 10000
    # It begins slowly.
    places = rows_of(run, "stroke 1", "tool/pose_ref")[::100, :2]
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / 0.1
    assert speeds[:20].max() <= 0.25 * 0.0125 * 1.01
    assert 0.010 < speeds[40:].max() <= 0.0125
    assert np.mean(np.abs(stroke + weight - 10.0) <= 0.5) >= 0.99
    assert [finding.signal for finding in audit(run) if not finding.ok] == []


def test_touches_of_a_drifting_wrist_are_averaged() -> None:
    """Touches are even in truth, each with an error of the wrist's; the stroke has less."""
    run, weight = wiped_by_foam()
    ends = [phase.start for phase in run.phases[1:]] + [len(run.rows)]
    force = run.rows["contact/tool"][:, 2] + weight
    touches = [
        force[end - 100 : end].mean()
        for phase, end in zip(run.phases, ends, strict=True)
        if phase.name == "touch down"
    ]
    # That of the run in, seven, and one before the stroke.
    assert len(touches) == 9
    stroke = rows_of(run, "stroke 1", "contact/tool")[:, 2].mean()
    assert abs(stroke + weight - 10.0) < np.abs(np.array(touches) - 10.0).max()


class Foam(Sensed):
    """A sponge of a stiffness on a board at height 0, which creeps; a wrist that drifts along."""

    def __init__(self, stiffness: float, friction: float) -> None:
        self.stiffness, self.friction = stiffness, friction
        self.height = self.pressed = self.clock = self.speed = self.push = 0.0

    @property
    def time(self) -> float:
        return self.clock

    @property
    def true_force(self) -> float:
        lifted = 0.0137 * self.friction * self.speed
        return self.stiffness * (lifted - self.height) - 0.02 * self.pressed

    def tool_pose(self, tool: int = 0) -> SE3:
        return SE3.from_translation(np.array([0.0, 0.0, self.height]))

    def felt_force(self, tool: int = 0) -> np.ndarray:
        drag = self.friction * self.true_force if self.speed else 0.0
        return np.array([0.7, -0.4 - drag, self.true_force + 0.1 * self.clock + self.push])

    def free(self) -> FreeWrist:
        """Wait a second with the sponge in the air, and read the wrist."""
        self.clock += 1.0
        force = np.array([0.7, -0.4, 0.1 * self.clock])
        return FreeWrist(force=force, time=self.clock)

    def above(self, free: FreeWrist) -> float:
        """Return the force beyond that of the free wrist [N]."""
        return float((self.felt_force() - free.force)[2])

    def touched(self, free: FreeWrist, force: float) -> Touch:
        """Press with a force that is felt for as long as a touch is."""
        touch = Touch(self, partial(self.above, free), 5.0)
        while not touch.done:
            self.height += (self.above(free) - force) / self.stiffness
            touch.read()
            self.clock, self.pressed = self.clock + 0.01, self.pressed + 0.01
        return touch

    def relieve(self, lift: Unloading) -> None:
        """Take all of the force away in 2.2 s; the sponge creeps the less, the less is left."""
        whole = self.true_force
        for left in np.linspace(1.0, 0.0, 221)[1:]:
            self.height += whole / 220 / self.stiffness
            lift.read()
            self.clock, self.pressed = self.clock + 0.01, self.pressed + 0.01 * left

    def touch(self, spring: FoamSpring, *forces: float, pushed: Sequence[int] = ()) -> FreeWrist:
        """Touch with forces that are felt, some of them pushed, and read the wrist."""
        free = self.free()
        for k, force in enumerate(forces):
            self.push = 6.0 if k in pushed else 0.0
            touch = self.touched(free, force)
            self.push = 0.0
            lift = Unloading(self, partial(self.above, free))
            self.relieve(lift)
            after = self.free()
            spring.add(touch, lift, free, after)
            free = after
        return free


@pytest.mark.parametrize("pushed", [(1,), (0, 2)])
def test_touches_in_which_something_pushed_do_not_count(pushed: tuple[int, ...]) -> None:
    cell, spring = Foam(1100.0, 0.5), FoamSpring(10.0)
    free = cell.touch(spring, 9.9, 10.2, 10.0, 9.9, 10.1, pushed=pushed)
    touch = cell.touched(free, 10.0)
    assert spring.force_at(cell, touch) == pytest.approx(cell.true_force, abs=0.1)


@pytest.mark.parametrize("stiffness", [770.0, 1100.0, 1430.0])
@pytest.mark.parametrize("friction", [0.3, 0.9])
def test_the_foam_tells_the_force_whatever_its_stiffness_and_its_friction(
    stiffness: float, friction: float
) -> None:
    cell, spring = Foam(stiffness, friction), FoamSpring(10.0)
    free = cell.touch(spring, 9.6, 10.3, 10.1, 9.9)
    assert spring.stiffness == pytest.approx(stiffness, rel=0.01)
    touch = cell.touched(free, 10.0)
    assert spring.force_at(cell, touch) == pytest.approx(cell.true_force, abs=0.05)
    cell.speed = 0.0125
    way = np.array([0.0, 1.0, 0.0])
    felt = 0.0
    for _ in range(500):
        cell.clock, cell.pressed = cell.clock + 0.01, cell.pressed + 0.01
        felt = spring.force_dragged(cell, touch, free.force, way)
    assert felt == pytest.approx(cell.true_force, abs=0.06)


@pytest.mark.parametrize(
    ("tolerance", "least", "most"), [(0.0, 10.0, 10.0), (0.6, 6.25, 25.0), (8.0, 5.0, 33.33)]
)
def test_the_first_rise_suits_every_foam_that_there_may_be(
    tolerance: float, least: float, most: float
) -> None:
    spring = FoamSpring(10.0)
    assert spring.way == pytest.approx(10e-3)
    assert spring.ways(tolerance) == pytest.approx((1e-3 * least, 1e-3 * most), rel=1e-3)


def test_a_sponge_lost_on_the_board_is_a_drop() -> None:
    def take(simulation: Simulation) -> None:
        simulation.place_object("sponge", SE3.from_translation(np.array([0.3, 0.3, 0.04])))

    meddler = Meddler("stroke 1", take, after=0.5)
    run = carry_out(Wipe(retries=0), observers=[meddler])
    assert run.failure is not None
    assert (run.failure.cause, run.failure.step) == (Cause.DROP, "wipe")
    assert run.failure.condition == "the fingers hold the sponge"
    assert [phase.name for phase in run.phases][-5:] == [
        "stop",
        "back off",
        "open gripper",
        "home",
        "end",
    ]


@pytest.fixture
def done() -> tuple[Wipe, Simulation]:
    """A world in which all is as it should be at the end."""
    task = Wipe()
    simulation = Simulation(PANDA, task.build_scene)
    task.reset(simulation, None)
    for i in range(MARKS):
        hide_marker(simulation, mark(i))
    task_state(simulation)[:] = [10.0, 0.0, 0.3, 20.0]
    at_rest(simulation)
    return task, simulation


def test_all_as_it_should_be_is_success(done: tuple[Wipe, Simulation]) -> None:
    task, simulation = done
    assert task.verdict(simulation) is None
    assert task.measures(simulation)["marks_left"] == 0.0
    task_state(simulation)[:] = [10.0, 0.11, 0.6, 20.0]
    failure = task.verdict(simulation)
    assert failure is not None
    assert failure.cause is Cause.PLACE
    assert failure.evidence.startswith("the force was off by more than 5 % for 1.10 %")


def test_one_mark_left_is_not_the_end(done: tuple[Wipe, Simulation]) -> None:
    task, simulation = done
    simulation.place_marker(mark(5), SE3.from_translation(np.array([0.5, 0.0, SURFACE])))
    failure = task.verdict(simulation)
    assert failure is not None
    assert failure.cause is Cause.PLACE
    assert "1 of 8 marks are left" in failure.evidence


@pytest.mark.parametrize(("distance", "ok"), [(9e-3, True), (11e-3, False)])
def test_the_sponge_has_to_be_back(
    done: tuple[Wipe, Simulation], distance: float, ok: bool
) -> None:
    task, simulation = done
    at = shifted(simulation.object_pose("sponge"), np.array([0.6, 0.8, 0.0]) * distance)
    simulation.place_object("sponge", at)
    failure = task.verdict(simulation)
    assert (failure is None) == ok
    if failure is not None:
        assert "the sponge is 11.0 mm from its goal" in failure.evidence


def test_arm_and_gripper_have_to_be_away(done: tuple[Wipe, Simulation]) -> None:
    task, simulation = done
    simulation.data.joint(PANDA.joints[2]).qpos[0] += 0.011
    failure = task.verdict(simulation)
    assert failure is not None
    assert "a joint is 0.011 rad from home" in failure.evidence
    simulation.data.joint(PANDA.joints[2]).qpos[0] -= 0.011
    simulation.data.joint(GRIPPER.joints[0]).qpos[0] = 0.03
    failure = task.verdict(simulation)
    assert failure is not None
    assert "the gripper is open 70.0 mm" in failure.evidence


@pytest.mark.parametrize("seed", range(20))
def test_random_marks_are_on_the_board_and_the_sponge_is_beside_it(seed: int) -> None:
    task = Wipe()
    simulation = Simulation(PANDA, Wipe().build_scene)
    task.reset(simulation, np.random.default_rng(seed))
    board = simulation.marker_pose("board")
    assert abs(board.translation()[2] - SURFACE) <= 5e-3
    for i in range(MARKS):
        at = (board.inverse() @ simulation.marker_pose(mark(i))).translation()
        assert (np.abs(at[:2]) <= 0.5 * np.array(BOARD)).all()
        assert abs(at[2]) < 1e-9
    sponge = (board.inverse() @ simulation.object_pose("sponge")).translation()
    assert (np.abs(sponge[:2]) > 0.5 * np.array(BOARD) + 0.02).any()


@pytest.mark.parametrize("name", ["force", "force_least", "band", "speed", "touch_speed"])
@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_impossible_settings_are_refused(name: str, value: float) -> None:
    with pytest.raises(InvalidValueError, match=f"{name} must be above 0 and finite; found"):
        replace(WipeSettings(), **{name: value})


def test_a_sponge_on_a_stiff_arm_that_errs_does_not_slip_as_it_touches() -> None:
    """In a severe world, friction bends the arm aside as it touches: it is to let go slowly."""
    severe = replace(PRESETS["severe"], pushes=0)
    episode = TaskEpisode(robot=PANDA, task=Wipe(), perturbation=severe)
    scenario = replace(episode.scenario(78104), watchdog=Watchdog(time_limit=98.0))
    simulation = episode.simulation(scenario, 78104)
    run = Runner(scenario, simulation).run()
    assert [phase.name for phase in run.phases].count("touch down") == 9
    slid, outside, *_ = task_state(simulation)
    # With five seconds of the first stroke; a success may have 0.46 s in all.
    assert 4.0 < slid < 6.0
    assert outside <= 0.23
