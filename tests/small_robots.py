"""Robots of a few primitive links, and obstacles, for tests with answers known by hand."""

from pathlib import Path

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA

_GANTRY = """
<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body name="base">
  <geom name="foot" type="sphere" size="0.01" pos="0 0 -5"/>
  <body name="x"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
    <joint name="x" type="slide" axis="1 0 0" range="-2 2"/>
    <body name="y"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
      <joint name="y" type="slide" axis="0 1 0" range="-2 2"/>
      <body name="z"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
        <joint name="z" type="slide" axis="0 0 1" range="-2 2"/>
        <body name="probe"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
          <joint name="tilt" axis="0 1 0" range="-3 3"/>
          <geom name="tip" {tip}/><site name="tool"/>
</body></body></body></body></body></worldbody></mujoco>
"""


def small_robot(
    folder: Path,
    mjcf: str,
    joints: tuple[str, ...],
    tool: str = "tool",
    slides: tuple[str, ...] = (),
) -> Robot:
    """A robot of this MJCF; nothing but its geometry and its joints means anything."""
    path = folder / "small.xml"
    path.write_text(mjcf, encoding="utf-8")
    n = len(joints)
    profile = type(PANDA.profile).uniform(n, v=1.0, a=1.0, j=1.0)
    ones = np.ones(n)
    return Robot(
        name="small",
        mjcf=path,
        joints=joints,
        slides=slides,
        motors=joints,
        tcp=tool,
        home=np.zeros(n),
        rated=profile,
        profile=profile,
        tau_max=ones,
        tau_rate_max=ones,
        stiffness=ones,
        gripper=PANDA.gripper,
    )


def gantry(folder: Path, tip: str) -> Robot:
    """A probe that three slides carry to (x, y, z) and a hinge turns about y."""
    slides = ("x", "y", "z")
    return small_robot(folder, _GANTRY.format(tip=tip), (*slides, "tilt"), slides=slides)


def at(*position: float) -> SE3:
    """A pose that is not turned."""
    return SE3.from_translation(np.array(position))


def cell() -> tuple[Obstacle, ...]:
    """A table, a post, a ball, a tilted shelf and a floor around a Panda."""
    leaning = SE3.from_rotation_and_translation(
        SO3.from_rpy_radians(0.2, 0.1, 0.4), np.array([0.6, 0.0, 0.5])
    )
    return (
        Obstacle(
            name="table", shape=Shape.BOX, size=(0.6, 0.6, 0.02), T_world_obstacle=at(0.3, 0, -0.02)
        ),
        Obstacle(
            name="post", shape=Shape.CYLINDER, size=(0.05, 0.3), T_world_obstacle=at(0.45, 0.3, 0.3)
        ),
        Obstacle(
            name="ball", shape=Shape.SPHERE, size=(0.1,), T_world_obstacle=at(0.45, -0.3, 0.5)
        ),
        Obstacle(name="shelf", shape=Shape.BOX, size=(0.15, 0.2, 0.01), T_world_obstacle=leaning),
        Obstacle(name="floor", shape=Shape.PLANE, T_world_obstacle=at(0, 0, -0.7)),
    )


def vector(*numbers: float) -> Vector:
    return np.array(numbers, dtype=np.float64)
