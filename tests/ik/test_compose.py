"""Objectives, limits, constraints and demands of a user, through MinkIk and MultiStart."""

from collections.abc import Callable, Sequence
from typing import Any

import mink
import numpy as np
import pytest
from mink import SE3
from mink.limits import Constraint
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.ik.damping import Damping
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.objectives import Objective
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import Reason, Tolerance
from robo47_qp.ik.tool_demand import FULL, POSITION, Direction, FreeAxis, ToolDemand
from robo47_qp.ik.tool_error import error_to
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from tests.examples import turned

ARM = Arm(PANDA)
DEMANDS: list[ToolDemand] = [FULL, FreeAxis(), FreeAxis((1.0, 2.0, 0.5)), Direction(), POSITION]
EACH = pytest.mark.parametrize("demand", DEMANDS, ids=repr)


def several(**composition: Any) -> MultiStart:
    return MultiStart(solver=MinkIk(max_iterations=30, stall=Stall(), **composition))


def somewhere(rng: np.random.Generator, inner: float = 0.1) -> Vector:
    span = ARM.q_max - ARM.q_min
    q: Vector = rng.uniform(ARM.q_min + inner * span, ARM.q_max - inner * span)
    return q


def left(demand: ToolDemand, q: Vector, target: SE3) -> tuple[float, float]:
    """What is left of a demand, by scipy's rotations: metres and radians."""
    now = ARM.pose(q)
    away = float(np.linalg.norm(target.translation() - now.translation()))
    R, R_target = (Rotation.from_matrix(pose.rotation().as_matrix()) for pose in (now, target))
    if isinstance(demand, FreeAxis):
        a, b = R.apply(demand.axis), R_target.apply(demand.axis)
        angle = float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
        return (away if demand.position else 0.0), angle
    return away, 0.0 if demand == POSITION else float((R.inv() * R_target).magnitude())


# Demands ----------------------------------------------------------------------------------------


@EACH
def test_what_is_left_is_what_is_asked_for(demand: ToolDemand) -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        q, target = somewhere(rng), ARM.pose(somewhere(rng))
        expected = left(demand, q, target)
        assert demand.distance(ARM, target, q) == pytest.approx(expected, abs=1e-9)
        error = error_to(ARM, (0,), None, demand)
        error.set_target(target)
        assert np.sqrt(error.move(q)) == pytest.approx(expected, abs=1e-9)


@EACH
def test_errors_fall_by_their_jacobians_near_the_target(demand: ToolDemand) -> None:
    rng = np.random.default_rng(2)
    for _ in range(10):
        q = somewhere(rng)
        dq = 1e-5 * rng.standard_normal(ARM.n)
        target = turned(ARM.pose(q + dq), 2, 0.0)
        e, J = demand.error(ARM, target, q), demand.jacobian(ARM, target, q)
        assert e == pytest.approx(J @ dq, abs=1e-8)
        error = error_to(ARM, (0,), None, demand)
        error.set_target(target)
        error.move(q)
        error.update_jacobian()
        assert error.e == pytest.approx(error.J @ dq, abs=1e-8)


@EACH
def test_the_nearest_pose_is_as_good_as_the_goal_and_no_other_is_nearer(
    demand: ToolDemand,
) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        q = somewhere(rng)
        start, goal = ARM.pose(q), ARM.pose(somewhere(rng))
        near = demand.nearest(start, goal)
        distance, angle = left(demand, q, near)
        assert (distance, angle) == pytest.approx(left(demand, q, goal), abs=1e-9)
        turn = (start.rotation().inverse() @ near.rotation()).log()
        # All turning that is left is asked for.
        assert np.linalg.norm(turn) == pytest.approx(angle, abs=1e-7)


