"""Planning around the arm's own links: judged by MuJoCo's contacts along the motions."""

from functools import cache

import mujoco
import numpy as np
import pytest
from mink import SE3

from robo47_qp.arm import MARGIN, Arm
from robo47_qp.errors import Obstacle, PlanError
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.motion.chain import Chain
from robo47_qp.motion.collisions import Collisions
from robo47_qp.motion.leg import Leg
from robo47_qp.motion.lin import Lin
from robo47_qp.motion.planner import Planner
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.options import RunOptions
from robo47_qp.robot_model import robot_spec
from robo47_qp.robots.panda import PANDA
from robo47_qp.waypoint import Motion, Waypoint, tool_down
from tasks.conveyor_pick import ConveyorPick

DT = 1e-3
ARM = Arm(PANDA, margin=MARGIN)
NEAR_BASE = (0.281, 0.005)
"""Where links 1 and 5 meet on the way down in the configuration that is preferred at its start."""


def pose(z: float) -> SE3:
    return tool_down([*NEAR_BASE, z], 0.2527)


DOWN = Waypoint(name="down", target=pose(0.02), motion=Motion.LIN)
UP = Waypoint(name="up", target=pose(0.15), motion=Motion.LIN)
ABOVE = Waypoint(name="above", target=pose(0.15), onward=(DOWN, UP))


@cache
def planner() -> Planner:
    return RunOptions().scenario(PANDA, ConveyorPick()).planner


@cache
def blind() -> Planner:
    return Planner(ik=planner().ik, profile=PANDA.profile)


def run(by: Planner) -> list[Leg]:
    legs, q = list[Leg](), ARM.home
    for waypoint in (ABOVE, DOWN, UP):
        legs.append(by.plan(ARM, waypoint, q, DT))
        q = legs[-1].trajectory.end.q
    return legs


def touching(motion: Trajectory) -> set[tuple[str, str]]:
    """Pairs of bodies in contact along a motion, fingers closed."""
    model = robot_spec(PANDA).compile()
    data, found = mujoco.MjData(model), set[tuple[str, str]]()
    at = [int(model.joint(name).qposadr[0]) for name in PANDA.joints]
    for q in motion.q[::5]:
        data.qpos[at] = q
        mujoco.mj_forward(model, data)
        for geoms in data.contact.geom:
            one, other = (model.body(model.geom_bodyid[g]).name for g in geoms)
            found.add((one, other))
    return found


def test_without_a_look_links_meet_on_the_line_that_follows() -> None:
    q = blind().plan(ARM, ABOVE, ARM.home, DT).trajectory.end.q
    lower = blind().plan(ARM, DOWN, q, DT)
    assert touching(lower.trajectory) == {("link1", "link5")}
    with pytest.raises(PlanError, match="link1 and link5 come within") as caught:
        planner().plan(ARM, DOWN, q, DT)
    assert caught.value.rejection is not None
    assert caught.value.rejection.obstacle is Obstacle.COLLISION


def test_the_planner_of_every_task_takes_another_branch() -> None:
    legs = run(planner())
    for leg in legs:
        assert touching(leg.trajectory) == set()
        assert max(ARM.distance_to(leg.T_world_goal, leg.trajectory.end.q)) < 1.1e-6


def test_a_branch_close_to_a_limit_is_taken_only_where_none_has_more_room() -> None:
    legs = run(planner())
    span = 0.5 * (ARM.q_max - ARM.q_min)
    ends = np.array([leg.trajectory.end.q for leg in legs])
    chosen = float((np.minimum(ends - ARM.q_min, ARM.q_max - ends) / span).min())
    assert chosen > 0.02
    # With as few configurations as are tried at first there is one branch, without room.
    chain, usual = planner().chain, (Lin(), [ABOVE, DOWN, UP])
    results = chain.choose(ARM, planner().ik, *usual, ARM.home, PANDA.profile.v_max)
    few = np.array([result.q for result in results])
    assert float((np.minimum(few - ARM.q_min, ARM.q_max - few) / span).min()) < 0.02


def test_a_line_that_would_hit_something_only_on_its_way_rules_a_branch_out() -> None:
    """A bead on the line, between its ends, which are clear of it."""

    def bead(spec: mujoco.MjSpec) -> None:
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], pos=[0.5, 0.0, 0.30]
        )

    ik, collisions = MultiStart(solver=LmIk()), Collisions(PANDA, bead, clearance=0.002)
    start, end = tool_down([0.5, -0.2, 0.30]), tool_down([0.5, 0.2, 0.30])
    group = [
        Waypoint(name="start", target=start),
        Waypoint(name="across", target=end, motion=Motion.LIN),
    ]
    blind = Chain(candidates=2).choose(ARM, ik, Lin(), group, ARM.home, PANDA.profile.v_max)
    assert [collisions.at(result.q) for result in blind] == [None, None]
    wary = Chain(candidates=2, collisions=collisions)
    with pytest.raises(PlanError, match=r"Waypoint 'across'.* come within") as caught:
        wary.choose(ARM, ik, Lin(), group, ARM.home, PANDA.profile.v_max)
    rejection = caught.value.rejection
    assert rejection is not None
    assert rejection.obstacle is Obstacle.COLLISION
    assert 0.2 < rejection.fraction < 0.6
