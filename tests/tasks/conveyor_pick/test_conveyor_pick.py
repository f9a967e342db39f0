"""Picking from a belt: the cube is carried by friction, caught in motion and placed."""

from dataclasses import replace
from functools import cache
from itertools import islice

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.failure import Cause
from robo47_qp.run.follow_step import Follow
from robo47_qp.run.recording import Rows
from robo47_qp.run.scenario import Run
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.conveyor_pick import belt_picker
from robo47_qp.tasks.conveyor_pick.belt_picker import BeltPicker
from robo47_qp.tasks.conveyor_pick.conveyor_pick import ConveyorPick
from robo47_qp.tasks.handling.object_tracker import ObjectTracker
from robo47_qp.tasks.heading import raised, upright
from tests.runs import Holder, Meddler, at_rest, carry_out, live, make_runner


@cache
def undisturbed() -> Run:
    return carry_out(ConveyorPick())


def names(run: Run) -> list[str]:
    return [phase.name for phase in run.phases]


def rows_of(run: Run, name: str) -> slice:
    i = names(run).index(name)
    return slice(run.phases[i].start, run.phases[i + 1].start)


def shifted(simulation: Simulation, by: float) -> None:
    """The cube further along the belt [m]."""
    pose = SE3.from_translation(np.array([0.0, by, 0.0])) @ simulation.object_pose("cube")
    simulation.place_object("cube", pose)


def test_the_cube_is_caught_in_motion_and_placed() -> None:
    run = undisturbed()
    assert run.failure is None
    assert [found for found in audit(run) if not found.ok] == []
    assert names(run).count("close gripper") == 1
    cube = run.rows["objects/cube"]
    goal = np.array([0.32, 0.0, 0.02])
    assert np.linalg.norm(cube[-1, :3] - goal) < 2e-3
    # It still moves with the belt as the fingers close, and as it leaves it.
    for phase in ("close gripper", "lift"):
        y = cube[rows_of(run, phase), 1]
        assert (y[50] - y[0]) / 0.05 == pytest.approx(0.12, rel=0.02)


def test_the_tool_moves_with_the_cube_without_lead_or_lag() -> None:
    run = undisturbed()
    rows = rows_of(run, "close gripper")
    ahead = run.rows["tool/pose_ref"][rows, 1][:50] - run.rows["objects/cube"][rows, 1][:50]
    # A period of 1 ms at 0.12 m/s is 0.12 mm.
    assert np.abs(ahead).max() < 0.03e-3


class OnFastestBelt(ObjectTracker):
    """Knows the cube on a belt at 0.2 m/s."""

    velocity = np.array([0.0, 0.2, 0.0])

    def at(self, time: float) -> SE3:
        """See `ObjectTracker.at`."""
        return SE3.from_translation(np.array([0.5, 0.2 * time, 0.1]))


def picker(simulation: Simulation | None = None) -> BeltPicker:
    task = ConveyorPick()
    sensed = live(simulation or Simulation(PANDA, task.build_scene))
    return replace(task._picker(sensed), tracker=OnFastestBelt(sensed, "cube"))


def test_setting_out_leaves_the_joints_room_below_their_accelerations() -> None:
    """3 rad/s² at 0.4 m are 1.2 m/s²: at the bounds, the stream jumps from one to the other."""
    lead, belt = belt_picker._LEAD, picker()
    waits = raised(belt._grasp(belt.tracker.at(lead)), belt.rise)
    late = SE3.from_translation(np.array([0.0, -0.02, 0.0])) @ waits
    target = belt._setting_out(late, 0.0, lead, 2.0 * lead)
    times = np.arange(0.0, 2.0 * lead, 2e-3)
    places = np.array([target(time).translation() for time in times])
    assert np.linalg.norm(np.diff(places, 2, axis=0), axis=1).max() / 2e-3**2 < 0.9


def test_fingers_keep_to_the_sides_of_a_cube_that_is_seen_a_little_otherwise() -> None:
    class Turning(ObjectTracker):
        """Seen at nearly an eighth of a turn, then a little beyond."""

        def at(self, time: float) -> SE3:
            return upright([0.5, 0.1, 0.05], np.pi / 4 + (0.02 if time > 0.0 else -0.02))

    belt = picker()
    belt = replace(belt, tracker=Turning(belt.sensed, "cube", 0.05))
    now, later = (belt._kept(belt.tracker.at(time)) for time in (0.0, 1.0))
    np.testing.assert_allclose((now.inverse() @ later).log(), [0, 0, 0, 0, 0, -0.04], atol=1e-9)
    other = belt._grasp(belt.tracker.at(1.0))
    assert np.linalg.norm((now.inverse() @ other).rotation().log()) > 1.5