@pytest.mark.parametrize("demand", DEMANDS[1:], ids=repr)
@pytest.mark.parametrize("kind", [MinkIk, LmIk])
def test_demands_are_reached_from_afar(demand: ToolDemand, kind: type[MinkIk | LmIk]) -> None:
    rng = np.random.default_rng(4)
    ik = MultiStart(
        solver=kind(max_iterations=30, stall=Stall(), tolerance=Tolerance(demand=demand))
    )
    for _ in range(20):
        target = ARM.pose(somewhere(rng, 0.0))
        result = ik.solve(ARM, target, ARM.home)
        assert result.converged, result.explanation
        assert max(left(demand, result.q, target)) < 1.1e-6
        assert (result.q >= ARM.q_min).all()
        assert (result.q <= ARM.q_max).all()


def test_a_free_axis_is_half_a_turn_away_at_most() -> None:
    """Opposite directions are no place to rest."""
    pose = ARM.pose(ARM.home)
    demand = FreeAxis()
    for axis in (0, 1):
        target = turned(pose, axis, np.pi)
        assert demand.distance(ARM, target, ARM.home)[1] == pytest.approx(np.pi)
        tolerance = Tolerance(demand=demand)
        step = MinkIk(max_iterations=1, tolerance=tolerance).solve(ARM, target, ARM.home)
        assert np.abs(step.q - ARM.home).max() > 0.1


def test_seeds_are_the_nearest_of_what_is_asked_for() -> None:
    """A target whose turn about its axis no seed has is found as fast as any other."""
    rng = np.random.default_rng(5)
    ik = several(tolerance=Tolerance(demand=FreeAxis()))
    restarts = []
    for _ in range(40):
        target = turned(ARM.pose(somewhere(rng)), 2, rng.uniform(-np.pi, np.pi))
        result = ik.solve(ARM, target, ARM.q_min)
        assert result.converged
        restarts.append(result.restarts)
    assert np.mean(restarts) < 1.5


def test_reasons_speak_of_what_is_asked_for() -> None:
    far = SE3.from_translation(np.array([0.0, 0.0, 3.0]))
    asked = Tolerance(demand=POSITION)
    assert several(tolerance=asked).solve(ARM, far, ARM.home).reason is Reason.OUT_OF_REACH
    pointing = several(tolerance=Tolerance(demand=Direction())).solve(ARM, far, ARM.home)
    assert pointing.converged


def test_a_solver_of_whole_poses_refuses_other_demands() -> None:
    with pytest.raises(InvalidValueError, match="demand must be FULL with"):
        QpIk(tolerance=Tolerance(demand=POSITION))


@pytest.mark.parametrize("demand", [FreeAxis(), Direction(), POSITION])
def test_dls_reaches_what_is_demanded_by_the_step_that_lm_takes(demand: ToolDemand) -> None:
    rng = np.random.default_rng(6)
    asked, law = Tolerance(demand=demand), Damping(constant=0.1)
    reached = 0
    for _ in range(8):
        target = ARM.pose(np.clip(ARM.home + rng.uniform(-0.6, 0.6, 7), ARM.q_min, ARM.q_max))
        dls = DlsIk(tolerance=asked, clip=False, damping=law, max_iterations=1)
        lm = LmIk(tolerance=asked, within_limits=False, damping=law, max_iterations=1)
        a, b = (one.solve(ARM, target, ARM.home).q for one in (dls, lm))
        np.testing.assert_allclose(a, b, atol=1e-5)
        found = DlsIk(tolerance=asked).solve(ARM, target, ARM.home)
        reached += found.converged
        if found.converged:
            assert max(demand.distance(ARM, target, found.q)) < 1.1e-6
    assert reached >= 6


# Objectives -------------------------------------------------------------------------------------


def elbow_at(q_wanted: Vector, **options: Any) -> mink.PostureTask:
    task = mink.PostureTask(ARM.model, cost=1.0)
    task.set_target(q_wanted)
    return task


def best_by_brute_force(
    target: SE3, q: Vector, value: Callable[[Vector], float], demand: ToolDemand
) -> float:
    """The least value on the pose, near q: scipy's SLSQP with the pose as an equality."""
    rows = np.abs(demand.jacobian(ARM, target, q)).max(axis=1) > 1e-12
    found = minimize(
        value,
        q,
        constraints={"type": "eq", "fun": lambda x: demand.error(ARM, target, x)[rows]},
        bounds=list(zip(ARM.q_min, ARM.q_max, strict=True)),
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 300},
    )
    assert max(demand.distance(ARM, target, found.x)) < 1e-5
    return float(found.fun)


