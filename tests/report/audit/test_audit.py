"""The audit: one wrong number in the rows, and exactly the right promise is broken."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import Motion
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.audit.finding import Finding
from robo47_qp.run.recording import Rows
from robo47_qp.run.scenario import Run
from tests.runs import Reach, carry_out, picked_and_placed

Q_MIN, Q_MAX = Arm(PANDA).q_min, Arm(PANDA).q_max
ROW = 700
APART = [
    f"{what}{of}" for of in ("", ", scene") for what in ("reference distance", "measured clearance")
]
TOUCHED = ("tool contact", "tool contact with what is fixed", "link contact")
PROMISES = [
    "reference q lower",
    "reference q upper",
    "reference v",
    "reference a",
    "reference jerk",
    "measured q lower",
    "measured q upper",
    "measured v",
    "measured a",
    "torque",
    "torque rate",
    "reference q to v",
    "reference v to a",
    "LIN commanded",
    "LIN measured",
    "reference tool speed",
    "reference tool acceleration",
    "reference tool jerk",
    "reference tool turning speed",
    "reference tool turning acceleration",
    "reference tool turning jerk",
    "measured tool speed",
    "measured tool turning speed",
    *APART,
    *TOUCHED,
    "object jump",
    "object turn",
    "object kick",
    "object spin",
]
OF_JOINTS = PROMISES[:13]


@pytest.fixture(scope="module")
def run() -> Run:
    return picked_and_placed()


def with_value(run: Run, signal: str, row: int, column: int, value: float) -> Run:
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows[signal][row, column] = value
    return replace(run, rows=rows)


def broken(findings: Sequence[Finding]) -> list[str]:
    return [finding.signal for finding in findings if not finding.ok]


def own_bounds(findings: Sequence[Finding]) -> list[str]:
    """What is broken but for that q, v and a of the reference belong together."""
    return [name for name in broken(findings) if " to " not in name.split(" (")[0]]


def finding(findings: Sequence[Finding], signal: str) -> Finding:
    return next(found for found in findings if found.signal == signal)


def test_an_untouched_run_keeps_all_promises(run: Run) -> None:
    findings = audit(run)
    assert broken(findings) == []
    assert [found.signal.split(" (")[0] for found in findings] == PROMISES


@pytest.mark.parametrize("joint", [0, 3, 6])
@pytest.mark.parametrize(("side", "sign"), [("lower", -1), ("upper", 1)])
@pytest.mark.parametrize(("signal", "title"), [("q_ref", "reference"), ("q", "measured")])
def test_a_joint_beyond_its_range(
    run: Run, joint: int, side: str, sign: int, signal: str, title: str
) -> None:
    limit = float((Q_MIN if sign < 0 else Q_MAX)[joint])
    value = limit + sign * 1e-6
    findings = audit(with_value(run, f"joints/{signal}", ROW, joint, value))
    name = f"{title} q {side} (joint{joint + 1})"
    apart = [f"reference q to v (joint{joint + 1})"] if signal == "q_ref" else []
    assert broken(findings) == [name, *apart]
    found = finding(findings, name)
    assert (found.limit, found.extreme, found.unit) == (limit, value, "rad")
    assert found.time == pytest.approx(ROW * TIMESTEP)


def test_a_joint_at_its_limit_is_within(run: Run) -> None:
    findings = audit(with_value(run, "joints/q", ROW, 0, float(Q_MAX[0])))
    assert broken(findings) == []
    assert finding(findings, "measured q upper (joint1)").extreme == Q_MAX[0]


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("joint", [0, 5])
@pytest.mark.parametrize(
    ("signal", "title", "unit", "limits"),
    [
        ("v_ref", "reference v", "rad/s", PANDA.profile.v_max),
        ("v", "measured v", "rad/s", PANDA.rated.v_max),
    ],
)
def test_a_speed_beyond_its_limit(
    run: Run, sign: int, joint: int, signal: str, title: str, unit: str, limits: Sequence[float]
) -> None:
    limit = float(limits[joint])
    value = sign * limit * (1 + 1e-6)
    findings = audit(with_value(run, f"joints/{signal}", ROW, joint, value))
    name = f"{title} (joint{joint + 1})"
    assert own_bounds(findings) == [name]
    found = finding(findings, name)
    assert (found.limit, found.extreme, found.unit) == (limit, abs(value), unit)
    assert found.time == pytest.approx(ROW * TIMESTEP)
    # A touch below the limit is a promise kept.
    findings = audit(with_value(run, f"joints/{signal}", ROW, joint, value * (1 - 1e-5)))
    assert own_bounds(findings) == []


def test_an_acceleration_beyond_its_limit_is_a_jump_too(run: Run) -> None:
    findings = audit(with_value(run, "joints/a_ref", ROW, 2, 3.1))
    assert own_bounds(findings) == ["reference a (joint3)", "reference jerk (joint3)"]
    found = finding(findings, "reference a (joint3)")
    assert (found.limit, found.extreme, found.unit) == (3.0, 3.1, "rad/s²")
    assert found.time == pytest.approx(ROW * TIMESTEP)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_small_jump_of_the_acceleration_is_too_much_jerk(run: Run, sign: int) -> None:
    last = run.phases[-1].start + 100
    findings = audit(with_value(run, "joints/a_ref", last, 4, sign * 0.011))
    assert broken(findings) == ["reference jerk (joint5)"]
    found = finding(findings, "reference jerk (joint5)")
    assert (found.limit, found.unit) == (10.0, "rad/s³")
    assert found.extreme == pytest.approx(11.0)
    assert found.time == pytest.approx((last - 1) * TIMESTEP)


@pytest.mark.parametrize("joint", [1, 4])
def test_a_torque_beyond_its_limit(run: Run, joint: int) -> None:
    # The rise takes place over many rows, so that the rate is kept.
    rows = Rows(run.rows.signals, run.rows.values.copy())
    limit = float(PANDA.tau_max[joint])
    column = rows["joints/tau_command"][:, joint]
    rise = np.linspace(0.0, -1.01 * limit - float(column[ROW + 400]), 401)
    column[ROW : ROW + 801] += np.concatenate([rise, rise[-2::-1]])
    findings = audit(replace(run, rows=rows))
    name = f"torque (joint{joint + 1})"
    assert broken(findings) == [name]
    found = finding(findings, name)
    assert (found.limit, found.unit) == (limit, "N·m")
    assert found.extreme == -float(column.min())
    assert found.time == pytest.approx(int(column.argmin()) * TIMESTEP)


def test_a_jump_of_the_torque(run: Run) -> None:
    last = run.phases[-1].start + 100
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows["joints/tau_command"][last:, 5] += 1.01
    findings = audit(replace(run, rows=rows))
    assert broken(findings) == ["torque rate (joint6)"]
    found = finding(findings, "torque rate (joint6)")
    assert (found.limit, found.unit) == (1000.0, "N·m/s")
    assert found.extreme == pytest.approx(1010.0, rel=1e-3)
    assert found.time == pytest.approx((last - 1) * TIMESTEP)


@pytest.mark.parametrize(
    ("signal", "title", "limit"),
    [
        ("tool/pose_ref", "LIN commanded", 10e-6),
        ("tool/pose", "LIN measured", 0.3e-3),
    ],
)
@pytest.mark.parametrize("phase", ["descend", "lift", "lower", "retreat"])
def test_a_tool_off_its_line(run: Run, signal: str, title: str, limit: float, phase: str) -> None:
    start = next(p.start for p in run.phases if p.name == phase)
    row = start + 600
    line = next(leg for leg in run.legs if leg.waypoint.name == phase)
    along = line.T_world_goal.translation() - line.T_world_start.translation()
    assert abs(along[2]) > 0.99 * np.linalg.norm(along)
    value = float(run.rows[signal][row, 0]) + 1.5 * limit
    findings = audit(with_value(run, signal, row, 0, value))
    assert broken(findings) == [f"{title} (tool)"]
    found = finding(findings, f"{title} (tool)")
    assert (found.limit, found.unit) == (limit, "m")
    assert found.extreme == pytest.approx(1.5 * limit, rel=0.1)
    assert found.time == pytest.approx(row * TIMESTEP)
    # Along the line it may be anywhere between start and goal.
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows[signal][row, :3] += 5e-3 * along / np.linalg.norm(along)
    assert broken(audit(replace(run, rows=rows))) == []


@pytest.mark.parametrize("phase", ["approach", "close gripper", "carry", "home", "end"])
def test_only_lin_motions_have_a_line(run: Run, phase: str) -> None:
    row = next(p.start for p in run.phases if p.name == phase) + 50
    assert broken(audit(with_value(run, "tool/pose", row, 0, 9.0))) == []


def test_the_line_ends_with_its_motion(run: Run) -> None:
    """First and last row of a LIN motion count, the rows around do not."""
    index = next(i for i, p in enumerate(run.phases) if p.name == "descend")
    first, after = run.phases[index].start, run.phases[index + 1].start
    for row, held in ((first - 1, False), (first, True), (after - 1, True), (after, False)):
        findings = audit(with_value(run, "tool/pose", row, 1, 9.0))
        assert broken(findings) == (["LIN measured (tool)"] if held else [])


def test_the_overshoot_of_a_line_counts(run: Run) -> None:
    index = next(i for i, p in enumerate(run.phases) if p.name == "descend")
    row = run.phases[index + 1].start - 1
    goal = run.phases[index].leg
    assert goal is not None
    value = float(goal.T_world_goal.translation()[2]) - 0.6e-3
    assert broken(audit(with_value(run, "tool/pose", row, 2, value))) == ["LIN measured (tool)"]


def test_half_the_speed_is_held_against_half_the_profile() -> None:
    slow = picked_and_placed(speed=0.5)
    findings = audit(slow)
    assert broken(findings) == []
    limits = {found.signal.split(" (")[0]: found.limit for found in findings}
    assert limits["reference v"] == pytest.approx(2.0 * 0.5)
    assert limits["reference a"] == pytest.approx(3.0 * 0.5**2)
    assert limits["reference jerk"] == pytest.approx(10.0 * 0.5**3)
    assert limits["measured v"] in PANDA.rated.v_max
    fast = audit(with_value(slow, "joints/v_ref", ROW, 0, 1.01))
    assert own_bounds(fast) == ["reference v (joint1)"]


def test_a_full_speed_run_is_not_a_half_speed_run(run: Run) -> None:
    planner = replace(run.scenario.planner, pace=0.5)
    scenario = replace(run.scenario, planner=planner)
    names = [name.split(" (")[0] for name in broken(audit(replace(run, scenario=scenario)))]
    assert names == [
        "reference v",
        "reference a",
        "reference jerk",
        "reference tool speed",
        "reference tool acceleration",
        "reference tool jerk",
        "measured tool speed",
    ]


def test_a_run_without_lin_motions_promises_no_line() -> None:
    stuck = carry_out(Reach(rise=5.0))
    assert not any(leg.waypoint.motion is Motion.LIN for leg in stuck.legs)
    titles = [found.signal.split(" (")[0] for found in audit(stuck)]
    assert titles == [*OF_JOINTS, *APART, *TOUCHED]


def test_derived_and_delivered_signals_are_not_what_is_judged(run: Run) -> None:
    """A controller that asks for too much is caught although the motors cut it off."""
    findings = audit(with_value(run, "joints/tau", ROW, 0, 500.0))
    assert broken(findings) == []


# References that stream


def streaming(run: Run) -> tuple[Run, int, int]:
    """The same with its first phase at rest declared to stream; and its first and last row."""
    i = next(i for i, phase in enumerate(run.phases) if phase.leg is None)
    phases = list(run.phases)
    phases[i] = replace(phases[i], streamed=True)
    return replace(run, phases=phases), phases[i].start, phases[i + 1].start - 1


@pytest.mark.parametrize(("end", "beyond"), [("first", -1), ("last", 1)])
def test_a_streamed_reference_may_jump_in_acceleration_but_no_other(
    run: Run, end: str, beyond: int
) -> None:
    streamed, first, last = streaming(run)
    row = first if end == "first" else last
    jerk = "reference jerk (joint1)"
    assert jerk in broken(audit(with_value(run, "joints/a_ref", row, 0, 0.5)))
    allowed = broken(audit(with_value(streamed, "joints/a_ref", row, 0, 0.5)))
    assert not any("joint" in signal for signal in allowed)
    assert jerk in broken(audit(with_value(streamed, "joints/a_ref", row + beyond, 0, 0.5)))


@pytest.mark.parametrize(("streamed", "compliant"), [(True, False), (False, True), (True, True)])
def test_no_phase_is_free_to_have_any_reference_speed(
    run: Run, streamed: bool, compliant: bool
) -> None:
    stream, first, _ = streaming(run)
    phases = [
        replace(phase, streamed=streamed, compliant=compliant) if phase.streamed else phase
        for phase in stream.phases
    ]
    fast = with_value(replace(run, phases=phases), "joints/v_ref", first + 5, 0, 2.1)
    assert "reference v (joint1)" in broken(audit(fast))


# Phases that yield


def pushed(run: Run, row: int, *signals: str) -> list[str]:
    """What is told where the first joint does twice what it may in one row."""
    limits = {"a": PANDA.rated.a_max, "tau": PANDA.tau_max, "tau_command": PANDA.tau_max}
    for signal in signals:
        run = with_value(run, f"joints/{signal}", row, 0, 2.0 * float(limits[signal][0]))
    return [name for name in broken(audit(run)) if name in (A, TORQUE)]


A, TORQUE = "measured a (joint1)", "torque (joint1)"


def test_an_arm_that_yields_is_held_to_its_acceleration_and_commanded_torque(run: Run) -> None:
    stiff, first, last = streaming(run)
    phases = [
        replace(phase, streamed=False, compliant=True) if phase.streamed else phase
        for phase in stiff.phases
    ]
    yielding = replace(run, phases=phases)
    for row in (first - 1, first, last, last + 1):
        for one in (yielding, stiff):
            assert pushed(one, row, "a", "tau_command") == [A, TORQUE]
            # What is judged is the command, whatever the motors make of it.
            assert pushed(one, row, "tau") == []


# Nothing is hidden


def test_what_is_not_judged_is_told_with_its_true_extreme_its_share_and_why(run: Run) -> None:
    _, first, last = streaming(run)
    taken = replace(run, retaken=range(first, last + 1))
    share = (last - first + 1) / len(run.rows)
    wild = with_value(taken, "joints/v_ref", first + 5, 2, -17.0)
    found = next(f for f in audit(wild) if f.signal == "reference v (joint3), exempt")
    assert (found.extreme, found.ok) == (17.0, True)
    assert found.time == pytest.approx((first + 5) * TIMESTEP)
    assert found.share == pytest.approx(share)
    assert found.exempt.startswith("the reference is taken anew from the arm")
    assert f"not judged in {100 * share:.1f} % of the time: the reference is" in str(found)
    own = next(f for f in audit(wild) if f.signal.startswith("reference v (") and not f.exempt)
    plain = next(f for f in audit(run) if f.signal.startswith("reference v ("))
    assert own.extreme == plain.extreme
    assert own.share == pytest.approx(1.0 - share)
    streamed, first, _ = streaming(run)
    jump = with_value(streamed, "joints/a_ref", first + 5, 0, 0.5)
    jerk = next(f for f in audit(jump) if f.signal == "reference jerk (joint1), exempt")
    assert jerk.extreme == pytest.approx(500.0, rel=0.01)


def test_a_run_that_is_exempt_from_end_to_end_is_told_to_be_unjudged(run: Run) -> None:
    phases = [replace(phase, streamed=True, compliant=True) for phase in run.phases]
    phases[0] = replace(phases[0], start=0)
    free = replace(run, phases=phases, retaken=range(len(run.rows)))
    found = [f for f in audit(free) if f.exempt]
    names = {f.signal.split(" (")[0] for f in found}
    assert {"reference v", "reference jerk", "reference q to v", "LIN measured"} <= names
    shares = [f.share for f in found if f.signal.startswith("reference v (")]
    assert shares == [pytest.approx(1.0, abs=2.0 / len(run.rows))]
    off = with_value(free, "tool/pose", ROW, 1, 5.0)
    line = [f for f in audit(off) if f.signal.startswith("LIN measured")]
    assert [f.exempt != "" for f in line] == [True]


@pytest.mark.parametrize(
    "signal", ["joints/q", "joints/v", "joints/a", "joints/tau_command", "contact/tool"]
)
def test_a_number_that_is_none_breaks_a_promise(run: Run, signal: str) -> None:
    assert broken(audit(with_value(run, signal, ROW, 0, np.nan)))


def test_the_audit_changes_nothing_that_was_recorded(run: Run) -> None:
    streamed, *_ = streaming(run)
    before = streamed.rows.values.copy()
    audit(streamed)
    assert np.array_equal(streamed.rows.values, before)
