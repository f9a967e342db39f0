"""Following a target that moves: within the limits, to rest after it, and failures in time."""

from collections.abc import Callable

import numpy as np
import pytest
from mink import SE3

from robo47_qp.constants import TIMESTEP
from robo47_qp.run.failure import Cause, Condition
from robo47_qp.run.follow_step import Follow
from robo47_qp.run.steps import Wait
from robo47_qp.run.task import Program
from robo47_qp.sim.sensed import Sensed
from tests.examples import shifted
from tests.run.written import Told, names, run_program


def circling(sensed: Sensed) -> Callable[[float], SE3]:
    """A target on a circle of 5 cm at 0.1 m/s that starts at the tool, from rest."""
    start, begun = sensed.tool_pose(), sensed.time

    def target(time: float) -> SE3:
        t = time - begun
        angle = 2.0 * (t - 0.5 * (1 - np.exp(-2 * t)))
        return shifted(start, 0.05 * np.array([0.0, np.sin(angle), 1 - np.cos(angle)]))

    return target


def at_time(sensed: Sensed, time: float) -> Condition:
    return Condition(
        name=f"{time} s are over",
        cause=Cause.TIMEOUT,
        against=lambda: None if sensed.time >= time else f"only {sensed.time:.2f} s",
    )


def test_a_moving_target_is_followed_and_the_arm_comes_to_rest_after_it() -> None:
    def program(sensed: Sensed) -> Program:
        target = circling(sensed)
        yield Follow(target=target, until=at_time(sensed, 1.0), seconds=2.0)
        yield Follow(target=target, until=at_time(sensed, 2.0), seconds=2.0, name="on")
        yield Wait(seconds=0.1)
        return None

    run = run_program(program)
    assert run.failure is None
    assert names(run) == ["follow", "on", "stop", "wait", "end"]
    assert [phase.streamed for phase in run.phases] == [True, True, False, False, False]
    rows, stop = run.rows, run.phases[2].start
    time = rows["time"][:stop, 0]
    angle = 2.0 * (time - 0.5 * (1 - np.exp(-2 * time)))
    path = rows["tool/pose"][0, :3] + 0.05 * np.column_stack(
        [0 * angle, np.sin(angle), 1 - np.cos(angle)]
    )
    off = np.linalg.norm(rows["tool/pose"][:stop, :3] - path, axis=1)
    assert off.max() < 0.5e-3
    # From step to step and into the stop nothing jumps.
    v, a = rows["joints/v_ref"], rows["joints/a_ref"]
    q = rows["joints/q_ref"]
    np.testing.assert_allclose(np.diff(q, axis=0), TIMESTEP * 0.5 * (v[1:] + v[:-1]), atol=2e-6)
    profile = run.scenario.planner.profile
    assert (np.abs(v) <= profile.v_max * (1 + 1e-9)).all()
    assert (np.abs(a) <= profile.a_max * (1 + 1e-9)).all()
    assert not v[-1].any()


def test_a_target_that_leaps_is_followed_without_a_leap_of_the_acceleration() -> None:
    """The torque would leap with it, faster than motors can."""

    def program(sensed: Sensed) -> Program:
        aside = shifted(sensed.tool_pose(), np.array([0.0, 0.15, 0.0]))
        yield Follow(target=lambda _: aside, until=at_time(sensed, 1.0), seconds=2.0)
        return None

    run = run_program(program)
    a = run.rows["joints/a_ref"][: run.phases[1].start]
    a_max = run.scenario.planner.profile.a_max
    # It goes to its bounds, but within the 20 ticks of the mean.
    assert (np.abs(a).max(axis=0) / a_max).max() > 0.9
    assert (np.abs(np.diff(a, axis=0)) <= 2.0 * a_max / 20.0 + 1e-9).all()


def test_following_in_vain_fails_in_time() -> None:
    def program(sensed: Sensed) -> Program:
        never = Told(["not there"], cause=Cause.TIMEOUT).condition()
        yield Follow(target=circling(sensed), until=never, seconds=0.2, name="chase")
        return None

    run = run_program(program)
    assert run.failure is not None
    assert (run.failure.cause, run.failure.step) == (Cause.TIMEOUT, "chase")
    assert run.failure.time == pytest.approx(0.2, abs=0.021)
    assert names(run) == ["chase", "stop", "end"]


def test_following_ends_at_once_where_something_does_not_hold_meanwhile() -> None:
    def program(sensed: Sensed) -> Program:
        lost = Condition(
            name="nothing is lost",
            cause=Cause.DROP,
            against=lambda: "it is" if sensed.time >= 0.3 else None,
        )
        done = at_time(sensed, 1.0)
        yield Follow(target=circling(sensed), until=done, seconds=2.0, during=(lost,))
        return None

    run = run_program(program)
    assert run.failure is not None
    assert (run.failure.cause, run.failure.condition) == (Cause.DROP, "nothing is lost")
    assert run.failure.time == pytest.approx(0.3, abs=0.021)
    assert names(run) == ["follow", "stop", "end"]


def test_no_target_brakes_the_arm() -> None:
    def program(sensed: Sensed) -> Program:
        target = circling(sensed)
        yield Follow(target=target, until=at_time(sensed, 1.0), seconds=2.0)
        yield Follow(target=lambda _: None, until=at_time(sensed, 1.5), seconds=2.0)
        return None

    run = run_program(program)
    assert np.abs(run.rows["joints/v_ref"][1480]).max() < 1e-6
