"""Clearance is judged in every task, from all that stands fixed and between links of the robot."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mink import SE3

from robo47_qp.collision.closest_approach import ClosestApproach
from robo47_qp.constants import TIMESTEP
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.audit.finding import Finding
from robo47_qp.run.recording import Rows
from robo47_qp.run.scenario import Run
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.carry_tray.carry_tray import CarryTray
from robo47_qp.tasks.peg_insert.peg_insert import PegInsert
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from robo47_qp.tasks.sort.sort import Sort
from robo47_qp.tasks.table import TABLE
from robo47_qp.tasks.wipe.wipe import Wipe
from tests.runs import picked_and_placed

ROW = 700
DOWN = {1: 1.6, 3: -0.6}
"""Joints that take the forearm through the table."""
FOLDED = {1: -0.19, 2: 1.24, 3: -2.84, 4: 0.14, 5: 0.5}
"""Joints that fold the hand into the arm."""


@pytest.fixture(scope="module")
def run() -> Run:
    return picked_and_placed()


def bent(run: Run, signal: str, joints: dict[int, float], row: int = ROW) -> Run:
    rows = Rows(run.rows.signals, run.rows.values.copy())
    for joint, q in joints.items():
        rows[signal][row, joint] = q
    return replace(run, rows=rows)


def clearances(run: Run) -> list[Finding]:
    return [f for f in audit(run) if "clearance" in f.signal or "distance" in f.signal]


def test_a_task_without_declared_obstacles_is_judged_too(run: Run) -> None:
    assert not run.scenario.task.obstacles
    found = clearances(run)
    titles = ["reference distance", "measured clearance"]
    assert [f.signal.split(" (")[0] for f in found] == [*titles, *(f"{t}, scene" for t in titles)]
    assert all(f.ok and f.limit == 0.0 and not f.exempt and f.share == 1.0 for f in found)
    # The fingers come closest to the table at the grasp: 12 mm below the middle of a 40 mm cube.
    assert found[3].signal.endswith("finger to table)")
    assert 2e-3 < found[3].extreme < 0.02


@pytest.mark.parametrize(
    ("joints", "told"), [(DOWN, "to table)"), (FOLDED, "link")], ids=["table", "itself"]
)
@pytest.mark.parametrize(
    ("signal", "title"),
    [("joints/q", "measured clearance"), ("joints/q_ref", "reference distance")],
)
def test_an_arm_in_the_table_or_in_itself_breaks_it(
    run: Run, joints: dict[int, float], told: str, signal: str, title: str
) -> None:
    broken = [f for f in clearances(bent(run, signal, joints)) if not f.ok]
    assert [f.signal.split(" (")[0].removesuffix(", scene") for f in broken] == [title]
    assert told in broken[0].signal
    assert broken[0].extreme < -5e-3
    assert broken[0].time == ROW * TIMESTEP


def test_touching_exempts_no_more_rows_than_it_lasts_and_hides_nothing(run: Run) -> None:
    struck = bent(run, "joints/q", DOWN)
    struck.rows["contact/fixed"][ROW] = 2.0
    told = [f for f in clearances(struck) if f.signal.startswith("measured")]
    _, judged, exempt = told
    assert judged.ok
    assert judged.extreme > 0.0
    assert exempt.exempt
    assert exempt.extreme < -5e-3
    assert exempt.time == ROW * TIMESTEP
    assert judged.share + exempt.share == pytest.approx(1.0)
    assert exempt.share == pytest.approx(1.0 / len(run.rows))
    # So is a reference that presses, and nothing but this row of it.
    pressed = bent(struck, "joints/q_ref", DOWN)
    _, judged, exempt = [f for f in clearances(pressed) if f.signal.startswith("reference")]
    assert judged.ok
    assert exempt.exempt
    assert exempt.extreme < -5e-3
    assert exempt.share == pytest.approx(1.0 / len(run.rows))
    # A row beside it is judged.
    beside = bent(run, "joints/q", DOWN, ROW + 1)
    beside.rows["contact/fixed"][ROW] = 2.0
    assert not all(f.ok for f in clearances(beside))


def test_a_declared_obstacle_does_not_stand_for_another_of_its_name(run: Run) -> None:
    away = replace(TABLE, T_world_obstacle=SE3.from_translation(np.array([5.0, 0.0, 0.0])))
    task = PickPlace(obstacles=(away,))
    hidden = replace(run, scenario=replace(run.scenario, task=task))
    broken = [f.signal for f in clearances(bent(hidden, "joints/q", DOWN)) if not f.ok]
    assert len(broken) == 1
    assert broken[0].endswith("to table of the scene)")
    # The same table, declared as it is, is measured once.
    task = PickPlace(obstacles=(TABLE,))
    declared = replace(run, scenario=replace(run.scenario, task=task))
    assert not any("of the scene" in f.signal for f in clearances(declared))


def test_a_breach_is_found_however_small_it_is(run: Run) -> None:
    """One row of a hand that rests 10 µm from a wall."""
    rows = Rows(run.rows.signals, run.rows.values.copy())
    for signal in ("joints/q", "joints/q_ref", "gripper/fingers"):
        rows[signal][:] = rows[signal][0]
    rows["joints/q"][:, 1] += 0.05
    still = np.hstack([rows["joints/q"], rows["gripper/fingers"]])[:1]

    def wall(x: float) -> Obstacle:
        size, there = (0.1, 3.0, 3.0), SE3.from_translation(np.array([x, 0.0, 0.0]))
        return Obstacle(name="wall", shape=Shape.BOX, size=size, T_world_obstacle=there)

    beside = wall(2.0 - ClosestApproach(PANDA, (wall(2.0),)).along(still).distance + 10e-6)
    kept = replace(run, rows=rows, fixed=(beside,))
    assert [f.signal for f in clearances(kept) if not f.ok] == []
    rows["joints/q"][ROW, 1] += 1e-4
    (broken,) = (f for f in clearances(kept) if not f.ok)
    assert broken.signal.startswith("measured clearance, scene (")
    assert broken.time == ROW * TIMESTEP
    assert -50e-6 < broken.extreme < -10e-6


def test_what_stands_fixed_is_all_that_a_hand_can_hit() -> None:
    for task, names in (
        (Sort(), {"table", "floor", "red bin x0", "blue bin y1"}),
        (Wipe(), {"table", "floor", "board"}),
        (PegInsert(), {"table", "floor", "wall0", "wall15", "bottom"}),
    ):
        world = Simulation(PANDA, task.build_scene)
        task.reset(world, np.random.default_rng(3))
        found = {obstacle.name: obstacle for obstacle in world.fixed()}
        assert names <= set(found)
        assert not any("mark" in name or "seen" in name for name in found)
        for name, obstacle in found.items():
            geom = world.model.geom(name).id
            np.testing.assert_allclose(
                obstacle.T_world_obstacle.translation(), world.data.geom_xpos[geom], atol=1e-12
            )
    around = Simulation(PANDA, Wipe().build_scene).fixed()
    assert [one.shape for one in around if one.name == "board"] == [Shape.BOX]
    pair = Simulation(panda_pair(), CarryTray().build_scene)
    assert {one.name for one in pair.fixed()} == {"table", "floor", "wall"}


def test_a_post_that_carries_a_door_stands_fixed() -> None:
    def gate(spec: mujoco.MjSpec) -> None:
        box = mujoco.mjtGeom.mjGEOM_BOX
        post = spec.worldbody.add_body(name="post", pos=[0.5, 0.2, 0.2])
        post.add_geom(name="post", type=box, size=[0.02, 0.02, 0.2])
        door = post.add_body(name="door", pos=[0.1, 0.0, 0.0])
        door.add_joint(name="hinge", axis=[0, 0, 1])
        for name, body in (("leaf", door), ("knob", door.add_body()), ("cap", post.add_body())):
            body.add_geom(name=name, type=box, size=[0.01, 0.01, 0.01], mass=1)

    assert {one.name for one in Simulation(PANDA, gate).fixed()} == {"post", "cap"}


def test_what_a_robot_stands_on_is_its_own(tmp_path: Path) -> None:
    spec = mujoco.MjSpec.from_file(str(PANDA.mjcf))
    spec.worldbody.add_geom(name="pedestal", size=[0.1, 0.1, 0.1], pos=[0.0, 0.0, -0.1])
    spec.worldbody.geoms[-1].type = mujoco.mjtGeom.mjGEOM_BOX
    mjcf = tmp_path / "mounted.xml"
    mjcf.write_text(spec.to_xml(), encoding="utf-8")
    world = Simulation(replace(PANDA, mjcf=mjcf), Wipe().build_scene)
    assert world.model.geom("pedestal").id >= 0
    assert {one.name for one in world.fixed()} == {"table", "floor", "board"}


def test_fixed_bodies_of_a_run_are_those_of_its_world(run: Run) -> None:
    assert {one.name for one in run.fixed} == {"table", "floor"}
    assert all(isinstance(one, Obstacle) for one in run.fixed)


@pytest.mark.parametrize("signal", ["joints/q", "joints/q_ref", "contact/fixed", "joints/a"])
def test_what_is_not_a_number_keeps_no_promise(run: Run, signal: str) -> None:
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows[signal][ROW, 0] = np.nan
    assert not all(f.ok for f in audit(replace(run, rows=rows)))
