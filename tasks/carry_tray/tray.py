"""The tray: a plate with two handles, a shallow dish with a loose ball, and a cup."""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Checked, Positive
from robo47_qp.motion.waypoint import tool_down
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.heading import heading, tilt
from robo47_qp.tasks.item import SPINNING, Item
from robo47_qp.tasks.table import SURFACE_FRICTION

NAME, BALL, CUP = "tray", "ball", "cup"
PLATE = (0.10, 0.15, 0.004)
"""Half lengths of the plate [m]."""
_HANDLE = (0.010, 0.035, 0.018)
"""Half lengths of a handle [m]."""
_HANDLE_Y, _HANDLE_Z = 0.185, 0.019
"""Middle of a handle beside the middle of the plate, and above its lower side [m]."""
_HANDLE_FRICTION = 0.6
_GRIP_UP = 0.012
"""Height of the tool point above the middle of the handle [m]."""
_DISH_Y, _DISH_RADIUS, _RIM = 0.07, 0.032, (0.003, 0.004)
"""Middle and inner radius of the dish, half thickness and half height of its rim [m]."""
_RIM_PARTS = 12
_CUP_Y = -0.07
_CUP = (0.024, 0.03)
"""Radius and half height of the cup [m]."""
_BALL_RADIUS = 0.012
_SLID, _LEANS = 0.02, float(np.radians(5.0))
"""How far the cup may slide on the tray [m], and lean [rad]."""
WOOD, STEEL, WHITE = (0.62, 0.44, 0.28, 1.0), (0.55, 0.57, 0.60, 1.0), (0.93, 0.93, 0.90, 1.0)
RED = (0.85, 0.22, 0.18, 1.0)


@dataclass(frozen=True, kw_only=True)
class Tray(Checked):
    """A tray and what stands on it. Its frame is in the middle of its lower side, z up."""

    size: ClassVar[tuple[float, float]] = (2.0 * PLATE[0], 2.0 * PLATE[1])
    """Extent of the plate along x and y [m]."""
    mass: Positive = 0.5
    """Mass of plate and handles [kg]."""
    ball_mass: Positive = 0.03
    """[kg]"""
    cup_mass: Positive = 0.12
    """[kg]"""
    aside: float = 0.0
    """How far dish and cup are from the line between the handles [m]."""

    @property
    def whole_mass(self) -> float:
        """Mass of the tray with ball and cup [kg]."""
        return self.mass + self.ball_mass + self.cup_mass

    @property
    def handle_width(self) -> float:
        """Width of a handle between the fingers [m]."""
        return 2.0 * _HANDLE[0]

    def add(self, spec: mujoco.MjSpec, x: float, y: float, z: float) -> None:
        """Add tray, ball and cup to a scene, with the tray's frame at a position [m]."""
        tray = spec.worldbody.add_body(name=NAME, pos=[x, y, z])
        tray.add_freejoint()
        handles = 0.3 * self.mass
        box = mujoco.mjtGeom.mjGEOM_BOX
        plate = [0.0, 0.0, PLATE[2]]
        tray.add_geom(
            name="plate",
            type=box,
            size=PLATE,
            pos=plate,
            mass=self.mass - handles,
            rgba=WOOD,
            friction=SURFACE_FRICTION,
        )
        for side in (-1.0, 1.0):
            tray.add_geom(
                name=f"handle {side:+.0f}",
                type=box,
                size=_HANDLE,
                pos=[0.0, side * _HANDLE_Y, _HANDLE_Z],
                mass=0.5 * handles,
                rgba=STEEL,
                friction=[_HANDLE_FRICTION, *SPINNING],
            )
        self._add_rim(tray)
        top = z + 2.0 * PLATE[2]
        ball = spec.worldbody.add_body(
            name=BALL, pos=[x + self.aside, y + _DISH_Y, top + _BALL_RADIUS]
        )
        ball.add_freejoint()
        ball.add_geom(
            name=BALL,
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[_BALL_RADIUS, 0.0, 0.0],
            mass=self.ball_mass,
            rgba=RED,
            condim=6,
            # A ball on metal: it rolls almost freely.
            friction=[0.5, 0.003, 0.0002],
        )
        cup = Item(
            name=CUP,
            size=(2.0 * _CUP[0], 2.0 * _CUP[0], 2.0 * _CUP[1]),
            round=True,
            mass=self.cup_mass,
            rgba=WHITE,
        )
        cup.add(spec, (x - self.aside, y + _CUP_Y, top + _CUP[1]))

    def _add_rim(self, tray: mujoco.MjsBody) -> None:
        for k in range(_RIM_PARTS):
            angle = 2.0 * np.pi * k / _RIM_PARTS
            radius = _DISH_RADIUS + _RIM[0]
            x, y = radius * np.cos(angle), radius * np.sin(angle)
            half = radius * np.tan(np.pi / _RIM_PARTS)
            tray.add_geom(
                name=f"rim {k}",
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[_RIM[0], half, _RIM[1]],
                pos=[self.aside + x, _DISH_Y + y, 2.0 * PLATE[2] + _RIM[1]],
                quat=[np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)],
                mass=0.0,
                rgba=STEEL,
                friction=SURFACE_FRICTION,
            )

    def place(self, simulation: Simulation, T_world_tray: SE3) -> None:
        """Put the tray at a pose, with ball and cup at rest on it."""
        top = 2.0 * PLATE[2]
        simulation.place_object(NAME, T_world_tray)
        for name, point in (
            (BALL, [self.aside, _DISH_Y, top + _BALL_RADIUS]),
            (CUP, [-self.aside, _CUP_Y, top + _CUP[1]]),
        ):
            T_tray_it = SE3.from_translation(np.array(point))
            simulation.place_object(name, T_world_tray @ T_tray_it)

    def grasp(self, T_world_tray: SE3, side: float) -> SE3:
        """Return T_world_tcp of a hand from above at a handle, 1 or -1 along the tray's y."""
        point = T_world_tray.apply(np.array([0.0, side * _HANDLE_Y, _HANDLE_Z + _GRIP_UP]))
        return tool_down(point, heading(T_world_tray) + 0.5 * np.pi)

    @property
    def judged(self) -> tuple[str, ...]:
        """What `lost` demands, in words."""
        return (
            f"the ball in its dish, within {1e3 * _DISH_RADIUS:g} mm of the middle; the cup within "
            f"{1e3 * _SLID:g} mm of its place on the tray and {np.degrees(_LEANS):.3g}° of upright",
        )

    def lost(self, simulation: Simulation) -> str | None:
        """Return what is not as it was on the tray; None if ball and cup are where they were."""
        T_tray_world = simulation.object_pose(NAME).inverse()
        top = 2.0 * PLATE[2]
        ball = T_tray_world.apply(simulation.object_pose(BALL).translation())
        off = float(np.linalg.norm(ball[:2] - [self.aside, _DISH_Y]))
        if off > _DISH_RADIUS or abs(ball[2] - top - _BALL_RADIUS) > 0.5 * _BALL_RADIUS:
            return f"the ball is {1e3 * off:.0f} mm from the middle of its dish"
        cup = T_tray_world @ simulation.object_pose(CUP)
        slid = float(np.linalg.norm(cup.translation()[:2] - [-self.aside, _CUP_Y]))
        leaning = tilt(cup)
        if slid > _SLID or leaning > _LEANS:
            return f"the cup has slid {1e3 * slid:.0f} mm and leans {np.degrees(leaning):.1f}°"
        return None
