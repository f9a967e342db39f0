"""The audit of contacts and distances: made-up numbers, and a real collision."""

from dataclasses import dataclass, replace
from math import inf

import mujoco
import numpy as np
import pytest

from robo47_qp.arrays import Matrix
from robo47_qp.collision.closest_approach import ClosestApproach, Nearest
from robo47_qp.constants import TIMESTEP
from robo47_qp.model.obstacle import Obstacle, Shape, add_obstacle
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.collision_check import Collisions
from robo47_qp.report.audit.audit import _receding, audit
from robo47_qp.run.recording import Rows
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.report.audit.test_audit import broken, finding, with_value
from tests.runs import Reach, no_objects, picked_and_placed
from tests.small_robots import at

ROW = 700
WALL = Obstacle(name="wall", shape=Shape.BOX, size=(0.01, 1.0, 1.0), T_world_obstacle=at(0.9, 0, 1))


@pytest.fixture(scope="module")
def run() -> Run:
    return picked_and_placed()


def among(run: Run, *obstacles: Obstacle) -> Run:
    """The same run as if the task had declared obstacles that no planner looked at."""
    planner = replace(run.scenario.planner, collisions=None)
    scenario = replace(run.scenario, task=PickPlace(obstacles=obstacles), planner=planner)
    return replace(run, scenario=scenario)


@pytest.mark.parametrize(
    ("force", "kept"), [([0.0, 48.0, -36.0], True), ([0.0, 48.0, -36.001], False)]
)
def test_the_force_on_the_tool_is_held_to_that_of_the_task(
    run: Run, force: list[float], kept: bool
) -> None:
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows["contact/tool"][ROW] = force
    findings = audit(replace(run, rows=rows))
    assert broken(findings) == ([] if kept else ["tool contact"])
    found = finding(findings, "tool contact")
    assert (found.limit, found.unit, found.time) == (60.0, "N", ROW * TIMESTEP)
    assert found.extreme == pytest.approx(np.linalg.norm(force))


@pytest.mark.parametrize(("force", "kept"), [(10.0, True), (10.001, False)])
def test_the_hand_presses_less_on_what_stands_fixed(run: Run, force: float, kept: bool) -> None:
    findings = audit(with_value(run, "contact/fixed", ROW, 0, force))
    assert broken(findings) == ([] if kept else ["tool contact with what is fixed"])
    found = finding(findings, "tool contact with what is fixed")
    assert (found.limit, found.extreme, found.time) == (10.0, force, ROW * TIMESTEP)


def test_a_task_that_sets_no_limit_promises_none(run: Run) -> None:
    task = PickPlace(force_max=inf)
    findings = audit(replace(run, scenario=replace(run.scenario, task=task)))
    assert "tool contact" not in [found.signal for found in findings]


def test_links_touch_nothing_at_all(run: Run) -> None:
    findings = audit(with_value(run, "contact/links", ROW, 0, 1e-6))
    assert broken(findings) == ["link contact"]
    found = finding(findings, "link contact")
    assert (found.limit, found.extreme, found.time) == (0.0, 1e-6, ROW * TIMESTEP)
    assert str(found) == "link contact: 1e-06 N at 0.700 s, the limit is 0 N"


@pytest.mark.parametrize("joint", [1, 4])
def test_an_acceleration_beyond_what_the_arm_is_rated_for(run: Run, joint: int) -> None:
    limit = float(PANDA.rated.a_max[joint])
    findings = audit(with_value(run, "joints/a", ROW, joint, -1.001 * limit))
    assert broken(findings) == [f"measured a (joint{joint + 1})"]
    assert broken(audit(with_value(run, "joints/a", ROW, joint, -limit))) == []


def test_a_robot_inside_an_obstacle_is_found_where_and_when(run: Run) -> None:
    lowest = int(run.rows["tool/pose"][:, 2].argmin())
    tool = run.rows["tool/pose"][lowest, :3]
    ball = Obstacle(name="ball", shape=Shape.SPHERE, size=(0.03,), T_world_obstacle=at(*tool))
    findings = audit(among(run, ball))
    [reference, name] = broken(findings)
    assert reference.startswith("reference distance (")
    assert name.startswith("measured clearance (")
    assert name.endswith("finger to ball)")
    found = finding(findings, name)
    assert found.extreme < -0.005
    inside = np.linalg.norm(run.rows["tool/pose"][round(found.time / TIMESTEP), :3] - tool)
    assert inside < 0.03


