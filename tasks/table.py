"""The table of all tasks, with a floor, lights and a camera."""

from collections.abc import Sequence

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.obstacle import Obstacle, Shape

TABLE_TOP = 0.0
"""Height of the table's surface, at the level of the robot's base [m]."""
TABLE = Obstacle(
    name="table",
    shape=Shape.BOX,
    size=(0.60, 0.60, 0.02),
    T_world_obstacle=SE3.from_translation(np.array([0.30, 0.0, TABLE_TOP - 0.02])),
)
"""The table as an obstacle."""

SURFACE_FRICTION = [0.25, 0.003, 1e-4]
"""Friction of surfaces, the least of any item: that of what lies on them counts, as MuJoCo takes
the larger one [-, m, m]."""


def check_place(name: str, where: Sequence[float], size: Sequence[float] = (0.0, 0.0)) -> None:
    """Check that what is put at a position stands on the table with all of its base.

    Args:
        name: What the position is, for messages.
        where: The position of its middle, x and y [m].
        size: Its extent along x and y, and more that is not used [m].

    Raises:
        InvalidValueError: It does not, or the position is not two finite numbers.
    """
    if len(where) != 2 or not np.isfinite(where).all():
        raise InvalidValueError(name, where, "two finite numbers, x and y [m]")
    middle, room = (
        TABLE.T_world_obstacle.translation()[:2],
        np.array(TABLE.size[:2]) - 0.5 * np.array(size[:2]),
    )
    if (np.abs(where - middle) > room + 1e-9).any():
        (x_min, y_min), (x_max, y_max) = middle - room, middle + room
        sides = f"x {x_min:.2f} to {x_max:.2f}, y {y_min:.2f} to {y_max:.2f}"
        raise InvalidValueError(name, where, f"on the table ({sides})")


def add_table(spec: mujoco.MjSpec) -> None:
    """Add a table, a floor, a light and a camera named "overview"."""
    world = spec.worldbody
    wood, steel = [0.80, 0.71, 0.58, 1.0], [0.35, 0.36, 0.38, 1.0]
    world.add_geom(
        name=TABLE.name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=TABLE.T_world_obstacle.translation(),
        size=TABLE.size,
        rgba=wood,
        friction=SURFACE_FRICTION,
    )
    for i, (x, y) in enumerate([(-0.25, -0.55), (-0.25, 0.55), (0.85, -0.55), (0.85, 0.55)]):
        world.add_geom(
            name=f"table_leg{i}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[x, y, TABLE_TOP - 0.37],
            size=[0.025, 0.025, 0.33],
            rgba=steel,
            contype=0,
            conaffinity=0,
        )
    world.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0.0, 0.0, TABLE_TOP - 0.70],
        size=[2.0, 2.0, 0.05],
        friction=SURFACE_FRICTION,
        rgba=[0.62, 0.66, 0.70, 1.0],
    )
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.97],
        rgb2=[0.62, 0.68, 0.75],
        width=64,
        height=64,
    )
    world.add_light(pos=[0.6, -0.6, 2.2], dir=[-0.2, 0.25, -1.0], castshadow=True)
    world.add_light(
        pos=[0.6, 1.2, 2.2], dir=[-0.2, -0.5, -1.0], castshadow=False, diffuse=[0.25] * 3
    )
    _add_camera(world, "overview", eye=(1.75, -1.15, 0.95), target=(0.22, 0.0, 0.20))


def _add_camera(
    world: mujoco.MjsBody, name: str, eye: Sequence[float], target: Sequence[float]
) -> None:
    """Return a camera pose at `eye` that looks at `target`, upright [m]."""
    back = np.subtract(eye, target) / np.linalg.norm(np.subtract(eye, target))
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    R_world_camera = np.column_stack([right, np.cross(back, right), back])
    world.add_camera(name=name, pos=eye, quat=SO3.from_matrix(R_world_camera).wxyz, fovy=33.0)