@pytest.mark.parametrize("demand", [FULL, FreeAxis()], ids=repr)
def test_a_lasting_objective_is_at_its_best_and_does_not_spoil_the_pose(
    demand: ToolDemand,
) -> None:
    rng = np.random.default_rng(6)
    moved = 0
    for _ in range(6):
        q, q_wanted = somewhere(rng, 0.2), somewhere(rng, 0.2)
        target = ARM.pose(q)
        plain = MinkIk(tolerance=Tolerance(demand=demand))
        ik = plain.composed([elbow_at(q_wanted)])
        result = ik.solve(ARM, target, q)
        assert result.converged
        assert max(left(demand, result.q, target)) < 1e-6

        def value(x: Vector, q_wanted: Vector = q_wanted) -> float:
            return 0.5 * float((x - q_wanted) @ (x - q_wanted))

        best = best_by_brute_force(target, result.q, value, demand)
        assert value(result.q) <= best + 1e-6
        moved += value(q) > value(result.q) + 0.1
    assert moved >= 3


def test_along_the_whole_null_space_no_configuration_nearby_is_better() -> None:
    """The self-motion of the Panda, followed by small steps of an integrator, both ways."""
    rng = np.random.default_rng(7)
    q, q_wanted = somewhere(rng, 0.25), somewhere(rng, 0.25)
    target = ARM.pose(q)
    result = MinkIk(objectives=[elbow_at(q_wanted)]).solve(ARM, target, q)
    assert result.converged
    least = float(np.sum((result.q - q_wanted) ** 2))
    for sign in (-1.0, 1.0):
        x, way = result.q.copy(), sign * np.linalg.svd(ARM.jacobian(result.q))[2][-1]
        for _ in range(100):
            free = np.linalg.svd(ARM.jacobian(x))[2][-1]
            way = free * np.sign(free @ way)
            x = x + 2e-3 * way
            for _ in range(3):
                x = x + np.linalg.lstsq(ARM.jacobian(x), ARM.pose_error(target, x))[0]
            if not ((x >= ARM.q_min) & (x <= ARM.q_max)).all():
                break
            assert np.sum((x - q_wanted) ** 2) >= least - 1e-9


def test_levels_do_not_spoil_those_before() -> None:
    """Pointing at priority 1 is exact, and a posture at priority 2 gets what is left."""
    rng = np.random.default_rng(8)
    for _ in range(4):
        q = somewhere(rng, 0.25)
        target = ARM.pose(q)
        first, second = somewhere(rng, 0.25), somewhere(rng, 0.25)
        asked = Tolerance(demand=POSITION)
        one = mink.PostureTask(ARM.model, cost=[1.0, 1.0, 0, 0, 0, 0, 0])
        one.set_target(first)
        alone = MinkIk(tolerance=asked, objectives=[one]).solve(ARM, target, q)
        both = MinkIk(
            tolerance=asked, objectives=[Objective(one, 1), Objective(elbow_at(second), 2)]
        ).solve(ARM, target, q)
        assert alone.converged
        assert both.converged
        far = [np.sum((result.q - first)[:2] ** 2) for result in (alone, both)]
        assert far[1] <= far[0] + 1e-5
        assert np.sum((both.q - second) ** 2) <= np.sum((alone.q - second) ** 2) + 1e-5


