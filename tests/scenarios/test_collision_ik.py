"""IK that keeps a clearance, judged by contacts of a model that the package did not make."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.collision.clearance import Clearance
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.avoidance import DistanceRows
from robo47_qp.ik.box_qp import box_qp
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.fused_step import FusedStepper, Linearised
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import IkResult, IkSolver, Reason
from robo47_qp.ik.tool_error import ToolError
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import tool_down
from scenarios import collision_ik as scenario
from tests.plain_arm import PlainArm
from tests.small_robots import at, cell

ASKED = 0.01
SINGLE: list[LmIk | QpIk] = [
    LmIk(max_iterations=20, stall=Stall(), clearance=ASKED),
    QpIk(max_iterations=30, stall=Stall(), clearance=ASKED),
]
EACH = pytest.mark.parametrize("single", SINGLE, ids=["lm", "qp"])


class Contacts:
    """Distances as MuJoCo's contacts: robot file and obstacles in one text."""

    def __init__(self, obstacles: tuple[Obstacle, ...]) -> None:
        spec = mujoco.MjSpec.from_file(str(PANDA.mjcf))
        for obstacle in obstacles:
            pose = obstacle.T_world_obstacle
            spec.worldbody.add_geom(
                type=getattr(mujoco.mjtGeom, f"mjGEOM_{obstacle.shape.name}"),
                size=[*obstacle.size, *(3 - len(obstacle.size)) * [1.0]],
                pos=pose.translation(),
                quat=pose.rotation().wxyz,
            )
        for geom in spec.geoms:
            geom.margin = 0.05
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.q = [int(self.model.joint(name).qposadr[0]) for name in PANDA.joints]

    def least(self, q: Vector) -> float:
        """Up to 0.1 m."""
        self.data.qpos[self.q] = q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        return float(np.min(self.data.contact.dist, initial=0.1))


@pytest.fixture(scope="module")
def crowded() -> Arm:
    return Arm(PANDA, obstacles=cell())


@pytest.fixture(scope="module")
def contacts() -> Contacts:
    return Contacts(cell())


@pytest.fixture(scope="module")
def plain() -> PlainArm:
    return PlainArm(PANDA)


def poses(arm: Arm, count: int, *, clear: bool) -> Iterator[SE3]:
    """Of configurations that keep the clearance, or do not."""
    rng, clearance = np.random.default_rng(6), arm.derived(Clearance, ASKED)
    while count:
        q = rng.uniform(arm.q_min, arm.q_max)
        if clearance.clear(q, ASKED) == clear:
            count -= 1
            yield arm.pose(q)


@EACH
def test_every_target_of_a_clear_configuration_is_reached_clear(
    crowded: Arm, contacts: Contacts, plain: PlainArm, single: IkSolver
) -> None:
    solver, least = MultiStart(solver=single), np.inf
    for target in poses(crowded, 150, clear=True):
        result = solver.solve(crowded, target, crowded.home)
        assert result.converged, result.explanation
        position, angle = plain.errors(result.q, target)
        assert max(position, angle) < 1.01e-6
        assert plain.inside(result.q)
        judged = contacts.least(result.q)
        assert result.clearance is not None
        assert min(result.clearance, 0.1) == pytest.approx(judged, abs=1e-6)
        least = min(least, judged)
    # It is what was asked for, and the answers do make use of the room.
    assert ASKED - 1e-7 <= least < 0.02


def test_dls_avoids_nothing_and_is_refused_where_it_ends_too_close(
    crowded: Arm, contacts: Contacts
) -> None:
    """Its steps are the same; restarts find another answer, where there is one."""
    free, looked_at = DlsIk(), DlsIk(clearance=ASKED)
    again = MultiStart(solver=looked_at, max_restarts=10)
    refused, saved = 0, 0
    for target in poses(crowded, 50, clear=False):
        plain = free.solve(crowded, target, crowded.home)
        result = looked_at.solve(crowded, target, crowded.home)
        assert result.q.tolist() == plain.q.tolist()
        if not plain.converged:
            assert (result.reason, result.clearance) == (plain.reason, None)
            continue
        least = contacts.least(result.q)
        assert result.reason is (Reason.COLLISION if least < ASKED else None)
        if least < ASKED and not result.inevitable and refused < 8:
            other = again.solve(crowded, target, crowded.home)
            assert not other.converged or contacts.least(other.q) >= ASKED - 1e-7
            refused, saved = refused + 1, saved + other.converged
    assert refused > saved >= 1


