"""Steps in a program: conditions are looked at when they should be, failures reach the program."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import Motion, Place, Waypoint
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.compliance import Compliance
from robo47_qp.run.contact_steps import Guarded, Press
from robo47_qp.run.failure import Cause, Condition, Failure, StepFailed
from robo47_qp.run.runner import Runner
from robo47_qp.run.steps import Grasp, Look, Move, Release, StepLike, Wait, as_step
from robo47_qp.run.task import Program
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from tests.robots import GRIPPER
from tests.run.written import Told, Written, names, run_program, up
from tests.runs import Witness, carry_out


def test_a_condition_before_a_step_keeps_it_from_beginning() -> None:
    told = Told(["not now"])

    def program(sensed: Sensed) -> Program:
        yield Move(waypoints=(up(sensed),), before=(told.condition(),))
        return None

    run = run_program(program)
    assert names(run) == ["end"]
    assert run.failure == Failure(
        cause=Cause.SLIP, evidence="not now", step="up", condition="as told", time=0.0
    )


def test_a_condition_after_a_step_is_looked_at_once_it_is_done() -> None:
    heights: list[float] = []

    def program(sensed: Sensed) -> Program:
        start = sensed.tool_pose().translation()[2]

        def against() -> str:
            heights.append(sensed.tool_pose().translation()[2] - start)
            return "too high"

        high = Condition(name="low", cause=Cause.PLACE, against=against)
        yield Move(waypoints=(up(sensed),), after=(high,))
        return None

    run = run_program(program)
    assert heights == [pytest.approx(0.05, abs=1e-4)]
    assert run.failure is not None
    assert (run.failure.cause, run.failure.step) == (Cause.PLACE, "up")
    assert run.failure.time == pytest.approx(run.phases[-1].start * TIMESTEP)


def test_a_condition_during_a_motion_stops_it_within_the_limits() -> None:
    told = Told([None] * 10 + ["gone"], cause=Cause.DROP)

    def program(sensed: Sensed) -> Program:
        yield Move(waypoints=(up(sensed, 0.1),), during=(told.condition(),))
        return None

    run = run_program(program)
    assert names(run) == ["up", "stop", "end"]
    assert run.failure is not None
    assert (run.failure.cause, run.failure.evidence) == (Cause.DROP, "gone")
    assert len(told.looks) == 11
    assert all(finding.ok for finding in audit(run))
    rise = np.ptp(run.rows["tool/pose_ref"][:, 2])
    assert 1e-3 < rise < 0.08
    assert not run.rows["joints/v_ref"][-1].any()


def test_a_program_may_catch_a_failure_and_go_on() -> None:
    told, caught = Told(["no"]), list[Failure]()

    def program(sensed: Sensed) -> Program:
        try:
            yield Move(waypoints=(up(sensed, name="first"),), after=(told.condition(),))
        except StepFailed as error:
            caught.append(error.failure)
            yield Waypoint(name="home", target=Place.HOME)
        return None

    run = run_program(program)
    assert run.failure is None
    assert names(run) == ["first", "home", "end"]
    assert caught[0].evidence == "no"
    assert caught[0].time == pytest.approx(run.phases[1].start * TIMESTEP)


def test_the_evidence_tells_what_had_failed_before() -> None:
    def program(sensed: Sensed) -> Program:
        for name, cause in (("first", Cause.SLIP), ("second", Cause.GRASP)):
            with suppress(StepFailed):
                yield Wait(name=name, seconds=0.1, until=Told(["no"], cause=cause).condition())
        yield Wait(name="third", seconds=0.1, until=Told(["never"], cause=Cause.DROP).condition())
        return None

    run = run_program(program)
    assert run.failure is not None
    assert (run.failure.cause, run.failure.step, run.failed_steps) == (Cause.DROP, "third", 3)
    before = "failed before: first (slip) at 0.1 s, second (grasp) at 0.2 s"
    assert run.failure.evidence == f"never; {before}"


def test_a_waypoint_out_of_reach_and_a_way_that_is_blocked_have_their_own_causes() -> None:
    failures: list[Failure] = []

    def program(sensed: Sensed) -> Program:
        far = SE3.from_translation(np.array([3.0, 0.0, 0.5]))
        turned = sensed.tool_pose() @ SE3.from_rotation(SO3.from_z_radians(3.1))
        for waypoint in (
            Waypoint(name="far", target=far),
            Waypoint(name="turned", target=turned, motion=Motion.LIN),
        ):
            try:
                yield waypoint
            except StepFailed as error:
                failures.append(error.failure)
        return None

    assert run_program(program).failure is None
    assert [(f.cause, f.step) for f in failures] == [(Cause.IK, "far"), (Cause.PLAN, "turned")]
    assert "'far'" in failures[0].evidence
    assert "'turned'" in failures[1].evidence


def test_waiting_ends_as_soon_as_the_condition_holds() -> None:
    def program(sensed: Sensed) -> Program:
        def against() -> str | None:
            return None if sensed.time >= 0.1 - 1e-9 else "too early"

        late = Condition(name="late", cause=Cause.TIMEOUT, against=against)
        yield Wait(seconds=5.0, until=late)
        return None

    run = run_program(program)
    assert run.failure is None
    assert run.phases[1].start == pytest.approx(0.1 / TIMESTEP, abs=21)


def test_waiting_in_vain_fails_with_the_cause_of_the_condition() -> None:
    def program(_: Sensed) -> Program:
        never = Told(["still nothing"], cause=Cause.TIMEOUT).condition()
        yield Wait(name="patience", seconds=0.25, until=never)
        return None

    run = run_program(program)
    assert run.failure is not None
    assert run.failure.time == pytest.approx(0.25)
    assert replace(run.failure, time=None) == Failure(
        cause=Cause.TIMEOUT, evidence="still nothing", step="patience", condition="as told"
    )


@pytest.mark.parametrize("seconds", [0.013, 0.3])
def test_waiting_for_nothing_takes_the_time_asked_for(seconds: float) -> None:
    def program(_: Sensed) -> Program:
        yield Wait(seconds=seconds)
        return None

    run = run_program(program)
    assert run.phases[1].start == round(seconds / TIMESTEP)


def test_the_fingers_close_and_open() -> None:
    widths: list[float] = []

    def program(sensed: Sensed) -> Program:
        yield Grasp(force=20.0, width=0.03)
        widths.append(sensed.width())
        yield Release(width=0.05)
        widths.append(sensed.width())
        yield Release()
        widths.append(sensed.width())
        return None

    assert run_program(program).failure is None
    assert widths == pytest.approx([0.03, 0.05, 0.08], abs=1e-3)


def test_fingers_that_close_past_an_item_fail_at_once() -> None:
    missed: list[tuple[float, float]] = []
    failures: list[Failure] = []

    def program(sensed: Sensed) -> Program:
        def past() -> str | None:
            return None if sensed.width() > 0.06 else "nothing is there"

        around = Condition(name="around", cause=Cause.GRASP, against=past)
        try:
            yield Grasp(force=20.0, speed=0.02, during=(around,))
        except StepFailed as error:
            missed.append((sensed.time, sensed.width()))
            failures.append(error.failure)
        yield Release()
        assert sensed.width() == pytest.approx(0.08, abs=1e-3)
        return None

    assert run_program(program).failure is None
    ((time, width),), (failure,) = missed, failures
    assert (failure.cause, failure.step) == (Cause.GRASP, "grasp")
    assert time == pytest.approx(1.0, abs=0.1)
    assert width == pytest.approx(0.06, abs=1e-3)


def test_the_observers_are_told_of_a_step_that_failed() -> None:
    witness = Witness()

    def program(sensed: Sensed) -> Program:
        yield Move(waypoints=(up(sensed),), before=(Told(["no way"]).condition(),))
        return None

    carry_out(Written(writes=program), observers=[witness])
    assert witness.notes[0][1:] == ("step failed: up: no way", "ERROR")


def test_what_a_step_stands_for() -> None:
    waypoint = Waypoint(name="home", target=Place.HOME)
    for step in (waypoint, (waypoint,), Move(waypoints=(waypoint,))):
        action = as_step(step)
        assert isinstance(action, Move)
        assert action.waypoints == (waypoint,)
        assert action.name == "home"
    wait: StepLike = Wait(seconds=1.0)
    assert as_step(wait) is wait


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Move(waypoints=()), "waypoints of a move must be at least one waypoint"),
        (
            lambda: Guarded(waypoint=Waypoint(name="a", target=Place.HOME), force=1.0),
            "guarded motion must be LIN; found PTP",
        ),
        (
            lambda: Guarded(
                waypoint=Waypoint(name="a", target=Place.HOME, motion=Motion.LIN), force=0.0
            ),
            r"force must be above 0 and finite; found 0\.0",
        ),
        (lambda: Compliance(stiffness=np.full(6, -1.0)), "stiffness must be 0 or more and finite"),
        (lambda: Compliance(axis=np.array([0.0, 0.0, 2.0]), force=1.0), "axis must be of length 1"),
        (lambda: Compliance(axis=np.array([0.0, 0.6, 0.0]), force=1.0), "axis must be of length 1"),
        (lambda: Compliance(force=1.0), "force must be above 0 with an axis, or neither"),
        (
            lambda: Compliance(frame="hand"),  # type: ignore[arg-type]
            "frame must be 'world' or 'tool'",
        ),
        (lambda: Compliance(speed=np.nan), "speed must be 0 or more and finite"),
    ],
)
def test_steps_without_sense_are_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        make()


def test_every_cause_is_named_once() -> None:
    assert [cause.value for cause in Cause] == [
        *("ik", "plan", "track", "grasp", "slip", "drop", "place", "collision", "timeout", "limit"),
        "arm",
    ]


def test_a_move_does_not_wait_for_what_the_fingers_do_meanwhile() -> None:
    widths: list[float] = []

    def program(sensed: Sensed) -> Program:
        yield Move(waypoints=(up(sensed),), meanwhile=Grip(width=0.02, force=20.0))
        widths.append(sensed.width())
        return None

    run = run_program(program)
    assert run.failure is None
    assert names(run) == ["up", "end"]
    assert widths == pytest.approx([0.02], abs=1e-3)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Wait(seconds=np.nan), "seconds must be 0 or more and finite; found nan"),
        (lambda: Look(seconds=np.inf, lasts=0.0), "seconds must be 0 or more and finite"),
        (lambda: Grasp(force=-1.0), "force must be 0 or more"),
        (lambda: Release(width=np.nan), "width must be 0 or more"),
        (lambda: Wait(seconds=1.0, after=cast("Any", 3)), "after must be a sequence, each"),
        (lambda: Wait(seconds=1.0, until=cast("Any", 3)), "until must be a Condition or None"),
        (
            lambda: Press(axis=np.array([0.0, 0.0, -2.0]), force=1.0, felt=float),
            r"axis must be of length 1; found \[0.0, 0.0, -2.0\]",
        ),
    ],
)
def test_a_step_that_cannot_be_done_is_refused_as_it_is_made(
    make: Callable[[], object], told: str
) -> None:
    with pytest.raises(InvalidValueError, match=told):
        make()


def test_a_tool_that_is_not_there_is_told_to_the_program() -> None:
    told: list[str] = []

    def program(_: Sensed) -> Program:
        try:
            yield Grasp(force=10.0, tool="nope")
        except UnknownNameError as error:
            told.append(str(error))
        return None

    assert run_program(program).failure is None
    assert told == ["No tool is called 'nope'; known: tool."]


def test_a_step_of_the_same_name_that_gives_way_is_a_phase_of_its_own() -> None:
    def program(_: Sensed) -> Program:
        yield Grasp(force=10.0)
        yield Grasp(force=10.0, compliance=Compliance())
        yield Grasp(force=10.0, compliance=Compliance())
        return None

    run = run_program(program)
    told = [(phase.name, phase.compliant) for phase in run.phases]
    assert told[:2] == [("grasp", False), ("grasp", True)]
    assert [name for name, _ in told[2:]].count("grasp") == 0


@pytest.mark.parametrize("speed", [0.1, 0.02])
def test_a_slow_gripper_is_waited_for(speed: float) -> None:
    """At 20 mm/s it takes 4 s for its 80 mm."""
    robot = replace(PANDA, gripper=replace(GRIPPER, speed_max=speed))
    widths: list[float] = []

    def program(sensed: Sensed) -> Program:
        for step in (Grasp(force=20.0), Release()):
            yield step
            widths.append(sensed.width())
            assert sensed.grip_settled()
        return None

    task = Written(writes=program)
    runner = Runner(ClassicalStack().scenario(robot, task), Simulation(robot, task.build_scene))
    witness = Witness()
    assert runner.run(observers=[witness]).failure is None
    notes = [text for _, text, _ in witness.notes if "fingers" in text]
    assert len(notes) == 2
    assert not any("still moving" in text for text in notes)
    assert widths == pytest.approx([0.0, GRIPPER.width_max], abs=1e-3)
