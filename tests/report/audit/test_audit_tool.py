"""The audit of the tool's rates: against finite differences of its pose."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.paths.segments import PathProfile
from robo47_qp.motion.timing.rest_to_rest import Trapezoid
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.audit.finding import Finding
from robo47_qp.report.audit.tool import COMMANDED_EXCESS, MEASURED_EXCESS
from robo47_qp.run.recording import Rows
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.sim.simulation import Simulation
from tests.report.audit.test_audit import broken, finding, own_bounds, with_value
from tests.runs import Reach, make_runner, picked_and_placed

ARM = Arm(PANDA)
BOUNDS = PathProfile()


@pytest.fixture(scope="module")
def run() -> Run:
    return picked_and_placed()


def row_of(run: Run, name: str, after: int = 500) -> int:
    return next(phase.start for phase in run.phases if phase.name == name) + after


def rates_at(run: Run, row: int, kind: str) -> tuple[float, float]:
    """Speed and acceleration of the tool in a row, by differences of poses."""
    q, v, a = (run.rows[f"joints/{name}{kind}"][row] for name in "qva")
    h = 1e-3
    x = [ARM.pose(q + v * t + a * t**2 / 2).translation() for t in (-h, 0.0, h)]
    speed, acceleration = (x[2] - x[0]) / (2 * h), (x[2] - 2 * x[1] + x[0]) / h**2
    return float(np.linalg.norm(speed)), float(np.linalg.norm(acceleration))


def named(findings: Sequence[Finding], start: str) -> Finding:
    return next(found for found in findings if found.signal.startswith(start))


def test_the_largest_rates_of_the_reference_are_those_of_its_poses(run: Run) -> None:
    """Each promise tells the extreme over all LIN motions."""
    position = run.rows["tool/pose_ref"][:, :3]
    v = np.linalg.norm(np.gradient(position, TIMESTEP, axis=0), axis=1)
    a = np.linalg.norm(np.diff(position, 2, axis=0), axis=1) / TIMESTEP**2
    j = np.linalg.norm(np.diff(position, 3, axis=0), axis=1) / TIMESTEP**3
    straight = [p.name in ("descend", "lift", "lower", "retreat") for p in run.phases]
    rows = np.array(straight)[run.rows["phase"][:, 0].astype(int)]
    # Differences span up to three periods: none reaches into another motion.
    rows = rows[3:-3] & rows[:-6] & rows[6:]
    v, a, j = v[3:-3], a[3:][: len(rows)], j[3:][: len(rows)]
    findings = audit(run)
    for name, rate, near in (("speed", v, 1e-3), ("acceleration", a, 1e-3), ("jerk", j, 5e-3)):
        found = named(findings, f"reference tool {name}")
        assert found.extreme == pytest.approx(rate[rows].max(), rel=near)
        assert rate[round(found.time / TIMESTEP) - 3] == pytest.approx(found.extreme, rel=2e-2)
    assert named(findings, "measured tool speed").extreme == pytest.approx(v[rows].max(), rel=2e-3)


@pytest.mark.parametrize("name", ["descend", "lift", "lower", "retreat"])
@pytest.mark.parametrize(("title", "kind"), [("reference", "_ref"), ("measured", "")])
def test_a_tool_too_fast_is_told_with_its_motion(
    run: Run, name: str, title: str, kind: str
) -> None:
    row = row_of(run, name)
    fast = with_value(run, f"joints/v{kind}", row, 0, 0.9)
    found = finding(audit(fast), f"{title} tool speed ({name})")
    excess = MEASURED_EXCESS if title == "measured" else 0.0
    assert found.limit == pytest.approx(BOUNDS.linear[0] * (1.0 + excess))
    assert found.extreme == pytest.approx(rates_at(fast, row, kind)[0], rel=1e-6)
    assert found.time == pytest.approx(row * TIMESTEP)
    assert not found.ok
    other = "reference" if title == "measured" else "measured"
    assert not [told for told in broken(audit(fast)) if told.startswith(other)]


def test_a_tool_that_speeds_up_too_fast(run: Run) -> None:
    row = row_of(run, "lower")
    hasty = with_value(run, "joints/a_ref", row, 0, 2.5)
    found = finding(audit(hasty), "reference tool acceleration (lower)")
    assert found.extreme == pytest.approx(rates_at(hasty, row, "_ref")[1], rel=1e-4)
    assert (found.limit, found.unit, found.ok) == (0.75, "m/s²", False)


def test_a_jump_of_the_acceleration_is_too_much_jerk(run: Run) -> None:
    row = row_of(run, "lower")
    jump = float(run.rows["joints/a_ref"][row, 0]) + 0.02
    found = named(audit(with_value(run, "joints/a_ref", row, 0, jump)), "reference tool jerk")
    lever = np.linalg.norm(ARM.jacobian(run.rows["joints/q_ref"][row])[:3, 0])
    assert found.extreme == pytest.approx(20.0 * lever, rel=0.2)
    assert not found.ok


def test_a_turning_tool_is_held_to_its_turning(run: Run) -> None:
    row = row_of(run, "lift")
    # The last joint turns the tool about itself.
    turning = with_value(run, "joints/v_ref", row, 6, 1.2)
    found = finding(audit(turning), "reference tool turning speed (lift)")
    # The line does not turn: by how much the joint is too fast is how fast the tool turns.
    too_fast = 1.2 - float(run.rows["joints/v_ref"][row, 6])
    assert found.extreme == pytest.approx(too_fast, rel=1e-3)
    assert (found.limit, found.unit, found.ok) == (1.0, "rad/s", False)
    assert "reference tool speed (lift)" not in broken(audit(turning))
    found = finding(
        audit(with_value(run, "joints/v", row, 6, 1.2)), "measured tool turning speed (lift)"
    )
    assert (found.limit, found.ok) == (1.05, False)


@pytest.mark.parametrize("name", ["approach", "carry", "home", "close gripper", "end"])
def test_only_motions_of_the_tool_have_such_bounds(run: Run, name: str) -> None:
    row = row_of(run, name, 60)
    for kind in ("", "_ref"):
        assert own_bounds(audit(with_value(run, f"joints/v{kind}", row, 0, 0.9))) == []


def test_the_first_and_the_last_row_of_a_motion_count(run: Run) -> None:
    index = next(i for i, p in enumerate(run.phases) if p.name == "descend")
    first, after = run.phases[index].start, run.phases[index + 1].start
    for row, held in ((first - 1, False), (first, True), (after - 1, True), (after, False)):
        told = broken(audit(with_value(run, "joints/v", row, 0, 0.9)))
        assert told == (["measured tool speed (descend)"] if held else [])


def test_the_bounds_are_those_of_the_pace_of_the_motion(run: Run) -> None:
    phases = [
        phase
        if phase.leg is None
        else replace(phase, leg=replace(phase.leg, waypoint=replace(phase.leg.waypoint, pace=0.5)))
        for phase in run.phases
    ]
    findings = audit(replace(run, phases=phases))
    limits = [named(findings, f"reference tool {rate}").limit for rate in ("speed", "jerk")]
    assert limits == pytest.approx([0.125, 0.625])
    assert not named(findings, "reference tool speed").ok


@pytest.mark.parametrize(("excess", "ok"), [(0.9, True), (1.1, False)])
def test_the_slack_is_what_it_is_said_to_be(run: Run, excess: float, ok: bool) -> None:
    extreme = named(audit(run), "reference tool speed").extreme
    lin = run.scenario.planner.lin
    bound = extreme / (1.0 + excess * COMMANDED_EXCESS)
    tight = replace(lin, profile=PathProfile(linear=(bound, 0.75, 5.0)))
    planner = replace(run.scenario.planner, lin=tight)
    findings = audit(replace(run, scenario=replace(run.scenario, planner=planner)))
    assert named(findings, "reference tool speed").ok == ok


def test_a_law_without_bounded_jerk_promises_none_on_lines(run: Run) -> None:
    planner = replace(run.scenario.planner, law=Trapezoid())
    told = [f.signal for f in audit(replace(run, scenario=replace(run.scenario, planner=planner)))]
    assert not [name for name in told if name.startswith("reference tool") and "jerk" in name]
    assert [name for name in told if name.startswith("reference tool acceleration")]


def test_where_the_tool_yields_only_its_reference_is_held(run: Run) -> None:
    phases = [replace(phase, compliant=phase.name == "descend") for phase in run.phases]
    yielding = replace(run, phases=phases)
    row = row_of(run, "descend")
    for signal, column, value in (("tool/pose", 0, 9.0), ("joints/v", 0, 0.9)):
        assert broken(audit(with_value(run, signal, row, column, value))) != []
        assert broken(audit(with_value(yielding, signal, row, column, value))) == []
    for signal, column, value in (("tool/pose_ref", 0, 9.0), ("joints/v_ref", 0, 0.9)):
        assert broken(audit(with_value(yielding, signal, row, column, value))) != []
    # Other motions of the run stay firm.
    assert broken(audit(with_value(yielding, "tool/pose", row_of(run, "lift"), 0, 9.0))) != []


def test_a_line_at_full_speed_keeps_its_promise() -> None:
    """The bounds of the tool are what limits this motion."""
    slow = make_runner(Reach())[0].scenario
    brisk = MotionProfile.uniform(ARM.n, v=2.0, a=6.0, j=60.0)
    planner = replace(slow.planner, profile=brisk)
    scenario = replace(slow, planner=planner, task=Reach(rise=0.15))
    findings = audit(Runner(scenario, Simulation(PANDA, scenario.task.build_scene)).run())
    assert broken(findings) == []
    use = [
        named(findings, f"reference tool {rate}").extreme / bound
        for rate, bound in zip(("speed", "acceleration", "jerk"), BOUNDS.linear, strict=True)
    ]
    assert max(use) > 0.99


def test_rows_are_left_as_they_are(run: Run) -> None:
    before = Rows(run.rows.signals, run.rows.values.copy())
    audit(run)
    np.testing.assert_array_equal(before.values, run.rows.values)


def test_what_uses_most_of_its_own_bound_is_told(run: Run) -> None:
    """A slow motion at its faster pace, among others that are faster still and may be."""
    phases = []
    for phase in run.phases:
        leg = phase.leg
        if leg is not None and phase.name == "lower":
            leg = replace(leg, waypoint=replace(leg.waypoint, pace=0.5))
        phases.append(replace(phase, leg=leg))
    findings = audit(replace(run, phases=phases))
    found = finding(findings, "reference tool speed (lower)")
    assert (found.limit, found.ok) == (0.125, False)
    assert found.extreme < named(audit(run), "reference tool speed").extreme