@pytest.mark.parametrize(("clearance", "kept"), [(0.05, True), (0.5, False)])
def test_the_reference_is_held_to_the_clearance_of_the_planner(
    run: Run, clearance: float, kept: bool
) -> None:
    asked = among(run, WALL)
    collisions = Collisions(PANDA, no_objects, clearance=clearance)
    planner = replace(asked.scenario.planner, collisions=collisions)
    findings = audit(replace(asked, scenario=replace(asked.scenario, planner=planner)))
    found = next(found for found in findings if found.signal.startswith("reference clearance"))
    assert (found.limit, found.ok) == (clearance, kept)
    assert [name.split(" (")[0] for name in broken(findings)] == (
        [] if kept else ["reference clearance"]
    )


@dataclass(frozen=True, kw_only=True)
class Blocked(Reach):
    """Down onto a plate that the task declares and the planner does not look at."""

    rise: float = -0.06
    name: str = "blocked"

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        for obstacle in self.obstacles:
            add_obstacle(spec, obstacle)


def test_a_real_collision_breaks_promises_and_is_told(run: Run) -> None:
    tool = run.rows["tool/pose"][0, :3]
    plate = Obstacle(
        name="plate",
        shape=Shape.BOX,
        size=(0.1, 0.1, 0.01),
        T_world_obstacle=at(tool[0], tool[1], tool[2] - 0.045),
    )
    task = Blocked(obstacles=(plate,), force_max=5.0)
    scenario = ClassicalStack().scenario(PANDA, task)
    blind = replace(scenario.planner, collisions=None, detour=None)
    runner = Runner(replace(scenario, planner=blind), Simulation(PANDA, task.build_scene))
    hit = runner.run()
    findings = audit(hit)
    told = [name.split(" (")[0] for name in broken(findings)]
    # Whether it leaves its line before it is stopped is up to who watches the force.
    assert {"tool contact", "measured clearance"} <= set(told)
    found = finding(findings, "tool contact")
    force = hit.rows["contact/tool"][round(found.time / TIMESTEP)]
    # The plate pushes up.
    assert force[2] > 0.9 * np.linalg.norm(force) > 4.5
    assert next(f for f in findings if f.signal.endswith("to plate)")).extreme < 0.0
    assert finding(findings, "link contact").ok


def test_reference_and_robot_are_looked_at_apart(run: Run) -> None:
    asked = among(run, replace(WALL, T_world_obstacle=at(0.75, 0, 1)))
    planner = replace(asked.scenario.planner, collisions=Collisions(PANDA, no_objects, 0.01))
    asked = replace(asked, scenario=replace(asked.scenario, planner=planner))
    for signal, title in (("joints/q_ref", "reference"), ("joints/q", "measured")):
        # Shoulder and elbow stretched for a moment: through the wall.
        leaning = with_value(with_value(asked, signal, ROW, 1, 1.5), signal, ROW, 3, -0.1)
        told = [name for name in broken(audit(leaning)) if "clearance" in name]
        assert [name.split(" (")[0] for name in told] == [f"{title} clearance"]


class Depths(ClosestApproach):
    """Finds in each row the distance that its first joint stands for."""

    def __init__(self) -> None:
        pass

    def along(self, q: Matrix, *, resolution: float = 0.0) -> Nearest:
        return Nearest(float(q[0, 0]), 0, "hand", "table")


def test_after_a_touch_a_depth_is_excused_while_it_gets_smaller() -> None:
    depths = np.array([[-3.0], [-2.0], [-1.0], [-1.5], [-0.5], [1.0]])
    touches = np.array([True, False, False, False, False, False])
    assert _receding(Depths(), depths, touches).tolist() == [False, True, True, False, False, False]


def test_a_compliant_arm_is_not_excused_for_being_inside_what_is_fixed(run: Run) -> None:
    through = with_value(with_value(run, "joints/q", ROW, 1, 1.7), "joints/q", ROW, 3, -0.3)
    soft = replace(through, phases=[replace(phase, compliant=True) for phase in run.phases])
    told = [name.split(" (")[0] for name in broken(audit(soft))]
    assert "measured clearance, scene" in told
