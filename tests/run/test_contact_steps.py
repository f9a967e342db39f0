"""Guarded and compliant steps: they stop at contact, press as asked, and end as promised."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from mink import SE3

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.model.payload import Payload
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import Place, Waypoint
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.compliance import Compliance
from robo47_qp.run.contact_steps import Comply, Guarded
from robo47_qp.run.failure import Cause, Condition, StepFailed
from robo47_qp.run.scenario import Run
from robo47_qp.run.task import Program
from robo47_qp.sim.sensed import Sensed
from tests.run.bench import DOWN, PLATE, line, rows_of, run_program, touched


def pressing(**changes: object) -> Compliance:
    settings = {"stiffness": np.array([1500.0] * 3 + [60.0] * 3), "axis": DOWN, "force": 8.0}
    return Compliance(**(settings | changes))  # type: ignore[arg-type]


@cache
def guarded(force: float = 2.0, speed: float = 0.02) -> Run:
    def program(sensed: Sensed) -> Program:
        yield Guarded(waypoint=line(sensed, [0, 0, -0.08]), force=force, speed=speed)
        return None

    return run_program(program)


def test_a_guarded_motion_stops_where_it_touches() -> None:
    run = guarded()
    assert run.failure is None
    force, z = run.rows["contact/tool"][:, 2], run.rows["tool/pose"][:, 2]
    touch = int(np.argmax(force > 0.0))
    assert z[0] - z[touch] == pytest.approx(PLATE, abs=1e-4)
    # At 20 mm/s, from the first contact to rest: 2 mm at most, and less than 8 N more.
    assert 0.0 < z[touch] - z.min() < 2e-3
    assert 2.0 <= force.max() < 10.0
    assert np.abs(run.rows["joints/v"][-1]).max() < 5e-3
    assert [finding.signal for finding in audit(run) if not finding.ok] == []


def test_a_guarded_motion_that_has_stopped_where_it_should_not_presses_no_more() -> None:
    pressed: list[float] = []

    def program(sensed: Sensed) -> Program:
        short = Condition(name="far enough", cause=Cause.GRASP, against=lambda: "too early")
        down = line(sensed, [0, 0, -0.08])
        for after in ((), (short,)):
            try:
                yield Guarded(waypoint=down, force=5.0, speed=0.05, missing=None, after=after)
            except StepFailed:
                pressed.append(float(sensed.felt_force()[2]))
                yield line(sensed, [0, 0, 0.05], "back off")
            else:
                pressed.append(float(sensed.felt_force()[2]))
                yield line(sensed, [0, 0, PLATE], "up")
        return None

    run = run_program(program)
    assert run.failure is None
    stays, eased = pressed
    assert eased < 0.5 * stays

    def strained(name: str) -> float:
        """How far joints are from where they are to be when a motion starts [rad]."""
        q_ref, q = (rows_of(run, name, f"joints/{signal}")[0] for signal in ("q_ref", "q"))
        return float(np.abs(q_ref - q).max())

    assert strained("back off") < 0.5 * strained("up")


def test_a_guarded_motion_keeps_its_speed() -> None:
    steps = np.diff(rows_of(guarded(speed=0.01), "line", "tool/pose_ref")[:, 2]) / 1e-3
    assert 0.008 < -steps.min() <= 0.01 + 1e-6


@pytest.mark.parametrize("missing", [Cause.TIMEOUT, Cause.PLACE, None])
def test_where_nothing_is_touched_it_fails_as_asked(missing: Cause | None) -> None:
    def program(sensed: Sensed) -> Program:
        yield Guarded(waypoint=line(sensed, [0, 0, -0.02]), force=2.0, speed=0.1, missing=missing)
        return None

    run = run_program(program)
    if missing is None:
        assert run.failure is None
        return
    assert run.failure is not None
    assert (run.failure.cause, run.failure.step) == (missing, "line")
    assert "nothing was touched on the way; 2.0 N were expected" in run.failure.evidence


@cache
def pressed() -> tuple[Run, dict[str, float]]:
    """Down on the plate, pressed, slid aside and lifted."""
    seen: dict[str, float] = {"looks": 0.0}

    def look() -> None:
        seen["looks"] += 1.0

    def program(sensed: Sensed) -> Program:
        press = pressing()
        waiting = Comply(
            waypoints=(), compliance=press, seconds=3.0, until=touched(sensed, 4.0), stay=True
        )
        yield replace(waiting, name="down")
        seen["down"] = sensed.time
        yield Comply(waypoints=(), compliance=press, seconds=2.0, stay=True, name="steady")
        yield Comply(
            waypoints=(line(sensed, [0.0, 0.06, 0.0], "slide"),),
            compliance=press,
            speed=0.03,
            renew=True,
            observe=look,
        )
        seen["slid"] = sensed.time
        up = line(sensed, [0.0, 0.0, 0.03], "up")
        yield Comply(waypoints=(up,), compliance=Compliance())
        yield Waypoint(name="home", target=Place.HOME)
        return None

    return run_program(program), seen


def test_it_comes_down_at_the_speed_and_presses_with_the_force() -> None:
    run, _ = pressed()
    assert run.failure is None
    speed = -np.diff(rows_of(run, "down", "tool/pose")[:, 2]) / 1e-3
    assert 0.08 < speed.max() < 0.101
    force = rows_of(run, "steady", "contact/tool")[:, 2]
    assert force.max() < 3 * 8.0
    np.testing.assert_allclose(force[-200:], 8.0, rtol=0.02)


def test_it_holds_the_force_while_it_slides() -> None:
    run, seen = pressed()
    force = rows_of(run, "slide", "contact/tool")[:, 2]
    np.testing.assert_allclose(force, 8.0, rtol=0.05)
    y = rows_of(run, "slide", "tool/pose")[:, 1]
    assert y[-1] - y[0] == pytest.approx(0.06, abs=2e-3)
    assert (np.diff(y) / 1e-3).max() < 0.04
    # Looked at every other period.
    assert seen["looks"] == pytest.approx(len(force) / 2, abs=2)


def test_it_ends_at_once_when_what_was_waited_for_has_come_about() -> None:
    run, seen = pressed()
    force = rows_of(run, "down", "contact/tool")[:, 2]
    assert (force[:-4] < 4.0).all()
    assert len(force) < 1000
    assert seen["down"] < 1.0


def test_the_torque_goes_over_smoothly_from_step_to_step() -> None:
    run, _ = pressed()
    assert [finding.signal for finding in audit(run) if not finding.ok] == []
    ends = {phase.start for phase in run.phases[1:]}
    jumps = np.abs(np.diff(run.rows["joints/tau_command"], axis=0)).max(axis=1)
    assert max(jumps[start - 1] for start in ends) < 0.5


def test_an_arm_that_was_left_yielding_is_stiff_at_the_next_step_and_at_the_end() -> None:
    def program(sensed: Sensed) -> Program:
        yield Comply(waypoints=(), compliance=Compliance(), seconds=0.1, stay=True)
        yield line(sensed, [0.0, 0.0, 0.02], "stiff")
        yield Comply(waypoints=(), compliance=Compliance(), seconds=0.1, stay=True)
        return None

    run = run_program(program)
    assert run.failure is None
    yields = {phase.name: phase.compliant for phase in run.phases}
    assert yields == {"comply": True, "stiff": False, "end": False}
    assert np.abs(rows_of(run, "stiff", "errors/q")).max() < 1e-3


def test_springs_give_way_to_what_is_in_the_way() -> None:
    def program(sensed: Sensed) -> Program:
        soft = Compliance(stiffness=np.array([400.0] * 3 + [40.0] * 3))
        down = line(sensed, [0.0, 0.0, -PLATE - 0.02], "down")
        yield Comply(waypoints=(down,), compliance=soft, speed=0.05, seconds=0.5, stay=True)
        return None

    force = rows_of(run_program(program), "comply", "contact/tool")[-1, 2]
    # 20 mm less what the plate gives: 400 N/m in series with a plate that is far stiffer.
    assert 5.0 < force < 8.0


def test_springs_that_lose_their_load_do_it_without_a_jump_of_the_torque() -> None:
    """Both where they begin anew where the arm is, and where the arm is stiff again."""
    soft = Compliance(stiffness=np.array([400.0] * 3 + [40.0] * 3))

    def loaded(sensed: Sensed, name: str, by: float) -> Comply:
        down = line(sensed, [0.0, 0.0, by], name)
        return Comply(
            waypoints=(down,), compliance=soft, speed=0.05, seconds=0.3, stay=True, renew=True
        )

    def program(sensed: Sensed) -> Program:
        yield loaded(sensed, "down", -PLATE - 0.02)
        # The load of the springs is gone once, and built up again.
        yield replace(loaded(sensed, "again", -0.02), name="still")
        yield line(sensed, [0.0, 0.0, 0.02], "stiff")
        return None

    run = run_program(program)
    assert run.failure is None
    arm = Arm(PANDA)
    tau, q, force = (run.rows[f"{x}"] for x in ("joints/tau_command", "joints/q", "contact/tool"))
    for name in ("again", "stiff"):
        start = next(phase.start for phase in run.phases if phase.name == name)
        lever = arm.jacobian(q[start])[:3].T @ arm.pose(q[start]).rotation().as_matrix().T
        load = lever @ force[start]
        assert np.abs(load).max() > 2.0
        assert np.abs(np.diff(tau[start - 3 : start + 3], axis=0)).max() < 0.1


def test_what_the_tool_is_told_to_hold_is_held_up() -> None:
    """Nothing is there: so the springs are pulled up by the weight."""
    load = Payload(mass=0.5, inertia=(1e-4,) * 3, T_tcp_com=SE3.identity())

    def program(sensed: Sensed) -> Program:
        springs = Compliance()
        yield Comply(waypoints=(), compliance=springs, carried=load, seconds=0.8, stay=True)
        yield Comply(waypoints=(), compliance=springs, seconds=0.1)
        return None

    z = rows_of(run_program(program), "comply", "tool/pose")[:, 2]
    assert z[-1] - z[0] == pytest.approx(0.5 * 9.81 / 800.0, rel=0.02)


def test_what_breaks_on_the_way_stops_the_arm_and_is_told() -> None:
    caught: list[StepFailed] = []

    def program(sensed: Sensed) -> Program:
        start = sensed.time
        late = Condition(
            name="early",
            cause=Cause.DROP,
            against=lambda: "0.2 s are over" if sensed.time - start > 0.2 else None,
        )
        try:
            yield Comply(
                waypoints=(line(sensed, [0.0, 0.1, 0.0]),),
                compliance=Compliance(),
                during=(late,),
                stay=True,
            )
        except StepFailed as error:
            caught.append(error)
        yield line(sensed, [0.0, 0.0, 0.01], "stiff")
        return None

    run = run_program(program)
    assert run.failure is None
    assert caught[0].failure.cause is Cause.DROP
    assert caught[0].failure.condition == "early"
    assert len(rows_of(run, "line", "time")) == pytest.approx(202, abs=2)
    assert not next(phase for phase in run.phases if phase.name == "stiff").compliant


def test_what_does_not_come_about_fails_with_its_cause() -> None:
    def program(sensed: Sensed) -> Program:
        yield Comply(
            waypoints=(),
            compliance=Compliance(),
            seconds=0.2,
            until=touched(sensed, 4.0, Cause.PLACE),
        )
        return None

    failure = run_program(program).failure
    assert failure is not None
    assert (failure.cause, failure.evidence, failure.step) == (Cause.PLACE, "0.0 N", "comply")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speed": 0.0}, r"speed must be above 0; found 0\.0"),
        ({"seconds": -1.0}, r"seconds must be 0 or more and finite; found -1\.0"),
        (
            {"seconds": 0.0},
            r"comply must be waypoints, or a time to stay; found no waypoint and 0 s",
        ),
        (
            {"waypoints": (Waypoint(name="a", target=Place.HOME),)},
            r"compliant motion must be waypoints reached by LIN or CIRC; found \['a'\]",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(change: dict[str, object], message: str) -> None:
    good = Comply(waypoints=(), compliance=Compliance(), seconds=1.0)
    with pytest.raises(InvalidValueError, match=message):
        replace(good, **change)  # type: ignore[arg-type]
