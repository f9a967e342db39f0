"""The audit of motions through blends and on arcs, whose bounds are those of continuous motion."""

from dataclasses import replace

import numpy as np
import pytest

from robo47_qp.motion.continuous import Continuous
from robo47_qp.motion.paths.segments import PathProfile
from robo47_qp.motion.planner import Planner
from robo47_qp.motion.timing.rest_to_rest import Trapezoid
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.scenario import Run
from tests.report.audit.test_audit import broken
from tests.report.audit.test_audit_tool import named
from tests.run.test_continuous_run import Round
from tests.runs import carry_out


@pytest.fixture(scope="module")
def round_run() -> Run:
    return carry_out(Round())


def planned_by(run: Run, planner: Planner) -> Run:
    return replace(run, scenario=replace(run.scenario, planner=planner))


def test_arcs_and_blends_are_held_to_the_bounds_of_continuous_motion(round_run: Run) -> None:
    assert broken(audit(round_run)) == []
    slower = Continuous(profile=PathProfile(linear=(0.1, 0.5, 4.0)))
    planner = replace(round_run.scenario.planner, continuous=slower)
    findings = audit(planned_by(round_run, planner))
    assert named(findings, "reference tool speed").limit == 0.1
    assert named(findings, "measured tool speed").limit == pytest.approx(0.105)
    assert [name.split(" (")[0] for name in broken(findings)] == [
        *("reference tool speed", "reference tool acceleration", "reference tool jerk"),
        "measured tool speed",
    ]


def test_they_keep_their_jerk_whatever_the_law_of_lines(round_run: Run) -> None:
    planner = replace(round_run.scenario.planner, law=Trapezoid())
    findings = audit(planned_by(round_run, planner))
    assert named(findings, "reference tool jerk").limit == 5.0
    assert np.isfinite([found.limit for found in findings]).all()
