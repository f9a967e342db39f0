"""The audit of steps in contact: a tool that presses, one that moves on until it touches."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.audit.finding import Finding
from robo47_qp.report.audit.tool import LIN_COMMANDED
from robo47_qp.run.contact_steps import Guarded
from robo47_qp.run.recording import Rows
from robo47_qp.run.scenario import Run
from robo47_qp.run.task import Program
from robo47_qp.sim.sensed import Sensed
from tests.report.audit.test_audit import broken
from tests.report.audit.test_audit_contact import among
from tests.run.bench import DOWN, PLATE, line, rows_of, run_program
from tests.run.test_press import slid

ARM = Arm(PANDA)
ASIDE, DEEPER = np.array([1.0, 0.0, 0.0]), DOWN


@cache
def guarded() -> Run:
    def program(sensed: Sensed) -> Program:
        yield Guarded(waypoint=line(sensed, [0.0, 0.0, -PLATE - 0.02], "down"), force=3.0)
        return None

    return run_program(program)


def rows_in(run: Run, name: str, part: slice = slice(20, -20)) -> np.ndarray:
    return np.arange(len(run.rows))[run.spans()[_place(run, name)][1]][part]


def _place(run: Run, name: str) -> int:
    return next(i for i, phase in enumerate(run.phases) if phase.name == name)


def shifted(run: Run, name: str, way: np.ndarray, kind: str) -> list[str]:
    """What is told where a tool is off by a way (3,) in a motion, as its joints tell it, too."""
    rows, at = Rows(run.rows.signals, run.rows.values.copy()), rows_in(run, name)
    rows[f"tool/pose{kind}"][at, :3] += way
    return broken(audit(replace(run, rows=rows)))


def exempt(findings: Sequence[Finding], start: str) -> Finding:
    return next(found for found in findings if found.signal.startswith(start) and found.exempt)


@pytest.mark.parametrize(("kind", "most"), [("_ref", 0.02), ("", 0.02 + 0.05 * 0.25)])
def test_a_step_is_held_to_the_speed_that_it_allows(kind: str, most: float) -> None:
    run = guarded()
    name = f"{'reference' if kind else 'measured'} tool speed (down)"
    kept = next(f for f in audit(run) if f.signal == name)
    assert kept.limit == pytest.approx(most)
    assert kept.ok
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows[f"joints/v{kind}"][round(kept.time / TIMESTEP)] *= 1.01 * most / kept.extreme
    assert name in broken(audit(replace(run, rows=rows)))


def test_a_tool_that_presses_is_slow_along_its_way_alone() -> None:
    run = slid()
    phases = [
        replace(phase, leg=replace(phase.leg, speed=1e-3))
        if phase.leg and phase.axis is not None
        else phase
        for phase in run.phases
    ]
    assert any(phase.axis is not None for phase in phases)
    assert broken(audit(replace(run, phases=phases))) == []
    stiff = [replace(phase, axis=None) for phase in phases]
    assert any("tool speed" in name for name in broken(audit(replace(run, phases=stiff))))


def test_a_tool_that_presses_is_stiff_and_its_reference_streams_along_its_axis() -> None:
    run = slid()
    for name in ("press", "to", "fro", "off"):
        phase = run.phases[_place(run, name)]
        assert (phase.compliant, phase.streamed) == (False, True)
        assert phase.axis is not None
        np.testing.assert_array_equal(phase.axis, DOWN)
        assert (phase.leg is None) == (name == "press")


@pytest.mark.parametrize("name", ["to", "fro"])
def test_its_reference_keeps_to_its_path_but_along_the_axis(name: str) -> None:
    run = slid()
    assert shifted(run, name, 0.05 * DEEPER, "_ref") == []
    assert shifted(run, name, 1.5 * LIN_COMMANDED * ASIDE, "_ref") == ["LIN commanded (tool)"]
    assert shifted(run, name, 0.05 * ASIDE, "_ref") == ["LIN commanded (tool)"]


@pytest.mark.parametrize("way", [ASIDE, DEEPER])
def test_where_the_tool_is_while_it_presses_is_told(way: np.ndarray) -> None:
    run = slid()
    assert shifted(run, "to", 0.05 * ASIDE, "") == []
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows["tool/pose"][rows_in(run, "to"), :3] += 0.05 * way
    found = exempt(audit(replace(run, rows=rows)), "LIN measured (tool)")
    assert found.extreme == pytest.approx(0.05, rel=0.02)
    assert "presses" in found.exempt


@pytest.mark.parametrize("name", ["press", "to"])
@pytest.mark.parametrize("signal", ["q_ref", "v_ref"])
def test_its_joints_are_held_to_their_bounds_and_to_one_motion(name: str, signal: str) -> None:
    run = slid()
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows[f"joints/{signal}"][rows_in(run, name), 3] += 0.15 if signal == "q_ref" else 20.0
    told = {found.split(" (")[0] for found in broken(audit(replace(run, rows=rows)))}
    assert "reference q to v" in told
    assert ("reference v" in told) == (signal == "v_ref")


def test_its_speed_is_bounded_and_its_acceleration_told() -> None:
    run = slid()
    rows = Rows(run.rows.signals, run.rows.values.copy())
    at = rows_in(run, "to")[100]
    for kind in ("reference", "measured"):
        fast = Rows(run.rows.signals, run.rows.values.copy())
        fast["joints/v_ref" if kind == "reference" else "joints/v"][at, 0] = 0.9
        assert f"{kind} tool speed (to)" in broken(audit(replace(run, rows=fast)))
    rows["joints/a_ref"][at] = [2.9, *[0.0] * 6]
    findings = audit(replace(run, rows=rows))
    lever = float(np.linalg.norm(ARM.jacobian(rows["joints/q_ref"][at])[:3, 0]))
    found = exempt(findings, "reference tool acceleration (to)")
    assert found.extreme == pytest.approx(2.9 * lever, rel=0.02)
    assert not [name for name in broken(findings) if name.startswith("reference tool acc")]


def test_a_reference_that_presses_through_an_obstacle_is_told() -> None:
    run, row = slid(), rows_in(slid(), "to")[100]
    lean = run.rows["joints/q_ref"][row] + [1.0, *[0.0] * 6]
    ball = Obstacle(
        name="ball",
        shape=Shape.SPHERE,
        size=(0.08,),
        T_world_obstacle=ARM.pose(lean),
    )
    beside = among(run, ball)
    assert not [name for name in broken(audit(beside)) if name.startswith("reference")]
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows["joints/q_ref"][row] = lean
    told = [name.split(" (")[0] for name in broken(audit(replace(beside, rows=rows)))]
    assert "reference distance" in told


def test_a_guarded_way_is_held_to_its_line_until_it_touches() -> None:
    run = guarded()
    assert run.failure is None
    assert [(phase.name, phase.compliant) for phase in run.phases] == [
        ("down", False),
        ("stop", True),
        ("end", False),
    ]
    assert broken(audit(run)) == []
    of_tool = ("LIN", "measured tool", "reference")
    free = [found for found in audit(run) if found.signal.startswith(of_tool) and found.exempt]
    assert {found.signal.split(" (")[0] for found in free} <= {
        "reference distance",
        "reference distance, scene",
    }
    force = np.linalg.norm(rows_of(run, "down", "contact/tool"), axis=1)
    assert force[-3:].max() >= 3.0
    assert force[:-20].max() < 3.0
    assert shifted(run, "down", 0.4e-3 * ASIDE, "") == ["LIN measured (tool)"]
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows["joints/v"][rows_in(run, "down"), 0] = 0.9
    assert "measured tool speed (down)" in broken(audit(replace(run, rows=rows)))
