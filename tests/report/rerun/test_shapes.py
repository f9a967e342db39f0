"""Shapes of a scene in a recording: those of MuJoCo."""

from typing import Any

import mujoco
import numpy as np

from robo47_qp.report.rerun.scene import body_shapes, undrawn

SHAPES = """
<mujoco>
  <compiler angle="radian"/>
  <asset>
    <material name="red" rgba="1 0 0 1"/>
    <mesh name="wedge" vertex="0 0 0  0.3 0 0  0 0.2 0  0 0 0.1"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" pos="0 0 -0.2" euler="0.3 0 0"/>
    <body name="odd">
      <geom name="box" type="box" size=".1 .2 .3" pos=".1 0 .2" euler=".3 .2 .1" material="red"/>
      <geom name="ball" type="sphere" size=".07" rgba="0 1 0 1" material="red"/>
      <geom name="egg" type="ellipsoid" size=".1 .2 .3" pos="0 .4 0"/>
      <geom name="can" type="cylinder" size=".1 .3" pos="0 0 .5" euler="1 0 0"/>
      <geom name="pill" type="capsule" fromto="0.1 0.2 0.3 -0.2 0.4 0.8" size=".05"/>
      <geom name="wedge" type="mesh" mesh="wedge" pos=".2 .1 0" euler="0 .5 0"/>
      <geom name="hidden" type="box" size="1 1 1" group="3"/>
      <geom name="glass" type="box" size="1 1 1" rgba="1 1 1 0"/>
    </body>
  </worldbody>
</mujoco>
"""


def values(shape: Any, name: str) -> Any:
    return np.array(getattr(shape, name).as_arrow_array().to_pylist())


def test_shapes_have_the_place_size_and_colour_of_their_geoms() -> None:
    model = mujoco.MjModel.from_xml_string(SHAPES)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    shapes = dict(body_shapes(model, model.body("odd").id))
    assert sorted(shapes) == ["boxes", "capsules", "cylinders", "ellipsoids", "meshes"]
    assert undrawn(model) == ()

    box = shapes["boxes"]
    np.testing.assert_allclose(values(box, "half_sizes"), [[0.1, 0.2, 0.3]], atol=1e-6)
    np.testing.assert_allclose(values(box, "centers"), [data.geom("box").xpos], atol=1e-6)
    wxyz = np.roll(values(box, "quaternions")[0], 1)
    np.testing.assert_allclose(wxyz, model.geom("box").quat, atol=1e-6)
    assert values(box, "colors").tolist() == [0xFF0000FF]
    egg = shapes["ellipsoids"]
    np.testing.assert_allclose(values(egg, "half_sizes"), [[0.07] * 3, [0.1, 0.2, 0.3]], atol=1e-6)
    assert values(egg, "colors").tolist()[0] == 0x00FF00FF
    can = shapes["cylinders"]
    np.testing.assert_allclose([values(can, "lengths"), values(can, "radii")], [[0.6], [0.1]])
    np.testing.assert_allclose(values(can, "centers"), [data.geom("can").xpos], atol=1e-6)

    # Rerun draws a capsule from its origin along its z axis.
    start = values(shapes["capsules"], "translations")[0]
    axis = data.geom("pill").xmat.reshape(3, 3)[:, 2]
    end = start + values(shapes["capsules"], "lengths")[0] * axis
    ends = sorted([start.tolist(), end.tolist()], key=lambda point: point[2])
    np.testing.assert_allclose(ends, [[0.1, 0.2, 0.3], [-0.2, 0.4, 0.8]], atol=1e-6)

    turn = np.array([[np.cos(0.5), 0, np.sin(0.5)], [0, 1, 0], [-np.sin(0.5), 0, np.cos(0.5)]])
    corners = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.1]])
    placed = corners @ turn.T + [0.2, 0.1, 0.0]
    points, triangles = (
        values(shapes["meshes"], f) for f in ("vertex_positions", "triangle_indices")
    )
    found = {tuple(point) for point in np.round(points, 5).tolist()}
    assert found == {tuple(point) for point in np.round(placed, 5).tolist()}
    a, b, c = (points[triangles[:, k]] for k in range(3))
    outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), (a + b + c) / 3 - placed.mean(axis=0))
    assert (outward > 0.0).all()

    floor = dict(body_shapes(model, 0))["planes"]
    thickness = 2 * values(floor, "half_sizes")[0, 2]
    top = values(floor, "centers")[0] + data.geom("floor").xmat.reshape(3, 3)[:, 2] * thickness / 2
    np.testing.assert_allclose(top, [0.0, 0.0, -0.2], atol=1e-6)
