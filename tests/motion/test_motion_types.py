"""Every motion type, on every robot that ships: planned, followed exactly, and audited."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import Robot
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.motion.waypoint import Motion, Waypoint
from robo47_qp.report.audit import tool as tool_audit
from robo47_qp.run.phase import Phase
from tests.robots import MAKERS, robot_named, robot_or_skip


def ahead(arm: Arm, motion: Motion) -> Waypoint:
    """A few centimetres from home; what shapes the path is beside it."""
    here = arm.pose(arm.home)
    by, beside = np.array([-0.02, 0.05, -0.04]), np.array([0.01, 0.04, -0.01])
    turn = here.rotation() @ SO3.from_z_radians(0.2)
    shape: dict[str, Any] = {name: here.translation() + beside for name in motion.type.points[:1]}
    target = SE3.from_rotation_and_translation(turn, here.translation() + by)
    return Waypoint(name="ahead", target=target, motion=motion, **shape)


def followed(planner: Planner, arm: Arm, leg: Leg) -> Any:
    """A run that follows a leg exactly, with what the audit of the tool looks at."""
    rows = {
        f"joints/{name}{kind}": getattr(leg.trajectory, name)
        for name in "qva"
        for kind in ("", "_ref")
    }
    poses = [arm.pose(q) for q in leg.trajectory.q]
    flat = np.array([[*pose.translation(), *pose.rotation().wxyz] for pose in poses])
    rows |= {"tool/pose": flat, "tool/pose_ref": flat}

    class Rows(dict[str, np.ndarray]):
        def __len__(self) -> int:
            return len(flat)

    phase = Phase(name="ahead", start=0, leg=leg)
    scenario = SimpleNamespace(planner=planner, robot=arm.robot)
    spans = [(phase, slice(0, len(flat)))]
    return SimpleNamespace(rows=Rows(rows), spans=lambda: spans, scenario=scenario)


def planned(robot: Robot, motion: Motion) -> tuple[Planner, Arm, Leg]:
    arm = Arm(robot)
    planner = Planner(ik=MultiStart(solver=LmIk()), profile=robot.profile)
    return planner, arm, planner.plan(arm, ahead(arm, motion), arm.home, TIMESTEP)


@pytest.mark.parametrize("motion", Motion)
@pytest.mark.parametrize("name", MAKERS)
def test_it_is_planned_and_keeps_what_the_audit_promises(name: str, motion: Motion) -> None:
    robot = robot_or_skip(name)
    planner, arm, leg = planned(robot, motion)
    q, v, a = leg.trajectory.q, leg.trajectory.v, leg.trajectory.a
    ends: list[Vector] = [v[0], v[-1], a[0], a[-1]]
    assert not np.any(ends)
    assert q[0] == pytest.approx(arm.home, abs=1e-9)
    assert max(arm.pose_distance(leg.T_world_goal, q[-1])) < 1e-4
    for rates, bound in ((v, robot.profile.v_max), (a, robot.profile.a_max)):
        assert (np.abs(rates) <= bound * (1 + 1e-6)).all()
    assert 0.0 < leg.lower_bound <= leg.trajectory.duration + 1e-9
    run = followed(planner, arm, leg)
    paths, rates_found = tool_audit.tool_paths(run), tool_audit.tool_rates(run, arm)
    assert all(found.ok for found in (*paths, *rates_found))
    if motion.type.prescribes_path:
        assert [found.signal.split(" (")[0] for found in paths] == [
            f"{motion.name} commanded",
            f"{motion.name} measured",
        ]
        assert rates_found
    else:
        assert (leg.path, paths, rates_found) == (None, [], [])


@pytest.mark.parametrize("motion", [motion for motion in Motion if motion.type.prescribes_path])
def test_the_audit_sees_a_tool_beside_its_path(motion: Motion) -> None:
    planner, arm, leg = planned(robot_named("panda"), motion)
    run = followed(planner, arm, leg)
    run.rows["tool/pose_ref"][len(run.rows) // 2, :3] += 1e-3
    assert not all(found.ok for found in tool_audit.tool_paths(run))


@pytest.mark.parametrize("motion", Motion)
def test_its_points_are_asked_for_and_others_are_refused(motion: Motion) -> None:
    target, known = SE3.identity(), ("through", "centre")
    point: Any = np.array([0.0, 0.1, 0.2])
    for name in known:
        if name in motion.type.points:
            Waypoint(name="there", target=target, motion=motion, **dict[str, Any]({name: point}))
        else:
            with pytest.raises(InvalidValueError, match="shape of the way to waypoint 'there'"):
                Waypoint(
                    name="there", target=target, motion=motion, **dict[str, Any]({name: point})
                )
    if motion.type.points:
        with pytest.raises(InvalidValueError, match="with one of through and centre"):
            Waypoint(name="there", target=target, motion=motion)


def test_colours_differ() -> None:
    assert len({motion.type.colour for motion in Motion}) == len(Motion)


@pytest.mark.parametrize("motion", Motion)
def test_a_waypoint_that_is_passed_has_to_be_passable(motion: Motion) -> None:
    shape: dict[str, Any] = {name: np.ones(3) for name in motion.type.points[:1]}
    if motion.type.passable:
        assert not Waypoint(
            name="by", target=SE3.identity(), motion=motion, stop=False, **shape
        ).rests
        return
    with pytest.raises(InvalidValueError, match="PTP or LIN without a blend"):
        Waypoint(name="by", target=SE3.identity(), motion=motion, stop=False, **shape)