@pytest.mark.parametrize("errs", [False, True])
def test_where_the_camera_errs_fingers_close_around_the_item_on_the_way_and_then_gently(
    errs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(belt_picker, "camera_errs", lambda _: errs)
    *_, descend, close = islice(picker().catch(-0.1), 5)
    assert isinstance(descend, Follow)
    assert isinstance(close, Follow)
    assert close.grip is not None
    assert close.grip.width == 0.0
    if errs:
        assert descend.grip is not None
        assert 0.044 < descend.grip.width < 0.05
        assert close.grip.speed <= 0.03
        # In the time that closing may take, and force after that.
        assert close.seconds > 1.0 + (descend.grip.width - 0.04) / close.grip.speed
    else:
        assert descend.grip is None


def test_the_cube_is_seen_until_fingers_close_on_it_and_its_target_does_not_leap() -> None:
    task, noisy = ConveyorPick(), Disturbance(pose_noise=4e-3)
    simulation = DisturbedSimulation(PANDA, task.build_scene, noisy, np.random.default_rng(7))
    task.reset(simulation, None)
    belt = task._picker(live(simulation))
    tracker = belt.tracker
    for _ in range(10):
        Holder(simulation).hold(34)
        tracker.update()
    *_, follow, descend, _ = islice(belt.catch(-0.1), 5)
    for step, changes in ((follow, False), (descend, True)):
        assert isinstance(step, Follow)
        Holder(simulation).hold(34)
        count, now = len(tracker._seen), simulation.time
        before, later = tracker.at(now), tracker.at(now + 0.5)
        assert [condition.against() for condition in step.during] == [None]
        assert len(tracker._seen) == count + 1
        assert (before.inverse() @ tracker.at(now)).log() == pytest.approx(np.zeros(6), abs=1e-9)
        changed = np.linalg.norm((later.inverse() @ tracker.at(now + 0.5)).translation()) > 1e-4
        assert changed == changes, step.name


@pytest.mark.parametrize(
    ("lacks", "turned", "lifted"),
    [(0.039, 0.39, True), (0.041, 0.0, False), (0.0, 0.41, False)],
)
def test_a_lift_may_end_short_of_its_pose_where_joints_end(
    lacks: float, turned: float, lifted: bool
) -> None:
    class Short(BeltPicker):
        """Whose tool stays below where the lift ends, and turned."""

        def _tool(self) -> SE3:
            above = raised(self._kept(self.tracker.at(0.2)), self.rise)
            off = SE3.from_translation(np.array([0.0, 0.0, -lacks]))
            return off @ above @ SE3.from_rotation(SO3.from_x_radians(turned))

    simulation = Simulation(PANDA, ConveyorPick().build_scene)
    belt = picker(simulation)
    short = Short(**{name: getattr(belt, name) for name in belt.__dataclass_fields__})
    *_, lift = islice(short.catch(-0.1), 6)
    assert isinstance(lift, Follow)
    assert lift.name == "lift"
    Holder(simulation).hold(801)
    assert (lift.until.against() is None) == lifted


def test_the_belt_takes_the_cube_along_by_friction() -> None:
    task = ConveyorPick(speed=-0.2)
    simulation = Simulation(PANDA, task.build_scene)
    task.reset(simulation, None)
    ys = [float(simulation.object_pose("cube").translation()[1])]
    speeds: list[float] = []

    def look() -> None:
        ys.append(float(simulation.object_pose("cube").translation()[1]))
        speeds.append(float(simulation.object_twist("cube")[1]))

    Holder(simulation).hold(400, look)
    assert speeds[0] > -0.011
    assert speeds[-1] == pytest.approx(-0.2, rel=1e-3)
    # Never more than the belt, nor faster than friction allows.
    assert np.abs(np.diff(ys)).max() < 0.2e-3 * 1.05
    assert np.abs(np.diff(speeds)).max() < 2.0 * 9.81e-3


def test_a_cube_that_slips_away_is_caught_the_next_time() -> None:
    meddler = Meddler("close gripper", lambda simulation: shifted(simulation, -0.10))
    run = carry_out(ConveyorPick(speed=0.08), observers=[meddler])
    assert meddler.done == 1
    assert run.failure is None
    assert names(run).count("close gripper") == 2
    broken = [found.signal for found in audit(run) if not found.ok]
    assert broken == ["object jump (cube)", "object kick (cube)"], "what moved it was no contact"


def test_a_cube_that_has_gone_by_is_given_up() -> None:
    meddler = Meddler("watch the cube", lambda simulation: shifted(simulation, 0.9))
    run = carry_out(ConveyorPick(), observers=[meddler])
    assert run.failure is not None
    assert run.failure.cause is Cause.TIMEOUT
    assert "m along the belt when the tool can be there; it is met up to 0.20 m" in (
        run.failure.evidence
    )
    assert np.abs(run.rows["joints/q"][-1] - PANDA.home).max() < 1e-3


def test_a_cube_that_is_never_held_is_a_failed_grasp() -> None:
    meddler = Meddler("close gripper", lambda simulation: shifted(simulation, -0.1), times=9)
    run = carry_out(ConveyorPick(speed=0.05, retries=0), observers=[meddler])
    assert run.failure is not None
    assert run.failure.cause is Cause.GRASP
    assert "mm apart, the cube measures 40.0 mm" in run.failure.evidence
    # It is given up as soon as the fingers have passed it.
    closed = rows_of(run, "close gripper").stop - 1
    assert run.rows["gripper/width"][closed, 0] > 0.03


def test_only_streamed_rows_may_jump_in_acceleration() -> None:
    run = undisturbed()
    first, last = rows_of(run, "follow").start, rows_of(run, "lift").stop

    def jumped(row: int) -> list[str]:
        rows = Rows(run.rows.signals, run.rows.values.copy())
        rows["joints/a_ref"][row, 4] += 0.05
        broken = [f.signal for f in audit(replace(run, rows=rows)) if not f.ok]
        # The velocity does not change with it.
        return [name for name in broken if not name.startswith("reference v to a")]

    assert jumped(first + 1) == jumped(last - 1) == []
    assert jumped(first - 1) == jumped(last + 1) == ["reference jerk (joint5)"]


@pytest.mark.parametrize(
    ("off", "placed"),
    [((4.9e-3, 0, 0), True), ((0, 5.1e-3, 0), False), ((0, 0, 0.01), False)],
)
def test_near_is_judged_by_the_tolerance(off: tuple[float, ...], placed: bool) -> None:
    task = ConveyorPick()
    _, simulation = make_runner(task)
    simulation.place_object("cube", SE3.from_translation(np.array([0.32, 0.0, 0.02]) + off))
    at_rest(simulation)
    failure = task.verdict(simulation)
    assert (failure is None) == placed
    if failure is not None:
        assert failure.cause is Cause.PLACE
        assert "from its goal" in failure.evidence


@pytest.mark.parametrize("speed", [0.12, -0.12])
def test_the_cube_comes_from_upstream_and_is_met_from_there_to_the_end(speed: float) -> None:
    """Whichever way the belt runs, all places are along its motion."""
    task, way = ConveyorPick(speed=speed), np.sign(speed)
    simulation = Simulation(PANDA, task.build_scene)
    task.reset(simulation, None)
    assert simulation.model.geom_surfacevel[simulation.model.geom("belt").id][1] == speed
    assert way * simulation.object_pose("cube").translation()[1] == pytest.approx(-0.5)
    assert way * task._first == pytest.approx(-0.3)
    for along, evidence in ((-0.25, None), (0.19, None), (0.21, "will be 0.21 m along")):
        pose = shifted_pose(simulation, way * along)
        tracker = At(simulation, pose, speed)
        failure = task._gone(replace(task._picker(live(simulation)), tracker=tracker))
        assert (failure is None) == (evidence is None)
        if failure is not None:
            assert failure.cause is Cause.TIMEOUT
            assert str(evidence) in failure.evidence


class At(ObjectTracker):
    """Finds the cube at the same pose at all times, with a velocity (3,) [m/s]."""

    def __init__(self, simulation: Simulation, pose: SE3, speed: float) -> None:
        super().__init__(live(simulation), "cube")
        self._pose, self._speed = pose, np.array([0.0, speed, 0.0])

    def at(self, time: float) -> SE3:
        return self._pose


def shifted_pose(simulation: Simulation, y: float) -> SE3:
    x, _, z = simulation.object_pose("cube").translation()
    return SE3.from_translation(np.array([x, y, z]))


def test_variants_run_both_ways_at_the_speeds_that_are_told() -> None:
    speeds = [ConveyorPick().variant(np.random.default_rng(seed)).speed for seed in range(100)]
    assert min(np.abs(speeds)) >= 0.05
    assert max(np.abs(speeds)) <= 0.20
    assert 30 < sum(speed > 0.0 for speed in speeds) < 70


@pytest.mark.parametrize("speed", [0.0, 0.21, np.nan])
def test_speeds_that_are_none_are_refused(speed: float) -> None:
    with pytest.raises(
        InvalidValueError, match=r"speed must be (up to 0\.2 m/s, and not 0|a finite number); found"
    ):
        ConveyorPick(speed=speed)


def test_a_cube_that_lies_beside_the_belt_is_gone() -> None:
    task = ConveyorPick()
    simulation = Simulation(PANDA, task.build_scene)
    task.reset(simulation, None)
    beside = SE3.from_translation(np.array([0.32, -0.3, 0.02]))
    simulation.place_object("cube", beside)
    sensed, holder = live(simulation), Holder(simulation)
    picker = task._picker(sensed)
    for _ in range(10):
        holder.hold(34)
        picker.tracker.update()
    failure = task._gone(picker)
    assert failure is not None
    assert failure.evidence == "the cube does not move along with the belt"
