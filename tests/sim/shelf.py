"""A world with a cube on a shelf between the fingers, and one of the arm alone."""

from functools import cache

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.model.arm import Arm
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.simulation import Simulation
from tests.runs import Holder, no_objects

N = len(PANDA.joints)


HOME_TOOL = Arm(PANDA).pose(PANDA.home)


EDGE, MASS = 0.04, 0.1


WEIGHT = MASS * 9.81


def cube_on_a_shelf(spec: mujoco.MjSpec) -> None:
    """A cube between the open fingers of the arm at home, on a shelf that can be removed."""
    x, y, z = HOME_TOOL.translation()
    cube = spec.worldbody.add_body(name="cube", pos=[x, y, z])
    cube.add_freejoint()
    box = mujoco.mjtGeom.mjGEOM_BOX
    cube.add_geom(name="cube", type=box, size=[EDGE / 2] * 3, mass=MASS)
    shelf = spec.worldbody.add_body(name="shelf", mocap=True, pos=[x, y, z - EDGE / 2 - 0.01])
    shelf.add_geom(name="shelf", type=box, size=[0.02, 0.02, 0.01])


@cache
def one_world() -> Simulation:
    return Simulation(PANDA, no_objects)


def start_again() -> Simulation:
    """One world for all examples, each from its start."""
    one_world().reset()
    return one_world()


def grasp(simulation: Simulation, force: float) -> Holder:
    """Squeeze the cube on the shelf, then take the shelf away."""
    holder = Holder(simulation)
    simulation.command_grip(Grip(width=0.0, force=force))
    holder.hold(900)
    simulation.place_marker("shelf", SE3.from_translation(np.array([2.0, 2.0, 0.0])))
    holder.hold(300)
    return holder
