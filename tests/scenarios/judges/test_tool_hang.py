"""ToolHang: what its program knows of frame, stand and tool, beside models of their sizes."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from scenarios.judges.suite import tool_hang
from scenarios.judges.suite.cell import Axis, Cell
from tests.scenarios.judges.stand_in import BASE, KP, RATE, StandIn, Thing

STAND = np.array([-0.08, 0.0, 0.805])
"""Where robosuite's stand has the middle of its plate."""
BAR, PRONG, RING = 1, 5, 8
"""Kinds of geoms: what collides with the ring in the model below."""


def cell(**seen: Any) -> Cell:
    q = np.array([0.0, 0.2, 0.0, -2.6, 0.0, 2.94, 0.785])
    return Cell({"bases": BASE[None], "rate": RATE, "kp": KP, "robot0_joint_pos": q, **seen})


def hook_and_ring() -> mujoco.MjModel:
    """The end of the hook, in the frame's axes from its corner, and the ring of the tool.

    Sizes are those of robosuite's models: hook_frame.py and hollow_cylinder.py, n = 8.
    """
    spec = mujoco.MjSpec()
    box = mujoco.mjtGeom.mjGEOM_BOX
    hook = spec.worldbody.add_body(name="hook")
    hook.add_geom(name="bar", type=box, size=[0.0475, 0.00375, 0.00375], pos=[-0.04375, 0, 0])
    hook.add_geom(name="prong", type=box, size=[0.00375, 0.00375, 0.006], pos=[-0.0875, 0, 0.00975])
    ring = spec.worldbody.add_body(name="ring", mocap=True)
    outer, inner, n = 0.0175, 0.0105, 8
    half = (outer - inner) * np.cos(np.pi / n) / 2.0
    middle = inner * np.cos(np.pi / n) + half
    for k in range(n):
        angle = 2.0 * np.pi * k / n
        ring.add_geom(
            type=box,
            size=[half, outer * np.sin(np.pi / n), 0.0035],
            pos=[middle * np.cos(angle), middle * np.sin(angle), 0.0],
            quat=[np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)],
        )
    return spec.compile()


def clearance(model: mujoco.MjModel, T_frame_ring: SE3) -> float:
    data = mujoco.MjData(model)
    data.mocap_pos[0], data.mocap_quat[0] = (
        T_frame_ring.translation(),
        T_frame_ring.rotation().wxyz,
    )
    mujoco.mj_forward(model, data)
    hook = [model.geom(name).id for name in ("bar", "prong")]
    ring = [i for i in range(model.ngeom) if i not in hook]
    pairs = [(a, b) for a in hook for b in ring]
    return min(mujoco.mj_geomDistance(model, data, a, b, 0.05, None) for a, b in pairs)


@pytest.mark.parametrize("share", np.linspace(0.0, 1.0, 10))
def test_the_ring_is_turned_around_the_hooks_corner_without_touching_it(share: float) -> None:
    out, up = np.array([-1.0, 0.0, 0.0]), 0.5 * tool_hang.THICK + tool_hang.GAP
    level = tool_hang.around(tool_hang.PRONG, out, up)
    axis = Axis(tool_hang.PRONG + tool_hang.PIVOT, np.cross([0.0, 0.0, 1.0], out))
    tool = axis.turned(level, share * tool_hang.DOWN)
    ring = tool @ SE3.from_translation(tool_hang.RING)
    assert clearance(hook_and_ring(), ring) > 0.0008
    # The grip goes down, outside the hook.
    drop = level.translation()[2] - tool.translation()[2]
    assert drop == pytest.approx(0.104 * np.sin(share * tool_hang.DOWN), abs=0.003)
    assert tool.translation()[0] < tool_hang.PRONG[0] - 0.05


def test_a_ring_beside_the_prong_would_touch_it() -> None:
    """The model above does tell: a ring that is off by what the prong leaves does touch."""
    level = tool_hang.around(tool_hang.PRONG, np.array([-1.0, 0.0, 0.0]), 0.0055)
    ring = level @ SE3.from_translation(tool_hang.RING + np.array([0.007, 0.0, 0.0]))
    assert clearance(hook_and_ring(), ring) < 0.0


def test_the_rod_is_led_to_the_floor_of_the_tube() -> None:
    one = cell(base_pos=STAND, base_quat=np.array([0.0, 0.0, 0.0, 1.0]))
    foot = one.pose("base").apply(tool_hang.MOUNT)
    frame = tool_hang.standing(one, foot + np.array([0.0, 0.0, tool_hang.ROD]))
    tip = one.T_suite_base @ frame @ SE3.from_translation(np.array([0.0, 0.0, -tool_hang.ROD]))
    # By hook_frame.py: half of 0.18 + 2 x 0.0127 + 0.01905 below, 0.09 - 0.00375 above the middle.
    assert pytest.approx(0.09 + 2 * 0.0127 + 0.01905 + 0.08625, abs=1e-4) == tool_hang.ROD
    np.testing.assert_allclose(tip.translation(), [-0.08, 0.045, 0.81], atol=1e-6)
    hook = -(one.T_suite_base @ frame).rotation().as_matrix()[:, 0]
    np.testing.assert_allclose(hook, [1.0, 0.0, 0.0], atol=1e-9)


