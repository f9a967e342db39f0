"""What counts as a placed cube: where it is, at rest, and the arm home with open fingers."""

import numpy as np
import pytest
from mink import SE3

from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.failure import Cause
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.robots import GRIPPER
from tests.runs import at_rest

GOAL = np.array([0.40, -0.20, 0.02])


@pytest.fixture
def done() -> tuple[PickPlace, Simulation]:
    """A world in which all is as it should be at the end."""
    task = PickPlace()
    simulation = Simulation(PANDA, task.build_scene)
    task.reset(simulation, None)
    simulation.place_object("cube", SE3.from_translation(GOAL))
    at_rest(simulation)
    return task, simulation


def test_all_as_it_should_be_is_success(done: tuple[PickPlace, Simulation]) -> None:
    task, simulation = done
    assert task.verdict(simulation) is None
    assert task.measures(simulation) == {
        "place_error_m": pytest.approx(0.0, abs=1e-12),
        "place_turn_rad": pytest.approx(0.0, abs=1e-12),
        "place_tilt_rad": pytest.approx(0.0, abs=1e-12),
    }


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, -1, 0), (0, 0, 1), (0.6, 0.8, 0)])
@pytest.mark.parametrize(("distance", "ok"), [(4.9e-3, True), (5.1e-3, False), (0.2, False)])
def test_the_cube_must_be_within_the_tolerance_in_every_direction(
    done: tuple[PickPlace, Simulation],
    direction: tuple[float, float, float],
    distance: float,
    ok: bool,
) -> None:
    task, simulation = done
    where = GOAL + distance * np.array(direction)
    simulation.place_object("cube", SE3.from_translation(where))
    assert task.measures(simulation)["place_error_m"] == pytest.approx(distance)
    failure = task.verdict(simulation)
    if ok:
        assert failure is None
    else:
        assert failure is not None
        assert failure.cause is Cause.PLACE
        assert f"{1e3 * distance:.1f} mm from its goal" in failure.evidence


def test_a_cube_in_motion_is_not_placed(done: tuple[PickPlace, Simulation]) -> None:
    task, simulation = done
    simulation.data.joint(simulation.model.body("cube").jntadr[0]).qvel[:3] = [0, 0.002, 0]
    failure = task.verdict(simulation)
    assert failure is not None
    assert failure.cause is Cause.PLACE
    assert "moves at 2.0 mm/s" in failure.evidence


def test_a_closed_gripper_is_not_the_end(done: tuple[PickPlace, Simulation]) -> None:
    task, simulation = done
    for finger in GRIPPER.joints:
        simulation.data.joint(finger).qpos[0] = 0.039
    failure = task.verdict(simulation)
    assert failure is not None
    assert failure.cause is Cause.PLACE
    assert "the gripper is open 78.0 mm" in failure.evidence


@pytest.mark.parametrize("joint", PANDA.joints)
def test_a_joint_away_from_home_is_not_the_end(
    done: tuple[PickPlace, Simulation], joint: str
) -> None:
    task, simulation = done
    simulation.data.joint(joint).qpos[0] += 0.009
    assert task.verdict(simulation) is None
    simulation.data.joint(joint).qpos[0] -= 0.020
    failure = task.verdict(simulation)
    assert failure is not None
    assert failure.cause is Cause.PLACE
    assert "a joint is 0.011 rad from home" in failure.evidence
