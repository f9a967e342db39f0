"""Joints that go both ways while the camera looks: what that teaches, and when it is left out."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
import pytest
from mink import SE3

from robo47_qp.control.friction import FrictionLearning
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.model.obstacle import Obstacle, Shape, add_obstacle
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import Motion, Place, Waypoint
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.steps import Look, StepLike
from robo47_qp.run.task import Program
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.sensed import Sensed
from robo47_qp.stack import ClassicalStack
from tests.examples import shifted
from tests.runs import Reach

FRICTION = 0.6 * np.array([1.0, 1.0, 1.0, 1.0, 0.6, 0.6, 0.6])
"""Of the joints, which the stack is not told [N·m]."""
FRAME = 0.03
"""Time of a look [s]."""


def looks(seconds: float, lasts: float | None = None) -> list[Look]:
    frames = round(seconds / FRAME)
    told = [(frames - i) * FRAME if lasts is None else lasts for i in range(frames)]
    return [Look(seconds=FRAME, lasts=left) for left in told]


def lines(sensed: Sensed) -> list[Waypoint]:
    """Down and up again: at the first reversal friction has to be known."""
    start = sensed.tool_pose()
    heights = (("down", -0.1), ("up", 0.0))
    return [
        Waypoint(name=name, target=shifted(start, np.array([0.0, 0.0, z])), motion=Motion.LIN)
        for name, z in heights
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class Looking(Reach):
    """Looks, then moves on lines."""

    first: Sequence[StepLike] = field(default_factory=lambda: looks(1.5))
    goes_on: bool = True
    beside: tuple[Obstacle, ...] = ()
    """What stands in the scene, though it is not declared."""

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        super().build_scene(spec)
        for obstacle in self.beside:
            add_obstacle(spec, obstacle)

    def preview(self, sensed: Sensed) -> Sequence[Waypoint]:
        return lines(sensed)

    def program(self, sensed: Sensed) -> Program:
        yield from self.first
        if self.goes_on:
            yield from lines(sensed)
            yield Waypoint(name="home", target=Place.HOME)
        return None


NOISE = 5e-5
"""Of measured positions [rad]."""
OBSERVER = DisturbanceObserver()
UNMOVED = replace(OBSERVER, friction=FrictionLearning(swing=0.0))


def carried_out(
    task: Reach,
    observer: DisturbanceObserver | None = OBSERVER,
    pace: float = 1.0,
    link_mass: float = 1.0,
) -> tuple[Run, Runner]:
    wrong = Disturbance(dry_friction=FRICTION[0], noise_q=NOISE, link_mass_factor=link_mass)
    sim = DisturbedSimulation(PANDA, task.build_scene, wrong, np.random.default_rng(1))
    scenario = ClassicalStack(observer=observer, pace=pace).scenario(PANDA, task)
    runner = Runner(scenario, sim)
    return runner.run(), runner


def looked(run: Run) -> np.ndarray:
    """The reference while it is looked (N, n) [rad]."""
    whole = np.column_stack([run.rows["joints/q_ref"], run.rows.values[:, 1]])
    last = next(i for i, phase in enumerate(run.phases) if phase.name != "look")
    found: np.ndarray = whole[whole[:, -1] < last, :-1]
    return found


def off_lines(run: Run) -> float:
    return max(f.extreme for f in audit(run) if f.signal.startswith("LIN measured"))


def test_friction_is_known_before_the_first_line() -> None:
    # Of links that are heavier, too, as much is felt as of friction.
    run, runner = carried_out(Looking(), link_mass=1.05)
    went = looked(run)
    assert run.failure is None
    # Towards the middle of their ranges, and back to where they were.
    inwards = np.sign(0.5 * (runner.loop.arm.q_low + runner.loop.arm.q_high) - PANDA.home)
    furthest = went[np.abs(went - PANDA.home).argmax(axis=0), np.arange(7)] - PANDA.home
    np.testing.assert_allclose(furthest, 0.04 * np.where(inwards < 0.0, -1.0, 1.0), atol=1e-9)
    np.testing.assert_array_equal(went[-1], PANDA.home)
    assert len(went) == pytest.approx(1500, abs=1)
    unmoved, _ = carried_out(Looking(), UNMOVED, link_mass=1.05)
    assert off_lines(run) < 0.5 * off_lines(unmoved)


def test_joints_know_their_friction_after_the_look() -> None:
    _, runner = carried_out(Looking(goes_on=False))
    observed = runner.loop.control.observed
    assert observed is not None
    np.testing.assert_allclose(observed.friction, FRICTION, atol=0.05)
    _, still = carried_out(Looking(goes_on=False), UNMOVED)
    assert still.loop.control.observed is not None
    assert not still.loop.control.observed.friction.any()


@pytest.mark.parametrize(
    "left_out",
    [
        (Looking(first=looks(0.6)), OBSERVER),
        (Looking(), UNMOVED),
        (Looking(), replace(OBSERVER, friction=None)),
        (Looking(), None),
    ],
    ids=["too short", "no swing", "no learning", "no observer"],
)
def test_the_arm_stands_still_where_there_is_no_time_or_no_use(
    left_out: tuple[Looking, DisturbanceObserver | None],
) -> None:
    run, _ = carried_out(*left_out)
    np.testing.assert_array_equal(looked(run), np.tile(PANDA.home, (len(looked(run)), 1)))


def test_it_is_made_once_and_at_home_only() -> None:
    run, _ = carried_out(Looking(first=[*looks(1.5), *looks(1.5)]))
    q = looked(run)
    assert (np.ptp(q[:1500], axis=0) > 0.03).all()
    assert not np.ptp(q[1500:], axis=0).any()


def test_a_look_elsewhere_than_home_is_still() -> None:
    class Away(Looking):
        def program(self, sensed: Sensed) -> Program:
            yield lines(sensed)[0]
            yield from looks(1.5)
            return None

    run, _ = carried_out(Away())
    q, phases = run.rows["joints/q_ref"], run.rows.values[:, 1]
    names = [phase.name for phase in run.phases]
    there = q[phases == names.index("look")]
    assert len(there) == pytest.approx(1500, abs=1)
    assert not np.ptp(there, axis=0).any()


def test_a_motion_that_follows_too_soon_stops_the_joints_first() -> None:
    task = Looking(first=[*looks(0.3, lasts=2.0)])
    run, _ = carried_out(task)
    assert [phase.name for phase in run.phases][:2] == ["look", "stop"]
    assert all(finding.ok for finding in audit(run) if "jerk" in finding.signal)

    class Again(Looking):
        """A look after something else does not go on with what was cut short."""

        def program(self, sensed: Sensed) -> Program:
            yield from looks(0.3, lasts=2.0)
            yield Waypoint(name="home", target=Place.HOME)
            yield from looks(1.5)
            return None

    run, _ = carried_out(Again())
    q, phases = run.rows["joints/q_ref"], run.rows.values[:, 1]
    names = [phase.name for phase in run.phases]
    assert names[:4] == ["look", "stop", "home", "look"]
    np.testing.assert_array_equal(q[phases == 3], np.tile(PANDA.home, (1500, 1)))


@pytest.mark.parametrize("declared", [True, False])
def test_nothing_is_hit(declared: bool) -> None:
    # The hand is 0.2 m wide, and would go 35 mm to this side.
    wall = Obstacle(
        name="wall",
        shape=Shape.BOX,
        size=(0.05, 0.01, 0.05),
        T_world_obstacle=SE3.from_translation(np.array([0.307, 0.125, 0.58])),
    )
    standing = looks(1.5)
    task = Looking(obstacles=(wall,)) if declared else Looking(beside=(wall,))
    run, _ = carried_out(replace(task, first=standing, goes_on=False))
    assert not np.ptp(looked(run), axis=0).any()
    clear, _ = carried_out(Looking(first=standing, goes_on=False))
    assert np.ptp(looked(clear), axis=0).all()


def test_it_takes_the_pace_of_the_other_motions() -> None:
    slow, _ = carried_out(Looking(first=looks(3.0)), pace=0.5)
    q = looked(slow)
    # As long there as at full pace there and back.
    quick = looked(carried_out(Looking())[0])
    halfway = [int(np.abs(way - PANDA.home)[:, 0].argmax()) for way in (quick, q)]
    assert halfway[1] == pytest.approx(2 * halfway[0], abs=2)