@EACH
def test_without_a_clearance_the_arm_goes_through_things(
    crowded: Arm, contacts: Contacts, single: LmIk | QpIk
) -> None:
    free = replace(single, clearance=None)
    through = 0
    for target in poses(crowded, 150, clear=True):
        result = MultiStart(solver=free).solve(crowded, target, crowded.home)
        assert result.converged
        assert result.clearance is None
        assert result.pair is None
        through += contacts.least(result.q) < ASKED
    assert through > 3


@EACH
def test_no_answer_is_too_close_wherever_the_target(
    crowded: Arm, contacts: Contacts, single: IkSolver
) -> None:
    """Targets whose first configuration collides: some have another one, some have none."""
    solver = MultiStart(solver=single, max_restarts=15)
    reached, refused = 0, 0
    for target in poses(crowded, 60, clear=False):
        result = solver.solve(crowded, target, crowded.home)
        if result.converged:
            reached += 1
            assert contacts.least(result.q) >= ASKED - 1e-7
        elif result.reason is Reason.COLLISION:
            refused += 1
            _check_refusal(result, contacts)
    assert reached > 5
    assert refused > 10


def _check_refusal(result: IkResult, contacts: Contacts) -> None:
    assert result.clearance is not None
    assert result.pair is not None
    assert result.clearance < ASKED
    # A capsule that runs through a box escapes MuJoCo's contacts: see GeomDistance.
    assert contacts.least(result.q) < ASKED or result.clearance < -0.02
    assert "{} and {}".format(*result.pair) in result.explanation
    assert "10 mm are required" in result.explanation
    assert result.inevitable == ("whatever the joints" in result.explanation)


@EACH
def test_a_redundant_arm_moves_aside(crowded: Arm, contacts: Contacts, single: LmIk | QpIk) -> None:
    """One start: where the free answer collides, the rows find another one from the same start."""
    free = replace(single, clearance=None)
    rng, moved, tried = np.random.default_rng(9), 0, 0
    for target in [*poses(crowded, 150, clear=True)] * 4:
        q_seed = rng.uniform(crowded.q_min, crowded.q_max)
        plain = free.solve(crowded, target, q_seed)
        if not plain.converged or contacts.least(plain.q) >= ASKED:
            continue
        tried += 1
        kept = single.solve(crowded, target, q_seed)
        moved += kept.converged
        assert kept.iterations > plain.iterations
        if kept.converged:
            assert contacts.least(kept.q) >= ASKED - 1e-7
    assert tried > 10
    assert moved > 0.15 * tried


def test_a_tool_inside_an_obstacle_is_told_at_once(crowded: Arm) -> None:
    solver = MultiStart(solver=SINGLE[0])
    result = solver.solve(crowded, tool_down([0.5, 0.1, -0.01]), crowded.home)
    assert result.reason is Reason.COLLISION
    assert result.inevitable
    assert result.restarts <= 3
    assert result.pair is not None
    assert result.pair[1] == "table"
    assert "overlap by" in result.explanation
    assert "whatever the joints" in result.explanation
    # 15 mm above the table, with fingers that end 5.6 mm or so before the tool point's plane.
    near = solver.solve(crowded, tool_down([0.5, 0.1, 0.012]), crowded.home)
    assert near.inevitable
    assert "mm apart" in near.explanation
    assert near.clearance == pytest.approx(0.012 - 0.009, abs=1e-3)
    fine = solver.solve(crowded, tool_down([0.5, 0.1, 0.03]), crowded.home)
    assert fine.converged


def test_zero_clearance_allows_touching_and_no_overlap(crowded: Arm) -> None:
    touching = MultiStart(solver=LmIk(max_iterations=20, stall=Stall(), clearance=0.0))
    result = touching.solve(crowded, tool_down([0.5, 0.1, 0.012]), crowded.home)
    assert result.converged
    assert result.clearance is not None
    assert 0.0 <= result.clearance < ASKED


def test_a_larger_clearance_is_kept_too(contacts: Contacts, crowded: Arm) -> None:
    wide = MultiStart(solver=LmIk(max_iterations=20, stall=Stall(), clearance=0.015))
    reached = [
        wide.solve(crowded, target, crowded.home) for target in poses(crowded, 25, clear=True)
    ]
    answers = [contacts.least(result.q) for result in reached if result.converged]
    assert len(answers) > 12
    assert min(answers) >= 0.015 - 1e-7