def lying(x: float, y: float, z: float, yaw: float) -> SE3:
    """A frame on its side as robosuite lays it: its y down, its rod's top along the heading."""
    turn = SO3.from_z_radians(yaw) @ SO3.from_matrix(
        np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    )
    flip = turn @ SO3.from_z_radians(np.pi)
    return SE3.from_rotation_and_translation(flip, np.array([x, y, z]))


def test_frame_and_tool_are_brought_to_their_places() -> None:
    frame = Thing("frame", lying(-0.113, -0.311, 0.8126, -1.976), 0.0254)
    frame.spot = frame.pose.apply(tool_hang.GRIP)
    flat = SE3.from_rotation_and_translation(
        SO3.from_z_radians(-2.05), np.array([0.059, -0.2, 0.815])
    )
    tool = Thing("tool", flat, 0.03)
    tool.spot = flat.translation()
    stand = Thing("base", SE3.from_translation(STAND), 0.0)
    world = StandIn("ToolHang", [frame, tool, stand])
    let_go: list[tuple[str, SE3]] = []
    step = world.step

    def watched(answer: Mapping[str, Any]) -> None:
        held = [one for one in world.things if one.held is not None]
        step(answer)
        for one in held:
            if one.held is None:
                let_go.append((one.name, one.pose))
                if one is tool:  # it falls, and hangs
                    one.pose = SE3.from_translation(np.array([0.0, 0.045, 0.93]))

    world.step = watched  # type: ignore[method-assign]
    assert world.run() == ""
    assert [name for name, _ in let_go] == ["frame", "tool"]
    tip = let_go[0][1].apply(np.array([0.0, 0.0, -tool_hang.ROD]))
    np.testing.assert_allclose(tip, [-0.08, 0.045, 0.81 + tool_hang.GAP], atol=2e-3)
    hang = let_go[0][1].inverse() @ let_go[1][1] @ SE3.from_translation(tool_hang.RING)
    assert clearance(hook_and_ring(), hang) > 0.0
    assert np.linalg.norm(hang.translation() - tool_hang.PRONG) < 0.012


@pytest.mark.parametrize(
    "elsewhere",
    [
        SE3.from_translation(np.array([-0.08, 0.045, 1.18])),  # on the rim
        lying(-0.25, -0.06, 0.8126, -1.976),
    ],
)
def test_a_frame_that_is_elsewhere_is_told(elsewhere: SE3) -> None:
    off = np.linalg.norm(elsewhere.apply(tool_hang.TIP) - STAND - tool_hang.MOUNT)
    told = f"place: the rod's tip is {1e3 * off:.0f} mm off the floor of the stand"
    assert inserted(elsewhere)[0] == told


def test_the_rod_is_above_the_stand_before_it_is_led_down() -> None:
    """The frame turns upright where it was taken up, not on its way: it had hit the stand."""
    x, y, top = STAND + tool_hang.MOUNT + np.array([0.0, 0.0, tool_hang.TUBE])
    tips, near = [], []
    for pose in inserted(SE3.identity())[1]:
        rod = [pose.apply(share * tool_hang.TIP) for share in np.linspace(0, 1, 45)]
        tips.append(rod[-1])
        near.append(any(np.hypot(p[0] - x, p[1] - y) < 0.03 and p[2] < top for p in rod))
    first = near.index(True)
    # It comes to be there from above the tube, and only goes down from then on.
    assert tips[first][2] > top - 0.01
    assert np.hypot(*(tips[first][:2] - [x, y])) < 0.002
    assert all(near[first:])


def inserted(elsewhere: SE3) -> tuple[str, list[SE3]]:
    """What is told where a frame is elsewhere once it is let go, and its poses while it is held."""
    frame = Thing("frame", lying(-0.113, -0.311, 0.8126, -1.976), 0.0254)
    frame.spot = frame.pose.apply(tool_hang.GRIP)
    world = StandIn("ToolHang", [frame, Thing("base", SE3.from_translation(STAND), 0.0)])
    step, poses = world.step, list[SE3]()

    def watched(answer: Mapping[str, Any]) -> None:
        held = frame.held is not None
        step(answer)
        if frame.held is not None:
            poses.append(frame.pose)
        elif held:
            frame.pose = elsewhere

    world.step = watched  # type: ignore[method-assign]
    return world.run(), poses
