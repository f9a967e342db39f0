"""Configurations of a chain, chosen together: judged by following lines in small steps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError, PlanError
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import IkResult, IkSolver
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.branch_choice import Branch, BranchChoice
from robo47_qp.motion.collision_check import Collisions
from robo47_qp.motion.following.lin import Lin
from robo47_qp.motion.paths.segments import Line
from robo47_qp.motion.planner import Planner
from robo47_qp.motion.refusals import PathError
from robo47_qp.motion.waypoint import Motion, Place, Waypoint, tool_down
from tests.examples import shifted

IK = MultiStart(solver=LmIk(max_iterations=20, stall=Stall()))
DT = 1e-3
ARM = Arm(PANDA)


def line(name: str, target: SE3) -> Waypoint:
    return Waypoint(name=name, target=target, motion=Motion.LIN)


def followed(arm: Arm, q: Vector, target: SE3, steps: int = 200) -> Vector | None:
    """Resolved-rate motion along a line in small steps, by plain damped least squares."""
    start = arm.pose(q)
    turn = (start.rotation().inverse() @ target.rotation()).log()
    for k in range(1, steps + 1):
        s = k / steps
        position = (1 - s) * start.translation() + s * target.translation()
        rotation = start.rotation() @ type(start.rotation()).exp(s * turn)
        there = SE3.from_rotation_and_translation(rotation, position)
        for _ in range(6):
            J = arm.jacobian(q)
            e = arm.pose_error(there, q)
            q = q + J.T @ np.linalg.solve(J @ J.T + 1e-10 * np.eye(6), e)
        if np.abs(arm.pose_error(there, q)).max() > 1e-5:
            return None
        if (q < arm.q_min).any() or (q > arm.q_max).any():
            return None
    return q


def hard_cases() -> list[tuple[SE3, SE3]]:
    """Lines that the usual answer at their start cannot follow, and another one can."""
    found = []
    for seed in (7, 29, 106):
        rng = np.random.default_rng(seed)
        q = rng.uniform(0.8 * ARM.q_min + 0.2 * ARM.q_max, 0.2 * ARM.q_min + 0.8 * ARM.q_max)
        start = ARM.pose(q)
        goal = shifted(start, rng.normal(size=3) * 0.12)
        others = replace(IK, answers=4).solve_all(ARM, start, ARM.home)
        usual = IK.solve(ARM, start, ARM.home)
        assert not reaches(Lin(), usual, goal)
        assert any(reaches(Lin(), other, goal) for other in others)
        found.append((start, goal))
    return found


def reaches(lin: Lin, start: IkResult, goal: SE3) -> bool:
    try:
        lin.follow(ARM, IK, start.q, Line(ARM.pose(start.q), goal))
    except PathError:
        return False
    return True


@pytest.fixture(scope="module")
def cases() -> list[tuple[SE3, SE3]]:
    return hard_cases()


def test_the_configuration_is_one_from_which_the_line_can_be_followed(
    cases: list[tuple[SE3, SE3]],
) -> None:
    planner = Planner(ik=IK, profile=PANDA.profile)
    for start, goal in cases:
        alone = Waypoint(name="start", target=start)
        onward = line("line", goal)
        blind = planner.plan(ARM, alone, ARM.home, DT)
        with pytest.raises(PlanError, match="Waypoint 'line'"):
            planner.plan(ARM, onward, blind.trajectory.end.q, DT)
        leg = planner.plan(ARM, replace(alone, onward=(onward,)), ARM.home, DT)
        q = leg.trajectory.end.q
        assert max(ARM.pose_distance(start, q)) < 1.1e-6
        assert followed(ARM, q, goal) is not None
        planner.plan(ARM, onward, q, DT)


def test_a_whole_chain_is_planned_where_one_leg_at_a_time_gets_stuck(
    cases: list[tuple[SE3, SE3]],
) -> None:
    planner = Planner(ik=IK, profile=PANDA.profile)
    for start, goal in cases:
        chain = [
            Waypoint(name="start", target=start),
            line("line", goal),
            line("back", start),
            Waypoint(name="home", target=Place.HOME),
        ]
        legs = planner.plan_chain(ARM, chain, ARM.home, DT)
        assert [leg.waypoint.name for leg in legs] == ["start", "line", "back", "home"]
        for before, after in pairwise(legs):
            assert after.trajectory.q[0] == pytest.approx(before.trajectory.end.q, abs=1e-12)
        for leg, target in zip(legs[:3], (start, goal, start), strict=True):
            assert max(ARM.pose_distance(target, leg.trajectory.end.q)) < 1.1e-6
        for leg in legs:
            assert (leg.trajectory.q >= ARM.q_min).all()
            assert (leg.trajectory.q <= ARM.q_max).all()
            assert np.abs(np.diff(leg.trajectory.q, axis=0)).max() < 0.01
        assert legs[-1].trajectory.end.q.tolist() == ARM.home.tolist()


def test_where_the_usual_answer_leads_on_it_is_taken(arm: Arm, robot: Robot) -> None:
    planner = Planner(ik=IK, profile=robot.profile)
    here = arm.pose(arm.home)
    target = shifted(here, np.array([0.02, 0.03, -0.02]))
    alone = Waypoint(name="start", target=target)
    onward = replace(alone, onward=(line("up", here),))
    a = planner.plan(arm, alone, arm.home, DT)
    b = planner.plan(arm, onward, arm.home, DT)
    assert a.ik.q.tolist() == b.ik.q.tolist()


def test_the_waypoint_that_rules_a_chain_out_is_named() -> None:
    few = BranchChoice(candidates=2)
    planner = Planner(ik=IK, profile=PANDA.profile, branch_choice=few)
    here = ARM.pose(ARM.home)
    good, far = shifted(here, np.array([0.0, 0.0, -0.1])), shifted(here, np.array([0.6, 0.0, -0.1]))
    chain = [
        Waypoint(name="pre-grasp", target=here),
        line("grasp", good),
        line("pull", far),
        Waypoint(name="home", target=Place.HOME),
    ]
    message = r"Waypoint 'pull' cannot be planned: none of \d configurations of 'pre-grasp' leads"
    with pytest.raises(PlanError, match=message) as caught:
        planner.plan_chain(ARM, chain, ARM.home, DT)
    assert caught.value.waypoint == "pull"
    assert "pull: the path fails" in caught.value.explanation
    with pytest.raises(PlanError, match="Waypoint 'pull'"):
        planner.plan(ARM, replace(chain[0], onward=(chain[1], chain[2])), ARM.home, DT)
    lost = Waypoint(name="lost", target=SE3.from_translation(np.array([3.0, 0.0, 0.0])))
    with pytest.raises(PlanError, match=r"Waypoint 'lost' cannot be planned: .* beyond the reach"):
        planner.plan_chain(ARM, [chain[0], lost, *chain[1:]], ARM.home, DT)


def test_the_sequence_of_least_cost_is_taken() -> None:
    """Against every sequence of the same branches, counted one by one."""
    rng = np.random.default_rng(4)
    chain = BranchChoice(candidates=4, restarts=60)
    lin, v_max = Lin(), PANDA.profile.v_max
    targets = [ARM.pose(rng.uniform(0.6 * ARM.q_min, 0.6 * ARM.q_max)) for _ in range(3)]
    waypoints = [Waypoint(name=f"{i}", target=target) for i, target in enumerate(targets)]
    layers = [chain.answers(ARM, IK, waypoint, ARM.home) for waypoint in waypoints]
    assert all(len(layer) >= 3 for layer in layers)

    def cost(sequence: list[IkResult]) -> float:
        total, before = 0.0, ARM.home
        for result in sequence:
            total += float(np.max(np.abs(result.q - before) / v_max))
            room = np.minimum(result.q - ARM.q_min, ARM.q_max - result.q)
            total += chain.crowding * (1 - float((room / (0.5 * (ARM.q_max - ARM.q_min))).min()))
            before = result.q
        return total

    every = [cost([a, b, c]) for a in layers[0] for b in layers[1] for c in layers[2]]
    chosen = chain.choose(ARM, IK, lin, waypoints, ARM.home, v_max)
    assert cost(chosen) == pytest.approx(min(every), rel=1e-12)
    assert min(every) < np.median(every)


def test_a_chain_may_begin_with_a_line_and_may_be_empty() -> None:
    planner = Planner(ik=IK, profile=PANDA.profile)
    assert planner.plan_chain(ARM, [], ARM.home, DT) == []
    here = ARM.pose(ARM.home)
    down = line("down", shifted(here, np.array([0.0, 0.0, 0.1])))
    legs = planner.plan_chain(ARM, [down, line("up", here)], ARM.home, DT)
    assert legs[0].trajectory.q[0].tolist() == ARM.home.tolist()
    assert max(ARM.pose_distance(here, legs[1].trajectory.end.q)) < 1.1e-6


def test_only_straight_motions_can_be_foreseen() -> None:
    bent = Waypoint(name="elsewhere", target=Place.HOME)
    message = r"what follows waypoint 'start' must be .* LIN or CIRC; found \['elsewhere"
    with pytest.raises(InvalidValueError, match=message):
        Waypoint(name="start", target=Place.HOME, onward=(bent,))


class Nowhere(Collisions):
    """Takes everything for touched."""

    def at(self, q: Vector) -> tuple[str, str, str, float] | None:
        return "hand", "table", "joint1", -1e-3


def test_where_every_configuration_is_touched_the_choice_is_left_to_the_planner() -> None:
    arm, ik, target = Arm(PANDA), MultiStart(solver=LmIk()), tool_down([0.5, 0.1, 0.3])
    waypoints, v_max = [Waypoint(name="there", target=target)], PANDA.profile.v_max
    nowhere = Nowhere(PANDA, lambda _: None, clearance=0.005)
    chosen = [
        chain.choose(arm, ik, Lin(), waypoints, arm.home, v_max)[0].q.tolist()
        for chain in (BranchChoice(), BranchChoice(collisions=nowhere))
    ]
    assert chosen[0] == chosen[1]


@dataclass(frozen=True, kw_only=True, eq=False)
class Given(BranchChoice):
    """Has branches of certain room."""

    rooms: tuple[float, ...]
    near_home: float | None = None
    """Room of the one near home."""

    def _usual(
        self, arm: Arm, ik: IkSolver, lin: Lin, waypoint: Waypoint, q_start: Vector
    ) -> Branch | None:
        if self.near_home is None:
            return None
        near = replace(self, rooms=(self.near_home,))._starts(arm, ik, lin, waypoint, q_start)
        return self.followed(arm, ik, lin, near[0], waypoint.onward)

    def _starts(
        self, arm: Arm, ik: IkSolver, lin: Lin, first: Waypoint, q_start: Vector
    ) -> list[IkResult]:
        here = IK.solve(arm, arm.pose(arm.home), arm.home)
        return [replace(here, q=here.q + r) for r in self.rooms]

    def followed(
        self,
        arm: Arm,
        ik: IkSolver,
        lin: Lin,
        start: IkResult,
        lines: Sequence[Waypoint],
    ) -> Branch:
        room = float((start.q - IK.solve(arm, arm.pose(arm.home), arm.home).q)[0])
        return Branch(results=(start,), room=room)


@pytest.mark.parametrize(
    ("near_home", "order"),
    [
        (None, [0.5, 0.015, 0.01, 0.001]),
        (0.012, [0.5, 0.015, 0.012, 0.01, 0.001]),
        (0.03, [0.03, 0.5, 0.015, 0.01, 0.001]),
    ],
)
def test_cramped_configurations_come_last_the_roomiest_of_them_first(
    near_home: float | None, order: list[float]
) -> None:
    """The one near home comes first, if it has room."""
    given = Given(rooms=(0.001, 0.5, 0.015, 0.01), near_home=near_home)
    onward = (line("line", ARM.pose(ARM.home)),)
    waypoint = Waypoint(name="it", target=Place.HOME, onward=onward)
    found = [one.q for one in given.candidates_for(ARM, IK, Lin(), waypoint, ARM.home)]
    home = IK.solve(ARM, ARM.pose(ARM.home), ARM.home).q
    assert [float((q - home)[0]) for q in found] == pytest.approx(order)


def test_the_way_along_lines_is_part_of_the_cost() -> None:
    chain, v_max = BranchChoice(candidates=4, restarts=30, crowding=0.0), PANDA.profile.v_max
    rng = np.random.default_rng(42)
    start = ARM.pose(rng.uniform(0.5 * ARM.q_min, 0.5 * ARM.q_max))
    run = [
        Waypoint(name="start", target=start),
        line("line", shifted(start, 0.1 * rng.normal(size=3))),
    ]
    ways, costs, firsts = list[float](), list[float](), list[list[float]]()
    for answer in chain.answers(ARM, IK, run[0], ARM.home):
        try:
            one, other = chain.followed(ARM, IK, Lin(), answer, run[1:]).results
        except PlanError:
            continue
        ways.append(float((np.abs(one.q - ARM.home) / v_max).max()))
        costs.append(ways[-1] + float((np.abs(other.q - one.q) / v_max).max()))
        firsts.append(one.q.tolist())
    assert np.argmin(costs) != np.argmin(ways)
    chosen = chain.choose(ARM, IK, Lin(), run, ARM.home, v_max)
    assert chosen[0].q.tolist() == firsts[int(np.argmin(costs))]
