"""The start of a task on a robot, checked before anything runs."""

from copy import copy

import mujoco
import numpy as np

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robot import Robot
from robo47_qp.run.task import Task
from robo47_qp.sim.simulation import Simulation


def checked_start(task: Task, robot: Robot, seed: int | None) -> Simulation:
    """Return the world at the start of a task, checked to be one that the robot can start from.

    Args:
        task: The task.
        robot: The robot.
        seed: Seed of the random start; None takes the default start.

    Raises:
        InvalidValueError: The robot lacks a tool or a gripper (see `Task.check_robot`), the task
            finds no start for it, such as poses within its reach, or at home it stands in
            something of the scene.
    """
    task.check_robot(robot)
    simulation = Simulation(robot, task.build_scene)
    simulation.reset()
    task.reset(simulation, None if seed is None else np.random.default_rng(seed))
    check_clear(simulation, task.name)
    return simulation


def check_clear(simulation: Simulation, task: str) -> None:
    """Check that the robot stands in nothing of the scene; the world stays as it is.

    Args:
        simulation: The world at the start of a task.
        task: Name of the task.

    Raises:
        InvalidValueError: It does.
    """
    pair = _overlap(simulation)
    if pair is not None:
        ours, other = pair
        found = f"{simulation.robot.name}, whose {ours} is in {other}"
        expected = f"one that stands clear of everything in {task} at home"
        raise InvalidValueError("robot", found, expected)


def _overlap(simulation: Simulation) -> tuple[str, str] | None:
    """Return the names of a link and of what it overlaps with outside the robot, if anything."""
    m, d = simulation.model, copy(simulation.data)
    mujoco.mj_fwdPosition(m, d)
    joints = [m.joint(name).bodyid[0] for name in simulation.robot.joints]
    links = {b for b in range(m.nbody) if _moved_by(m, b, set(map(int, joints)))}
    for geoms, distance in zip(d.contact.geom, d.contact.dist, strict=True):
        bodies = [int(m.geom_bodyid[geom]) for geom in geoms]
        ours = [body in links for body in bodies]
        if distance < 0.0 and any(ours) and not all(ours):
            first = ours.index(True)
            thing = m.geom(int(geoms[1 - first])).name or m.body(bodies[1 - first]).name
            return m.body(bodies[first]).name, thing
    return None


def _moved_by(model: mujoco.MjModel, body: int, jointed: set[int]) -> bool:
    while body > 0:
        if body in jointed:
            return True
        body = int(model.body_parentid[body])
    return False