def test_beyond_what_the_arm_can_give_the_pairs_left_out_are_named(
    contacts: Contacts, crowded: Arm
) -> None:
    """Wrist and hand of the Panda are 15.8 mm apart at home, by MuJoCo's contacts too."""
    assert contacts.least(crowded.home) == pytest.approx(0.01575, abs=1e-4)
    close = Clearance(crowded, 0.015).pairs.left_out
    assert {out.reason for out in close} == {"excluded by the model"}
    left_out = Clearance(crowded, 0.04).pairs.left_out
    assert "neighbours, 15.8 mm apart at home" in {out.reason for out in left_out}


@EACH
def test_the_same_question_has_the_same_answer_to_the_bit(crowded: Arm, single: IkSolver) -> None:
    solver = MultiStart(solver=single)
    again = Arm(PANDA, obstacles=cell())
    for target in poses(crowded, 6, clear=True):
        first, second = (solver.solve(arm, target, arm.home) for arm in (crowded, again))
        assert first.q.tobytes() == second.q.tobytes()
        assert first.clearance == second.clearance


def test_parting_gives_way_before_there_is_no_step() -> None:
    """Two walls that both ask to part by more than there is: the step keeps what there is."""
    arm = Arm(PANDA)
    stepper = FusedStepper(arm, _Along(np.ones(arm.n)), box_qp("daqp", arm.n))
    stepper._q_min, stepper._q_max = arm.home - 0.1, arm.home + 0.1
    stepper.move(arm.home)
    A = np.zeros((2, arm.n))
    A[:, 0] = 1.0, -1.0
    rows = DistanceRows(A, np.array([-0.05, -0.05]), np.array([-0.1, -0.1]), np.array([0, 1]))
    dq = stepper.step(arm.home, 0.0, rows)
    assert dq is not None
    assert dq == pytest.approx([0.0, *[0.1] * (arm.n - 1)], abs=1e-9)
    # Where they can part, they have to.
    alone = DistanceRows(A[:1], np.array([-0.05]), np.array([-0.1]), np.array([0]))
    dq = stepper.step(arm.home, 0.0, alone)
    assert dq is not None
    assert dq[0] == pytest.approx(-0.05, abs=1e-9)


@dataclass(frozen=True)
class _Along:
    """The joints are to move by this much (n,)."""

    step: Vector

    def linearised(self, error: ToolError, squared_error: float) -> Linearised:
        return Linearised(self.step, np.eye(len(self.step)), 0.0)


def test_a_narrow_gap_is_found_by_restarts() -> None:
    """Between two walls, 40 mm from the hand on either side."""
    walls = tuple(
        Obstacle(
            name=f"wall{side:+d}",
            shape=Shape.BOX,
            size=(0.15, 0.01, 0.15),
            T_world_obstacle=at(0.55, side * 0.16, 0.15),
        )
        for side in (-1, 1)
    )
    arm, contacts = Arm(PANDA, obstacles=walls), Contacts(walls)
    result = MultiStart(solver=SINGLE[0]).solve(arm, tool_down([0.55, 0.0, 0.1]), arm.home)
    assert result.converged
    assert contacts.least(result.q) >= ASKED - 1e-7


@pytest.mark.parametrize("kind", [LmIk, QpIk, DlsIk])
@pytest.mark.parametrize("clearance", [-0.01, np.nan, np.inf])
def test_a_clearance_that_is_none_is_refused(
    kind: type[LmIk | QpIk | DlsIk], clearance: float
) -> None:
    with pytest.raises(InvalidValueError, match="clearance must be 0 or more and finite"):
        kind(clearance=clearance)


@EACH
def test_of_answers_that_all_collide_the_one_with_most_room_is_told(
    crowded: Arm, single: LmIk | QpIk
) -> None:
    told = 0
    for target in poses(crowded, 40, clear=False):
        few = MultiStart(solver=single, max_restarts=3).solve(crowded, target, crowded.home)
        first = single.solve(crowded, target, crowded.home)
        if few.reason is first.reason is Reason.COLLISION and not few.inevitable:
            assert few.clearance is not None
            assert first.clearance is not None
            assert few.clearance >= first.clearance
            told += few.clearance > first.clearance
    assert told > 0


def test_what_was_not_measured_is_not_told() -> None:
    assert scenario._quantile([], 0.5) is None
    assert scenario._quantile([1.0, 3.0], 0.5) == 2.0
    assert (scenario._told(None, 2), scenario._told(0.5, 2)) == ("–", "0.50")