def tasks() -> dict[str, Callable[[Arm], Any]]:
    """mink's own, each with a target that the arm can be at together with a pose."""

    def relative(arm: Arm) -> mink.RelativeFrameTask:
        task = mink.RelativeFrameTask("hand", "body", "link4", "body", 1.0, 0.0)
        task.set_target_from_configuration(mink.Configuration(arm.model, q=arm.home))
        return task

    def com(arm: Arm) -> mink.ComTask:
        task = mink.ComTask(cost=1.0)
        task.set_target_from_configuration(mink.Configuration(arm.model, q=arm.home))
        return task

    def looking(arm: Arm) -> mink.LookAtTask:
        task = mink.LookAtTask("link4", "body", axis=(1.0, 0.0, 0.0))
        task.set_target(np.array([1.0, 0.0, 0.5]))
        return task

    def upright(arm: Arm) -> mink.AxisAlignTask:
        task = mink.AxisAlignTask("link4", "body", axis=(0.0, 0.0, 1.0))
        task.set_target(np.array([0.0, 1.0, 0.0]))
        return task

    def posture(arm: Arm) -> mink.PostureTask:
        task = mink.PostureTask(arm.model, cost=1.0)
        task.set_target(arm.home)
        return task

    def energy(_: Arm) -> mink.KineticEnergyRegularizationTask:
        task = mink.KineticEnergyRegularizationTask(1.0)
        task.set_dt(1.0)
        return task

    return {
        "relative": relative,
        "com": com,
        "look at": looking,
        "axis": upright,
        "posture": posture,
        "damping": lambda arm: mink.DampingTask(arm.model, 1.0),
        "energy": energy,
    }


@pytest.mark.parametrize("name", tasks())
@pytest.mark.parametrize("priority", [0, 1])
def test_each_task_of_mink_runs(name: str, priority: int) -> None:
    make = tasks()[name]
    rng = np.random.default_rng(9)
    objective = Objective(make, priority)
    for _ in range(3):
        q = somewhere(rng, 0.2)
        target = ARM.pose(q)
        plain = MinkIk().solve(ARM, target, q + 0.05)
        result = MinkIk(objectives=[objective]).solve(ARM, target, q + 0.05)
        if priority:
            assert result.converged, result.explanation
            task = make(ARM)
            if isinstance(task, mink.Task):
                before, after = (
                    float(
                        np.linalg.norm(
                            task.cost * task.compute_error(mink.Configuration(ARM.model, q=x))
                        )
                    )
                    for x in (plain.q, result.q)
                )
                assert after <= before + 1e-6
        elif not result.converged:
            assert result.explanation


def test_objectives_that_pull_at_the_same_priority_are_named() -> None:
    ik = several(objectives=[Objective(elbow_at(ARM.home + 0.3), priority=0)])
    result = ik.solve(ARM, ARM.pose(ARM.home - 0.2), ARM.home)
    assert result.reason is not None
    assert "PostureTask (error" in result.explanation
    assert "which pulls at the same priority" in result.explanation


def test_an_objective_with_a_tolerance_has_to_be_reached() -> None:
    rng = np.random.default_rng(10)
    q = somewhere(rng, 0.3)

    class Third(mink.Task):
        """The third joint, at an angle."""

        def __init__(self, angle: float) -> None:
            super().__init__(np.ones(1))
            self.angle = angle

        def compute_error(self, configuration: mink.Configuration) -> Vector:
            return np.array([configuration.q[2] - self.angle])

        def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
            return np.eye(1, 7, 2)

    reached = several(objectives=[Objective(Third(q[2]), 1, 1e-6)]).solve(
        ARM, ARM.pose(q), ARM.home
    )
    assert reached.converged, reached.explanation
    assert reached.q[2] == pytest.approx(q[2], abs=1e-6)
    # Within its tolerance it counts as reached, though another pulls it away.
    both = [Objective(Third(q[2] + off), 1, 0.2) for off in (0.1, -0.1)]
    near = several(objectives=both).solve(ARM, ARM.pose(q), ARM.home)
    assert near.converged, near.explanation
    assert abs(near.q[2] - q[2]) < 0.1
    alone = MinkIk(objectives=both, stall=None).solve(ARM, ARM.pose(q), near.q + 0.05)
    assert alone.converged
    assert alone.iterations < MinkIk().max_iterations
    impossible = several(objectives=[Objective(Third(9.0), 1, 1e-6)])
    result = impossible.solve(ARM, ARM.pose(q), ARM.home)
    assert result.reason is Reason.NOT_CONVERGED
    assert "the pose is reached, but not Third (error" in result.explanation


