"""Planning around the arm's own links: judged by MuJoCo's contacts along the motions."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from mink import SE3

from robo47_qp.errors import PlanError, RefusalReason
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import IkResult
from robo47_qp.model.arm import JOINT_MARGIN, Arm
from robo47_qp.model.mjcf import robot_spec
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.branch_choice import BranchChoice
from robo47_qp.motion.collision_check import Collisions
from robo47_qp.motion.following.lin import Lin
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.motion.waypoint import Motion, Place, Waypoint, tool_down
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.conveyor_pick.conveyor_pick import ConveyorPick

DT = 1e-3
ARM = Arm(PANDA, margin=JOINT_MARGIN)
NEAR_BASE = (0.281, 0.005)
"""Where links 1 and 5 meet on the way down in the configuration that is preferred at its start."""


def pose(z: float) -> SE3:
    return tool_down([*NEAR_BASE, z], 0.2527)


DOWN = Waypoint(name="down", target=pose(0.02), motion=Motion.LIN)
UP = Waypoint(name="up", target=pose(0.15), motion=Motion.LIN)
ABOVE = Waypoint(name="above", target=pose(0.15), onward=(DOWN, UP))


@cache
def planner() -> Planner:
    return ClassicalStack(ik="qp").scenario(PANDA, ConveyorPick()).planner


@cache
def blind() -> Planner:
    return Planner(ik=planner().ik, profile=PANDA.profile)


@cache
def planned() -> tuple[Leg, ...]:
    """What the planner of every task makes of the three waypoints."""
    legs, q = list[Leg](), ARM.home
    for waypoint in (ABOVE, DOWN, UP):
        legs.append(planner().plan(ARM, waypoint, q, DT))
        q = legs[-1].trajectory.end.q
    return tuple(legs)


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
    assert caught.value.rejection.reason is RefusalReason.COLLISION


def test_the_planner_of_every_task_takes_another_branch() -> None:
    for leg in planned():
        assert touching(leg.trajectory) == set()
        assert max(ARM.pose_distance(leg.T_world_goal, leg.trajectory.end.q)) < 1.1e-6


def test_a_branch_close_to_a_limit_is_taken_only_where_none_has_more_room() -> None:
    legs = planned()
    span = 0.5 * (ARM.q_max - ARM.q_min)
    ends = np.array([leg.trajectory.end.q for leg in legs])
    chosen = float((np.minimum(ends - ARM.q_min, ARM.q_max - ends) / span).min())
    assert chosen > 0.02
    # With as few configurations as are tried at first there is one branch, without room.
    chain, usual = planner().branch_choice, (Lin(), [ABOVE, DOWN, UP])
    results = chain.choose(ARM, planner().ik, *usual, ARM.home, PANDA.profile.v_max)
    few = np.array([result.q for result in results])
    assert float((np.minimum(few - ARM.q_min, ARM.q_max - few) / span).min()) < 0.02


def test_a_part_of_a_line_that_ends_at_a_limit_can_be_followed_too() -> None:
    """The line ends 1e-5 rad before a limit of the last joint: the timing of a part passes it."""
    planner = ClassicalStack().scenario(PANDA, ConveyorPick()).planner
    q = [0.06460626, 0.18088688, 0.50368207, -2.237641, -0.12784044, 2.3923806, 2.87163083]
    above, part, end = (
        SE3.from_translation(np.array([0.0, 0.0, down])) @ ARM.pose(np.array(q))
        for down in (0.0, -0.11, -0.16)
    )
    line, first = (Waypoint(name="line", target=T, motion=Motion.LIN) for T in (end, part))
    choice, alone = planner.branch_choice, Waypoint(name="above", target=above)
    usual = replace(choice, candidates=1).answers(ARM, planner.ik, alone, ARM.home)[0]
    planner.plan(ARM, line, usual.q, DT)
    with pytest.raises(PlanError, match="joint7 leaves its limits"):
        planner.plan(ARM, first, usual.q, DT)
    leg = planner.plan(ARM, replace(alone, onward=(line,)), ARM.home, DT)
    planner.plan(ARM, first, leg.trajectory.end.q, DT)


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
    blind = BranchChoice(candidates=2).choose(ARM, ik, Lin(), group, ARM.home, PANDA.profile.v_max)
    assert [collisions.at(result.q) for result in blind] == [None, None]
    wary = BranchChoice(candidates=2, collisions=collisions)
    with pytest.raises(PlanError, match=r"Waypoint 'across'.* come within") as caught:
        wary.choose(ARM, ik, Lin(), group, ARM.home, PANDA.profile.v_max)
    rejection = caught.value.rejection
    assert rejection is not None
    assert rejection.reason is RefusalReason.COLLISION
    assert 0.2 < rejection.fraction < 0.6


def test_a_way_through_the_scene_is_refused_and_another_one_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The first branch with room that leads on here lies beyond a sweep through the belt."""
    q = np.array([-0.611, 0.342, 0.31, -2.13, -0.161, 2.451, 1.242])
    place = (0.2807, 0.0108)
    above, down = (tool_down([*place, z], -0.4334) for z in (0.15, 0.02))
    onward = (
        Waypoint(name="down", target=down, motion=Motion.LIN),
        Waypoint(name="up", target=above, motion=Motion.LIN),
    )
    there = Waypoint(name="there", target=above, onward=onward)
    # Both planners are offered the same configurations, searched for once.
    choice, ik, lin = planner().branch_choice, planner().ik, planner().lin
    offered, seen = choice.candidates_for(ARM, ik, lin, there, q), list[IkResult]()

    def candidates(*_: object) -> Iterator[IkResult]:
        yield from list(seen)
        for result in offered:
            seen.append(result)
            yield result

    monkeypatch.setattr(BranchChoice, "candidates_for", candidates)
    careless = replace(planner(), surroundings=None).plan(ARM, there, q, DT)
    assert struck(careless.trajectory)
    assert len(seen) == 1
    leg = planner().plan(ARM, there, q, DT)
    assert len(seen) > 1
    assert struck(leg.trajectory) == set()
    assert touching(leg.trajectory) == set()
    assert max(ARM.pose_distance(above, leg.trajectory.end.q)) < 1.1e-6


