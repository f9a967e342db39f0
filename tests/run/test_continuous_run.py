"""Motions without stops, carried out on the simulated arm."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mink import SE3

from robo47_qp.constants import TIMESTEP
from robo47_qp.motion.waypoint import Motion, Place, Waypoint
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.steps import StepLike
from robo47_qp.run.task import Program
from robo47_qp.sim.sensed import Sensed
from tests.examples import shifted
from tests.runs import Reach, carry_out


@dataclass(frozen=True, kw_only=True)
class Round(Reach):
    """A line, blended into an arc, blended into a line; home; the arc alone."""

    name: str = "round"

    def preview(self, sensed: Sensed) -> Sequence[StepLike]:  # type: ignore[override]
        start = sensed.tool_pose()

        def at(x: float, y: float, z: float) -> SE3:
            return shifted(start, np.array([x, y, z]))

        middle = start.translation() + np.array([0.12, 0.09, 0.02])
        there = Waypoint(name="there", target=at(0.15, 0.0, 0.0), motion=Motion.LIN, blend=0.02)
        round_ = Waypoint(
            name="round", target=at(0.1, 0.15, 0.0), motion=Motion.CIRC, through=middle, blend=0.02
        )
        down = Waypoint(name="down", target=at(0.1, 0.2, -0.1), motion=Motion.LIN)
        alone = Waypoint(
            name="arc",
            target=at(0.1, 0.1, 0.0),
            motion=Motion.CIRC,
            through=start.translation() + np.array([0.08, 0.02, 0.0]),
        )
        return [(there, round_, down), Waypoint(name="home", target=Place.HOME), alone]

    def program(self, sensed: Sensed) -> Program:
        yield from self.preview(sensed)
        return None


def test_a_tuple_of_waypoints_is_one_motion_that_the_arm_follows() -> None:
    run = carry_out(Round())
    assert run.failure is None
    names = [leg.waypoint.name for leg in run.legs]
    assert names == ["there", "round", "down", "home", "arc"]
    v, a = run.rows["joints/v_ref"], run.rows["joints/a_ref"]
    for name in ("round", "down"):
        start = next(phase.start for phase in run.phases if phase.name == name)
        assert np.abs(v[start]).max() > 0.05
    profile = run.scenario.planner.profile
    assert (np.abs(np.diff(a, axis=0)) / TIMESTEP <= profile.j_max * (1 + 1e-6)).all()
    off = run.rows["tool/pose"][:, :3] - run.rows["tool/pose_ref"][:, :3]
    assert np.linalg.norm(off, axis=1).max() < 0.2e-3
    findings = audit(run)
    assert all(finding.ok for finding in findings)
    arcs = {finding.signal: finding.extreme for finding in findings if "CIRC" in finding.signal}
    assert set(arcs) == {"CIRC commanded (tool)", "CIRC measured (tool)"}
    assert arcs["CIRC commanded (tool)"] < 10e-6
    assert arcs["CIRC measured (tool)"] < 0.2e-3