# Limits and constraints -------------------------------------------------------------------------


class HalfSpace(mink.Limit):
    """The elbow's joint stays above a value."""

    def __init__(self, joint: int, least: float) -> None:
        self.joint, self.least = joint, least

    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> Constraint:
        row = -np.eye(1, configuration.nv, self.joint)
        return Constraint(row, np.array([configuration.q[self.joint] - self.least]))


def test_a_limit_of_a_user_is_kept() -> None:
    rng = np.random.default_rng(11)
    ik = several(limits=[HalfSpace(0, 0.2)])
    kept = 0
    for _ in range(15):
        q = somewhere(rng)
        q[0] = abs(q[0]) + 0.25
        result = ik.solve(ARM, ARM.pose(np.minimum(q, ARM.q_max)), ARM.home)
        if result.converged:
            kept += 1
            assert result.q[0] >= 0.2 - 1e-6
    assert kept >= 14


def test_a_limit_that_cannot_be_kept_is_counted_and_named() -> None:
    ik = MinkIk(limits=[HalfSpace(0, 9.0)])
    result = ik.solve(ARM, ARM.pose(ARM.home + 0.1), ARM.home)
    assert result.reason is Reason.NOT_CONVERGED
    assert "limit HalfSpace (violated by" in result.explanation
    assert dict(result.relaxed)["HalfSpace"] > 0


def test_a_constraint_is_met_exactly_or_named() -> None:
    rng = np.random.default_rng(12)
    q = somewhere(rng, 0.3)
    held = mink.FrameTask("link4", "body", 1.0, 0.0)
    held.set_target_from_configuration(mink.Configuration(ARM.model, q=q))

    class Height(mink.Task):
        """Of the elbow's body, in the world."""

        def __init__(self, height: float) -> None:
            super().__init__(np.ones(1))
            self.height = height

        def compute_error(self, configuration: mink.Configuration) -> Vector:
            pose = configuration.get_transform_frame_to_world("link4", "body")
            return pose.translation()[2:] - self.height

        def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
            pose = configuration.get_transform_frame_to_world("link4", "body")
            J = configuration.get_frame_jacobian("link4", "body")
            row: Matrix = (pose.rotation().as_matrix() @ J[:3])[2:]
            return row

    height = mink.Configuration(ARM.model, q=q).get_transform_frame_to_world("link4", "body")
    for asked, reachable in ((float(height.translation()[2]), True), (5.0, False)):
        ik = several(constraints=[Height(asked)])
        result = ik.solve(ARM, ARM.pose(q), q + 0.1)
        assert result.converged == reachable, result.explanation
        if reachable:
            at = mink.Configuration(ARM.model, q=result.q)
            assert abs(Height(asked).compute_error(at)[0]) < 1e-6
        else:
            assert "Height (error" in result.explanation


def test_frozen_joints_stay_at_the_seed_in_every_start() -> None:
    rng = np.random.default_rng(13)
    found = 0
    for _ in range(10):
        q = somewhere(rng)
        q_seed = ARM.home.copy()
        q_seed[2] = q[2]
        ik = several(frozen=["joint3"])
        result = ik.solve(ARM, ARM.pose(q), q_seed)
        assert result.q[2] == q_seed[2]
        found += result.converged
    assert found >= 9


def test_dear_joints_move_less() -> None:
    rng = np.random.default_rng(14)
    dear, plain = MinkIk(joint_cost=[10.0, 1, 1, 1, 1, 1, 1]), MinkIk()
    ways = []
    for _ in range(20):
        q = somewhere(rng, 0.3)
        target = ARM.pose(np.clip(q + rng.uniform(-0.3, 0.3, 7), ARM.q_min, ARM.q_max))
        ends = [ik.solve(ARM, target, q) for ik in (dear, plain)]
        if all(end.converged for end in ends):
            ways.append([abs(end.q[0] - q[0]) for end in ends])
    less, more = np.mean(ways, axis=0)
    assert len(ways) >= 15
    assert less < 0.6 * more


# Bad input --------------------------------------------------------------------------------------


