from typing import Any

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import SIZES, Obstacle, Shape, add_obstacle
from robo47_qp.model.payload import Payload
from robo47_qp.model.robots.panda import PANDA
from tests.small_robots import cell

PLACED = SE3.from_rotation_and_translation(
    SO3.from_rpy_radians(0.3, -0.5, 1.1), np.array([0.4, -0.2, 0.7])
)
FACES = [
    # Shape, size, and how far its surface is from its centre along its own x, y and z.
    (Shape.BOX, (0.1, 0.2, 0.3), (0.1, 0.2, 0.3)),
    (Shape.SPHERE, (0.15,), (0.15, 0.15, 0.15)),
    (Shape.CYLINDER, (0.1, 0.25), (0.1, 0.1, 0.25)),
    (Shape.CAPSULE, (0.1, 0.25), (0.1, 0.1, 0.35)),
]


@pytest.mark.parametrize(("shape", "size", "faces"), FACES)
def test_the_surface_is_where_the_size_says(
    shape: Shape, size: tuple[float, ...], faces: tuple[float, ...]
) -> None:
    """Rays from outside to the centre, along the obstacle's own axes, both ways."""
    spec = mujoco.MjSpec()
    add_obstacle(spec, Obstacle(name="it", shape=shape, size=size, T_world_obstacle=PLACED))
    m = spec.compile()
    d = mujoco.MjData(m)
    mujoco.mj_kinematics(m, d)
    hit = np.zeros(1, dtype=np.int32)
    for axis, face in zip(np.eye(3), faces, strict=True):
        for way in (axis, -axis):
            direction = PLACED.rotation().as_matrix() @ way
            eye = PLACED.translation() + 2.0 * direction
            assert mujoco.mj_ray(m, d, eye, -direction, None, True, -1, hit, None) == pytest.approx(
                2.0 - face, abs=1e-9
            )


def test_a_plane_is_solid_below_its_own_z() -> None:
    up = PLACED.rotation().as_matrix()[:, 2]
    for height in (0.3, -0.3):
        spec = mujoco.MjSpec()
        add_obstacle(spec, Obstacle(name="wall", shape=Shape.PLANE, T_world_obstacle=PLACED))
        centre = PLACED.translation() + height * up + 3.0 * np.cross(up, [1.0, 0.0, 0.0])
        spec.worldbody.add_geom(name="probe", size=[0.05, 0, 0], pos=centre)
        m = spec.compile()
        d = mujoco.MjData(m)
        mujoco.mj_kinematics(m, d)
        distance = mujoco.mj_geomDistance(m, d, 0, 1, 10.0, None)
        assert distance == pytest.approx(height - 0.05, abs=1e-9)


def test_obstacles_change_nothing_but_collisions() -> None:
    bare, among = Arm(PANDA), Arm(PANDA, obstacles=cell())
    q, v, a = bare.home + 0.1, np.full(7, 0.3), np.full(7, -0.7)
    assert [obstacle.name for obstacle in among.obstacles] == [o.name for o in cell()]
    assert among.inverse_dynamics(q, v, a).tolist() == bare.inverse_dynamics(q, v, a).tolist()
    assert among.pose(q).wxyz_xyz.tolist() == bare.pose(q).wxyz_xyz.tolist()
    assert bare.obstacles == ()
    assert among.model.ngeom == bare.model.ngeom + 5


def test_carrying_keeps_the_obstacles() -> None:
    arm = Arm(PANDA, obstacles=cell())
    held = Payload(mass=1.0, inertia=(1e-3, 1e-3, 1e-3), T_tcp_com=SE3.identity())
    for other in (arm.with_payload(held), arm.with_payload(held).with_payload(None)):
        assert other.obstacles == arm.obstacles
        assert other.model.geom("post").id >= 0


BAD: list[tuple[dict[str, Any], str]] = [
    ({"name": ""}, "name of an obstacle must be a non-empty text"),
    ({"shape": "box"}, "shape of obstacle 'it' must be one of Shape; found 'box'"),
    ({"size": (0.1, 0.2)}, "size of obstacle 'it' must be a vector of 3 finite numbers"),
    ({"size": (0.1, 0.2, 0.0)}, r"positive lengths \[m\]; found \[0.1, 0.2, 0.0\]"),
    ({"size": (0.1, 0.2, np.nan)}, "finite numbers"),
    ({"T_world_obstacle": SE3(np.array([2.0, 0, 0, 0, 0, 0, 0]))}, "unit quaternion"),
    ({"T_world_obstacle": SE3(np.array([1.0, 0, 0, 0, 0, np.inf, 0]))}, "pose of obstacle 'it'"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_what_is_no_obstacle_is_refused(change: dict[str, Any], message: str) -> None:
    good: dict[str, Any] = {"name": "it", "shape": Shape.BOX, "size": (0.1, 0.2, 0.3)}
    Obstacle(**good)
    with pytest.raises(InvalidValueError, match=message):
        Obstacle(**good | change)


def test_every_shape_has_its_number_of_lengths() -> None:
    assert set(SIZES) == set(Shape)
    with pytest.raises(InvalidValueError, match="a vector of 0 finite numbers"):
        Obstacle(name="floor", shape=Shape.PLANE, size=(1.0,))


def test_a_name_is_given_once() -> None:
    ball = Obstacle(name="ball", shape=Shape.SPHERE, size=(0.1,))
    with pytest.raises(InvalidValueError, match=r"name of an obstacle must be none of .*'ball'"):
        Arm(PANDA, obstacles=[ball, ball])
    taken = Obstacle(name="hand_c0", shape=Shape.SPHERE, size=(0.1,))
    with pytest.raises(InvalidValueError, match="found 'hand_c0'"):
        Arm(PANDA, obstacles=[taken])
