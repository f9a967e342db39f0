"""TouchSense: what is a contact, what is a sensor's drift or its zero, and what is a push."""

import numpy as np
import pytest

from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.run.touch_sense import TouchSense
from robo47_qp.sim.simulation import Simulation
from tests.runs import no_objects

ARM = Arm(PANDA)
PERIOD = 0.02


class Felt(Simulation):
    """A robot alone whose wrist feels what it is told to."""

    felt = np.zeros(3)

    def felt_force(self, tool: int = 0) -> np.ndarray:
        return self.felt


def touched(*spans: tuple[float, list[float]]) -> list[bool]:
    """Whether something is touched at the end of spans of time [s] with a force each [N]."""
    world, found, touches = Felt(PANDA, no_objects), list[bool](), False
    sense = TouchSense(world)
    for seconds, force in spans:
        world.felt = np.array(force)
        for _ in range(round(seconds / PERIOD)):
            touches = sense.touching(ARM, PERIOD)
        found.append(touches)
    return found


def test_a_force_is_a_contact_and_a_slow_change_is_drift() -> None:
    assert touched((0.1, [0, 0, 0.5]), (0.1, [0, 0, 5.0]), (0.1, [0, 0, 0.5])) == [0, 1, 0]
    slow = [(0.1, [0.0, 0.0, force]) for force in np.linspace(0.0, 8.0, 400)]
    assert not any(touched(*slow))


@pytest.mark.parametrize("push", [[7.0, -4.0, 0.0], [0.0, 0.0, -4.5]])
def test_a_push_at_the_start_is_no_zero(push: list[float]) -> None:
    """The sensor has drifted by 1 N, and what is touched later is felt from there."""
    pushed = [(0.2, list(np.add(push, [0, 0, 1.0]))), (3.0, [0, 0, 1.0])]
    assert touched(*pushed, (0.1, [0, 0, 5.5]), (0.1, [0, 0, 1.0])) == [0, 0, 1, 0]
    assert touched(*pushed, (0.1, [0, 0, 4.5])) == [0, 0, 0]


def test_a_sensor_that_is_far_off_from_the_start_has_its_zero_there() -> None:
    off = (1.1, [0, 9.0, 0])
    assert touched(off, (0.1, [0, 4.5, 0]), (0.1, [0, 9.0, 0])) == [0, 1, 0]


def test_a_contact_soon_after_the_start_is_one() -> None:
    assert touched((0.1, [0, 0, 1.0]), (0.1, [0, 0, 6.0]), (0.1, [0, 0, 1.0])) == [0, 1, 0]


def test_what_lets_go_of_one_tool_leaves_the_zero_of_the_other() -> None:
    class Pair(Simulation):
        felt = np.zeros((2, 3))

        def felt_force(self, tool: int = 0) -> np.ndarray:
            force: np.ndarray = self.felt[tool]
            return force

    robot = panda_pair()
    world, arm, found = Pair(robot, no_objects), Arm(robot), list[bool]()
    sense = TouchSense(world)
    for left, right in ((7.0, 3.0), (0.0, 1.0), (0.0, 6.5), (0.0, 7.5)):
        world.felt = np.array([[left, 0.0, 0.0], [0.0, right, 0.0]])
        found.append(sense.touching(arm, PERIOD))
    assert found == [False, False, False, True]