class Rowless(mink.Limit):
    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> Constraint:
        return Constraint(np.zeros((0, configuration.nv)), np.zeros(0))


class Wide(Rowless):
    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> Constraint:
        return Constraint(np.zeros((1, 9)), np.zeros(1))


def with_cost(cost: Any) -> mink.Task:
    task = elbow_at(ARM.home)
    task.cost = np.asarray(cost, dtype=float)
    return task


@pytest.mark.parametrize(
    ("composition", "message"),
    [
        ({"objectives": [mink.FrameTask("nobody", "body", 1.0, 1.0)]}, "nobody"),
        ({"objectives": [mink.FrameTask("hand", "body", 1.0, 1.0)]}, "target"),
        ({"objectives": [with_cost([1.0, 2.0])]}, r"cost of PostureTask must be shape \(7,\)"),
        ({"objectives": [with_cost([np.nan] * 7)]}, "cost of PostureTask must be finite"),
        ({"objectives": [with_cost([-1.0] * 7)]}, "cost of PostureTask must be finite and not"),
        ({"objectives": ["hand"]}, "an objective must be"),
        ({"objectives": [lambda arm: mink.PostureTask(arm.model, [1.0, 2.0])]}, "an objective"),
        ({"objectives": [lambda arm: arm.model.body("nobody")]}, "nobody"),
        ({"limits": [Rowless()]}, "limit Rowless must be one with rows"),
        ({"limits": [Wide()]}, r"G and h of limit Wide must be \(k, 7\)"),
        ({"limits": [mink.VelocityLimit(ARM.model, {})]}, "limit VelocityLimit must be one with"),
        ({"limits": [elbow_at(ARM.home)]}, "a limit must be a mink.Limit"),
        ({"constraints": [Rowless()]}, "a constraint must be a mink.Task"),
        ({"joint_cost": [1.0]}, "joint_cost must be 7 finite numbers above 0"),
        ({"joint_cost": [np.nan] * 7}, "joint_cost must be 7 finite numbers above 0"),
        ({"objectives": "hand"}, "objectives must be a list"),
        (
            {"objectives": [Objective(elbow_at(ARM.home), tolerance=1.0)], "frozen": "joint1"},
            "frozen",
        ),
    ],
)
def test_bad_input_is_one_message(composition: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        MinkIk(**composition).solve(ARM, ARM.pose(ARM.home + 0.1), ARM.home)


def test_a_joint_that_is_not_there_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="No joint is called 'elbow'; known: joint1"):
        MinkIk(frozen=["elbow"]).solve(ARM, ARM.pose(ARM.home), ARM.home)


@pytest.mark.parametrize("values", [{"priority": -1}, {"tolerance": -1.0}, {"tolerance": np.nan}])
def test_objectives_are_checked(values: dict[str, Any]) -> None:
    with pytest.raises(InvalidValueError):
        Objective(elbow_at(ARM.home), **values)


def test_nan_from_a_task_on_the_way_is_a_result() -> None:
    class Broken(mink.Task):
        def __init__(self) -> None:
            super().__init__(np.ones(1))
            self.calls = 0

        def compute_error(self, configuration: mink.Configuration) -> Vector:
            self.calls += 1
            return np.array([np.nan if self.calls > 3 else 0.0])

        def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
            return np.ones((1, configuration.nv))

    for priority in (0, 1):
        result = MinkIk(objectives=[Objective(Broken(), priority, 1.0)]).solve(
            ARM, ARM.pose(ARM.home + 0.2), ARM.home
        )
        assert result.reason is Reason.NOT_CONVERGED
        assert np.isfinite(result.q).all()


def test_the_same_question_has_the_same_answer_to_the_bit() -> None:
    def ask() -> Sequence[float]:
        ik = several(objectives=[tasks()["com"]], tolerance=Tolerance(demand=FreeAxis()))
        arm = Arm(PANDA)
        found: list[float] = ik.solve(arm, arm.pose(arm.home + 0.3), arm.home).q.tolist()
        return found

    assert ask() == ask()
