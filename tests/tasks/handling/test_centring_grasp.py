"""An item that tips over easily is grasped by an arm that goes back from the first finger."""

from dataclasses import replace

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.evaluation.perturbation import PRESETS
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.run.contact_steps import Press
from robo47_qp.run.failure import Cause
from robo47_qp.run.runner import Runner
from robo47_qp.run.steps import Grasp, Wait
from robo47_qp.run.task import Program
from robo47_qp.run.watchdog import Watchdog
from robo47_qp.sim.sensed import Sensed, Senses
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.compliant_grasp import compliant_grasp
from robo47_qp.tasks.peg_insert.peg_insert import PegInsert
from tests.robots import robot_or_skip
from tests.run.bench import run_program
from tests.runs import no_objects

SEED = 90319
TURNED = SE3.from_rotation_and_translation(SO3.from_z_radians(0.7), np.array([0.4, 0.1, 0.2]))


class Hand(Sensed):
    """A hand at a pose, and what its fingers feel."""

    def __init__(self) -> None:
        simulation = Simulation(PANDA, no_objects)
        sheet = Senses(simulation).sensed.sheet
        erring = replace(sheet, noise={**sheet.noise, "pose_bias": 2e-3})
        super().__init__(PANDA, erring, simulation.objects)
        self.forces = np.zeros(2)

    def tool_pose(self, tool: int = 0) -> SE3:
        return TURNED

    def finger_forces(self, tool: int = 0) -> np.ndarray:
        return self.forces

    def width(self, tool: int = 0) -> float:
        return 0.08


def closing(hand: Hand) -> tuple[Press, Grasp]:
    grasp = Grasp(name="close gripper", force=20.0)
    around, goes, ends = compliant_grasp(hand, PegInsert().peg, SE3.identity(), grasp, tips=True)
    assert isinstance(around, Grasp)
    assert around.width > PegInsert().peg.size[0]
    assert isinstance(goes, Press)
    assert isinstance(ends, Grasp)
    *_, other = compliant_grasp(hand, PegInsert().peg, SE3.identity(), grasp)
    assert isinstance(other, Grasp)
    assert ends.speed == 0.5 * other.speed
    return goes, ends


@pytest.mark.parametrize(
    ("forces", "way"),
    [((0.0, 0.0), 0.0), ((0.2, 0.0), 1.0), ((0.0, 0.2), -1.0), ((9.0, 0.2), 0.0)],
)
def test_the_arm_goes_back_from_the_finger_that_touches_alone(
    forces: tuple[float, float], way: float
) -> None:
    """Faster than that finger closes; the first one is on the side of the tool's y."""
    hand = Hand()
    goes, ends = closing(hand)
    assert goes.meanwhile == Grip(width=ends.width, force=ends.force, speed=ends.speed)
    assert ends.compliance is None
    np.testing.assert_allclose(goes.axis, TURNED.rotation().as_matrix()[:, 1])
    hand.forces = np.array(forces)
    assert (goes.force - goes.felt()) / goes.damping == pytest.approx(way * ends.speed)
    assert goes.until is not None
    assert (goes.until.against() is None) == (min(forces) > 0.0)
    assert goes.until.cause is Cause.GRASP


@pytest.mark.parametrize("name", ["panda", "ur5e", "xarm7", "iiwa14", "panda_pair"])
def test_the_first_finger_is_on_the_side_of_the_tools_y(name: str) -> None:
    robot = panda_pair() if name == "panda_pair" else robot_or_skip(name)
    simulation = Simulation(robot, no_objects)
    for tool, gripper in enumerate(robot.grippers):
        y = simulation.tool_pose(tool).rotation().as_matrix()[:, 1]
        first, second = (simulation.data.body(finger).xpos for finger in gripper.fingers)
        assert y.dot(first - second) == pytest.approx(simulation.width(tool), abs=1e-3)


def test_the_fingers_close_while_a_tool_presses() -> None:
    """They are not waited for."""
    widths: list[float] = []

    def program(sensed: Sensed) -> Program:
        grip = Grip(width=0.02, force=20.0)
        up = np.array([0.0, 0.0, 1.0])
        yield Press(axis=up, force=0.0, felt=lambda: 0.0, seconds=0.1, meanwhile=grip)
        widths.append(sensed.width())
        yield Wait(name="wait", seconds=1.0)
        widths.append(sensed.width())
        return None

    run = run_program(program)
    assert run.failure is None
    assert 0.05 < widths[0] < 0.08
    assert widths[1] == pytest.approx(0.02, abs=1e-3)


def test_a_peg_that_a_compliant_arm_had_tipped_over_stands_between_the_fingers() -> None:
    """Joints rub so much that the arm would not give way."""
    episode = TaskEpisode(robot=PANDA, task=PegInsert(), perturbation=PRESETS["moderate"])
    scenario = replace(episode.scenario(SEED), watchdog=Watchdog(time_limit=24.0))
    run = Runner(scenario, episode.simulation(scenario, SEED)).run()
    starts = {phase.name: phase.start for phase in run.phases}
    R = SO3(run.rows["objects/peg"][starts["take up"], 3:]).as_matrix()
    assert np.degrees(np.arccos(R[2, 2])) < 1.0
