"""The audit of the reference: its q, v and a are those of one motion."""

from dataclasses import replace

import pytest

from robo47_qp.constants import TIMESTEP
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.recording import Rows
from robo47_qp.run.scenario import Run
from tests.report.audit.test_audit import broken, finding
from tests.runs import picked_and_placed


@pytest.fixture(scope="module")
def run() -> Run:
    return picked_and_placed()


@pytest.mark.parametrize("name", ["approach", "descend", "close gripper", "carry"])
def test_a_reference_that_jumps_for_a_while_is_told(run: Run, name: str) -> None:
    start = next(phase.start for phase in run.phases if phase.name == name)
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows["joints/q_ref"][start + 20 : start + 60, 1] += 0.05
    found = finding(audit(replace(run, rows=rows)), "reference q to v (joint2)")
    assert (found.ok, found.unit) == (False, "rad/s")
    assert found.limit == pytest.approx(0.5 * 3.0 * TIMESTEP)
    assert found.extreme == pytest.approx(50.0, rel=0.02)
    assert round(found.time / TIMESTEP) - start in (19, 59)


@pytest.mark.parametrize(
    ("signal", "told"),
    [("v_ref", {"reference q to v", "reference v to a"}), ("a_ref", {"reference v to a"})],
)
def test_a_reference_that_claims_to_rest_as_it_moves_is_told(
    run: Run, signal: str, told: set[str]
) -> None:
    """Each would keep every bound of its own."""
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows[f"joints/{signal}"][:] = 0.0
    assert {name.split(" (")[0] for name in broken(audit(replace(run, rows=rows)))} == told


def test_a_step_is_allowed_where_the_reference_is_taken_anew_and_nowhere_else(run: Run) -> None:
    row = next(phase.start for phase in run.phases if phase.name == "close gripper") + 50
    rows = Rows(run.rows.signals, run.rows.values.copy())
    for part in ("q", "q_ref"):
        rows[f"joints/{part}"][row:, 0] += 0.004
    moved = replace(run, rows=rows)
    step = "reference q to v (joint1)"
    assert step in broken(audit(moved))
    for other in (row - 1, row + 1):
        assert step in broken(audit(replace(moved, retaken=[0, other])))
    findings = audit(replace(moved, retaken=[0, row]))
    assert step not in broken(findings)
    told = next(f for f in findings if f.signal.startswith("reference q to v") and f.exempt)
    assert told.extreme == pytest.approx(4.0, rel=1e-3)
    assert told.time == pytest.approx((row - 1) * TIMESTEP)
    assert told.share == pytest.approx(1.0 / (len(rows) - 1))
    # It is taken from where the arm is.
    rows["joints/q"][row, 0] += 0.021
    off = [name for name in broken(audit(replace(moved, retaken=[0, row]))) if "retaken" in name]
    assert off == ["retaken q (joint1)"]
    assert "retaken q (joint1)" not in broken(audit(moved))
