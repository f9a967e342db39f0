"""Pressing with a stiff tool: evenly, though links are heavier and joints rub."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import Place, Waypoint
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.contact_steps import Press
from robo47_qp.run.failure import Cause
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.task import Program
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.sensed import Sensed
from robo47_qp.stack import ClassicalStack
from tests.run.bench import DOWN, Bench, line, rows_of, run_program, touched


def press(sensed: Sensed, **changes: object) -> Press:
    settings = {
        "axis": DOWN,
        "force": 8.0,
        "felt": lambda: float(sensed.felt_force()[2]),
        "name": "press",
    }
    return Press(**(settings | changes))  # type: ignore[arg-type]


@cache
def slid(*, friction: float = 0.0) -> Run:
    """Presses on the plate, slides over it and leaves it, with an arm whose joints rub."""

    def program(sensed: Sensed) -> Program:
        yield press(sensed, seconds=3.0)
        way = (line(sensed, [0.0, 0.06, 0.0], "to"), line(sensed, [0.0, 0.0, 0.0], "fro"))
        yield press(sensed, waypoints=way, speed=0.03)
        yield press(sensed, waypoints=(line(sensed, [0, 0, 0.04], "off"),), force=0.0)
        return None

    bench = Bench(writes=program)
    scenario = ClassicalStack().scenario(PANDA, bench, None)
    world = Disturbance(link_mass_factor=1.05, dry_friction=friction)
    return Runner(scenario, DisturbedSimulation(PANDA, bench.build_scene, world)).run()


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_stiff_tool_presses_evenly_though_links_are_heavier_and_joints_rub(
    friction: float,
) -> None:
    run = slid(friction=friction)
    assert run.failure is None
    force = rows_of(run, "press", "contact/tool")[:, 2]
    # The plate takes 4 N/mm: dry friction lets the tool stick and slip by 0.1 mm.
    assert np.abs(force[-500:] - 8.0).max() < (0.6 if friction else 0.1)
    sliding = np.concatenate([rows_of(run, name, "contact/tool")[:, 2] for name in ("to", "fro")])
    assert np.abs(sliding - 8.0).max() < 2.0
    assert np.sqrt(np.mean((sliding - 8.0) ** 2)) < 0.25
    # An arm that yields would be 0.4 mm aside and 1.1 mm above what it refers to.
    at, ref = (
        np.concatenate([rows_of(run, name, f"tool/{pose}")[:, :3] for name in ("to", "fro")])
        for pose in ("pose", "pose_ref")
    )
    assert np.sqrt(np.mean((at - ref) ** 2, axis=0)).max() < 0.15e-3
    assert rows_of(run, "off", "contact/tool")[-1, 2] == 0.0
    assert [finding.signal for finding in audit(run) if not finding.ok] == []


def test_it_comes_down_at_force_over_damping() -> None:
    z = rows_of(slid(), "press", "tool/pose")[:, 2]
    assert 0.03 < -np.diff(z).min() / 1e-3 < 8.0 / 200.0 * 1.05


def pushed(*, insists: Callable[[], bool] | None) -> Run:
    """Presses on the plate, and then goes 2 mm into it, whatever that takes."""

    def program(sensed: Sensed) -> Program:
        yield press(sensed, seconds=2.0)
        way = (line(sensed, [0.0, 0.0, -2e-3], "into"),)
        deep = press(sensed, waypoints=way, force=0.0, seconds=2.0, name="stay")
        yield replace(deep, insists=insists)
        return None

    return run_program(program)


def test_an_arm_that_does_not_insist_loads_itself_no_further() -> None:
    """Than its springs do, on a plate on which it presses with 8 N before."""
    runs = pushed(insists=None), pushed(insists=lambda: True), pushed(insists=lambda: False)
    plain, insisting, held = (rows_of(run, "stay", "contact/tool")[:, 2] for run in runs)
    np.testing.assert_array_equal(insisting, plain)
    off = np.abs(rows_of(runs[0], "stay", "errors/tool_position")[-500:])
    assert off.max() < 0.05e-3
    assert 12.0 < held.max() < 0.55 * plain[-1]
    # Nor does it creep.
    assert np.ptp(held[-500:]) < 0.05


def along(pace: Callable[[float], float] | None, speed: float = 0.03) -> Run:
    """Presses on the plate and slides over it, at a pace over the time since that began."""

    def program(sensed: Sensed) -> Program:
        yield press(sensed, seconds=2.0)
        to, start = line(sensed, [0.0, 0.06, 0.0], "to"), sensed.time
        paced = None if pace is None else lambda: pace(sensed.time - start)
        # The second way has no length.
        yield press(sensed, waypoints=(to, replace(to, name="there")), speed=speed, pace=paced)
        return None

    return run_program(program)


def test_at_full_pace_it_goes_as_without_one() -> None:
    runs = along(None), along(lambda _: 1.0)
    plain, paced = (rows_of(run, "to", "joints/q_ref") for run in runs)
    assert 0 <= len(paced) - len(plain) <= 10
    np.testing.assert_allclose(paced[: len(plain)], plain, atol=1e-9)
    y = rows_of(runs[1], "to", "tool/pose_ref")[len(plain) - 1 :, 1]
    # But for what brings it back to the path.
    np.testing.assert_allclose(y, y[0], atol=1e-7)


def test_a_path_waits_and_goes_on_smoothly_while_it_is_pressed_on() -> None:
    """Half a second each of waiting and of a third of the speed; v and a integrate to q and v."""
    paces = ((0.5, 1.0, 0.0), (1.0, 1.5, 1.0 / 3.0))
    run = along(lambda time: next((pace for a, b, pace in paces if a <= time < b), 1.0))
    y = rows_of(run, "to", "tool/pose_ref")[:, 1]
    speed = np.gradient(y) / 1e-3
    assert np.abs(speed[600:1000]).max() < 1e-3
    np.testing.assert_allclose(speed[1150:1450], 0.01, atol=1e-3)
    np.testing.assert_allclose(speed[1650:1800], 0.03, atol=1e-3)
    late = len(y) - len(rows_of(along(None), "to", "tool/pose_ref"))
    assert 500 + 333 - 20 <= late <= 500 + 333 + 20
    assert np.abs(rows_of(run, "to", "contact/tool")[:, 2] - 8.0).max() < 2.0
    q, v, a = (rows_of(run, "to", f"joints/{name}_ref") for name in "qva")
    for x, dx in ((q, v), (v, a)):
        gone = np.cumsum(0.5e-3 * (dx[1:] + dx[:-1]), axis=0)
        np.testing.assert_allclose(x[1:] - x[0], gone, atol=1e-4)
    assert np.abs(np.diff(a, axis=0)).max() < 0.6
    assert [finding.signal for finding in audit(run) if not finding.ok] == []


def test_a_fast_path_waits_within_the_accelerations_of_the_joints() -> None:
    run = along(lambda time: float(not 0.35 <= time < 0.9), speed=0.15)
    speed = np.gradient(rows_of(run, "to", "tool/pose_ref")[:, 1]) / 1e-3
    assert speed[:350].max() > 0.12
    assert np.abs(speed[820:890]).max() < 2e-3
    told = [finding.signal for finding in audit(run) if not finding.ok]
    assert not [name for name in told if name.startswith("reference")]


@pytest.mark.parametrize("needed", [True, False])
def test_a_press_that_never_touches_fails_with_its_cause_if_it_has_to(needed: bool) -> None:
    def program(sensed: Sensed) -> Program:
        yield press(sensed, seconds=0.5, until=touched(sensed, 4.0), needed=needed)
        return None

    run = run_program(program)
    assert len(rows_of(run, "press", "joints/q")) == 500
    if not needed:
        assert run.failure is None
        return
    assert run.failure is not None
    assert (run.failure.cause, run.failure.step) == (Cause.TIMEOUT, "press")


def test_what_must_hold_meanwhile_is_needed_in_any_case() -> None:
    def program(sensed: Sensed) -> Program:
        lost = touched(sensed, 4.0, Cause.DROP)
        yield press(sensed, seconds=0.5, until=lost, during=(lost,), needed=False)
        return None

    run = run_program(program)
    assert run.failure is not None
    assert run.failure.cause is Cause.DROP


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": 0.0, "seconds": 1.0}, "mass must be above 0"),
        ({"force": -1.0, "seconds": 1.0}, "force must be"),
        ({}, "waypoints, or a time to stay"),
        ({"waypoints": (Waypoint(name="away", target=Place.HOME),)}, "waypoints reached by"),
    ],
)
def test_a_press_that_makes_no_sense_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        Press(**({"axis": DOWN, "force": 1.0, "felt": lambda: 0.0} | change))  # type: ignore[arg-type]