def test_a_blended_way_through_the_scene_is_refused_as_one_with_a_stop_is() -> None:
    """A wall stands beside the table, between home and where the arm goes."""

    def walled(spec: mujoco.MjSpec) -> None:
        spec.worldbody.add_geom(
            name="wall",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.3, 0.005, 0.5],
            pos=[0.6, -0.15, 0.5],
        )

    around = Collisions(PANDA, walled, clearance=0.002)
    careful = replace(planner(), surroundings=around)
    there = Waypoint(name="there", target=tool_down([0.45, -0.35, 0.3]))
    beyond = Waypoint(name="beyond", target=tool_down([0.45, -0.4, 0.3]))
    # It begins to turn off before it is there.
    for passed in (there, replace(there, blend=0.02)):
        careless = replace(planner(), surroundings=None)
        legs = careless.plan_chain(ARM, [passed, beyond], ARM.home, DT)
        assert any(around.first_hit(leg.trajectory.q, DT) is not None for leg in legs)
        with pytest.raises(PlanError, match=r"Waypoint 'there' .*wall and .* come within"):
            careful.plan_chain(ARM, [passed, beyond], ARM.home, DT)


def test_what_is_too_close_may_get_away_and_none_may_come() -> None:
    low = ARM.pose(ARM.home).translation() * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.005]
    at_table = planner().ik.solve(ARM, tool_down(low), ARM.home).q
    around = planner().surroundings
    assert around is not None
    assert around.at(at_table) is not None
    home = Waypoint(name="home", target=Place.HOME)
    assert planner().plan(ARM, home, at_table, DT).trajectory.end.q.tolist() == ARM.home.tolist()
    deep = Waypoint(name="deep", target=tool_down(low - [0.0, 0.0, 0.03]))
    with pytest.raises(
        PlanError, match=r"Waypoint 'deep' .*: table and (left|right)_finger come within"
    ) as caught:
        planner().plan(ARM, deep, ARM.home, DT)
    assert caught.value.rejection is not None
    assert caught.value.rejection.reason is RefusalReason.COLLISION
    # Lines may be meant to touch.
    line = planner().plan(ARM, replace(deep, motion=Motion.LIN), ARM.home, DT)
    assert max(ARM.pose_distance(line.T_world_goal, line.trajectory.end.q)) < 1.1e-6


def struck(motion: Trajectory) -> set[str]:
    """What the arm meets of the scene along a motion, its own links aside."""
    task = ConveyorPick()
    simulation = Simulation(PANDA, task.build_scene)
    model, data, found = simulation.model, simulation.data, set[str]()
    simulation.place_object("cube", SE3.from_translation(np.array([-0.5, -0.5, 2.0])))
    at = [int(model.joint(name).qposadr[0]) for name in PANDA.joints]
    for q in motion.q[::5]:
        data.qpos[at] = q
        mujoco.mj_forward(model, data)
        names = {model.geom(g).name for pair in data.contact.geom for g in pair}
        found |= names & {"table", "belt", "floor"}
    return found
