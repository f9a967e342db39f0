"""Reaching among obstacles: it succeeds, and what goes wrong has its cause."""

from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.failure import Cause
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.reach.obstacle_reach import ObstacleReach
from robo47_qp.tasks.task_state import hide_marker
from tests.runs import Meddler, carry_out, live, make_runner

DETOURS = 2
"""A seed whose straight motions are blocked."""


def drawn(seed: int) -> ObstacleReach:
    return ObstacleReach().variant(np.random.default_rng([seed, 2]))


@cache
def undisturbed(seed: int | None = None) -> Run:
    task = ObstacleReach() if seed is None else drawn(seed)
    return carry_out(task, seed=seed)


@pytest.mark.parametrize("seed", [None, DETOURS])
def test_targets_are_held_and_nothing_is_touched(seed: int | None) -> None:
    run = undisturbed(seed)
    assert run.failure is None
    assert [found for found in audit(run) if not found.ok] == []
    assert not run.rows["contact/links"].any()
    assert not run.rows["contact/tool"].any()
    _, simulation = make_runner(run.scenario.task, seed=seed)
    ends = [phase.start for phase in run.phases[1:]] + [len(run.rows["time"])]
    held = 0
    for phase, end in zip(run.phases, ends, strict=True):
        if phase.name.startswith("hold "):
            held += 1
            target = simulation.marker_pose(phase.name.removeprefix("hold "))
            rows = run.rows["tool/pose"][phase.start + 100 : end]
            assert len(rows) >= 300
            assert np.linalg.norm(rows[:, :3] - target.translation(), axis=1).max() < 1e-3
            turns = [target.rotation().inverse() @ SO3(wxyz) for wxyz in rows[:, 3:]]
            assert max(np.linalg.norm(turn.log()) for turn in turns) < np.radians(0.5)
    assert held == 2
    assert run.measures["poses_left"] == 0.0
    assert np.abs(run.rows["joints/q"][-1] - PANDA.home).max() < 1e-3


def test_without_detours_the_same_seed_is_refused() -> None:
    task = drawn(DETOURS)
    scenario = ClassicalStack().scenario(PANDA, task, DETOURS)
    blocked = replace(scenario.planner, detour=None)
    simulation = Simulation(PANDA, task.build_scene)
    runner = Runner(replace(scenario, planner=blocked), simulation)
    failure = runner.run().failure
    assert failure is not None
    assert failure.cause is Cause.PLAN
    assert "come within" in failure.evidence


@pytest.mark.parametrize(
    ("away", "turn", "held"),
    [(0.9e-3, 0.0, True), (1.1e-3, 0.0, False), (0.0, 0.45, True), (0.0, 0.55, False)],
)
def test_near_is_not_there(away: float, turn: float, held: bool) -> None:
    task = ObstacleReach()
    simulation = Simulation(PANDA, task.build_scene)
    off = SE3.from_rotation_and_translation(
        SO3.from_x_radians(np.radians(turn)), np.array([0.0, away, 0.0])
    )
    simulation.place_marker("behind post", simulation.tool_pose() @ off)
    against = task._held.held(live(simulation), "behind post").against()
    assert against is not None
    words = "tells little of its speed yet" if held else "allowed are 1.00 mm, 0.50°"
    assert words in against


def test_a_target_that_moves_away_is_not_held() -> None:
    def move(simulation: Simulation) -> None:
        away = SE3.from_translation(np.array([0.0, 0.0, 2e-3]))
        simulation.place_marker("behind post", away @ simulation.marker_pose("behind post"))

    meddler = Meddler("hold behind post", move, after=0.1)
    run = carry_out(ObstacleReach(), observers=[meddler])
    assert meddler.done == 1
    assert run.failure is not None
    assert (run.failure.cause, run.failure.step) == (Cause.TRACK, "hold behind post")
    assert run.failure.evidence.startswith("the tool is 2.0")


def test_a_target_inside_the_post_is_refused_before_anything_moves() -> None:
    run = carry_out(ObstacleReach(behind=0.01))
    assert run.failure is not None
    assert run.failure.cause is Cause.IK
    assert "post" in run.failure.evidence
    assert not run.rows["joints/v_ref"].any()


@dataclass(frozen=True, kw_only=True)
class Walled(ObstacleReach):
    """With a bar that nobody declared in the way home."""

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        super().build_scene(spec)
        spec.worldbody.add_geom(
            name="bar",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.02, 0.02, 0.1],
            pos=[0.42, 0.0, 0.45],
        )


def test_an_obstacle_that_nobody_declared_is_hit_and_told() -> None:
    run = carry_out(Walled())
    assert run.failure is not None
    assert run.failure.cause is Cause.COLLISION


def test_the_end_is_judged_by_where_the_arm_is() -> None:
    task = ObstacleReach()
    _, simulation = make_runner(task)
    for target in ("behind post", "under shelf"):
        hide_marker(simulation, target)
    assert task.verdict(simulation) is None
    simulation.data.qpos[1] += 0.011
    failure = task.verdict(simulation)
    assert failure is not None
    assert failure.cause is Cause.PLACE
    assert failure.evidence == "a joint is 0.011 rad from home; allowed are 0.01 rad"


def test_variants_differ_and_stand_apart() -> None:
    for seed in range(50):
        task = drawn(seed)
        gap = np.linalg.norm(np.subtract(task.post, task.shelf))
        assert gap > task.post_radius + np.hypot(0.14, 0.18)
        assert np.hypot(*task.post) - task.post_radius > 0.3
    assert len({drawn(seed).post for seed in range(50)}) == 50


def test_dls_takes_another_answer_where_its_first_one_is_in_the_way() -> None:
    seed = 25
    task = drawn(seed)

    def carried_out(ik: str) -> Run:
        scenario = ClassicalStack(ik=ik).scenario(PANDA, task, seed)
        return Runner(scenario, Simulation(PANDA, task.build_scene)).run()

    alone = carried_out("dls-single")
    assert alone.failure is not None
    assert alone.failure.cause is Cause.IK
    assert "post" in alone.failure.evidence
    assert "10 mm are required" in alone.failure.evidence
    assert not alone.rows["joints/v_ref"].any()
    run = carried_out("dls")
    assert run.failure is None
    assert not run.rows["contact/links"].any()
    assert not run.rows["contact/tool"].any()


@pytest.mark.parametrize("name", ["post_radius", "shelf_height", "behind", "seconds", "force_max"])
def test_sizes_are_positive(name: str) -> None:
    with pytest.raises(InvalidValueError, match=f"{name} must be above 0 and finite; found 0.0"):
        replace(ObstacleReach(), **{name: 0.0})  # type: ignore[arg-type]


def test_places_are_finite() -> None:
    with pytest.raises(InvalidValueError, match=r"post must be two finite numbers.*nan"):
        ObstacleReach(post=(np.nan, 0.0))


def test_a_target_that_is_held_before_it_is_looked_at_counts() -> None:
    """Its marker is put away as the arm comes to rest."""
    task = ObstacleReach(seconds=0.02).variant(np.random.default_rng([113, 2]))
    assert carry_out(task, seed=113).failure is None
