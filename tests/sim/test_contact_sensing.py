"""Contact forces on tool and links: against MuJoCo's contacts one by one, and Newton."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.simulation import Simulation
from tests.runs import Holder, no_objects
from tests.sim.shelf import HOME_TOOL, WEIGHT, cube_on_a_shelf, grasp
from tests.small_robots import small_robot

BALL, RADIUS = 0.7, 0.06


def balls(spec: mujoco.MjSpec) -> None:
    """Two heavy balls far away, that anything collides with, and a floor."""
    for i in range(2):
        body = spec.worldbody.add_body(name=f"ball {i}", pos=[9.0, 3.0 * i, 5.0])
        body.add_freejoint()
        body.add_geom(
            name=f"ball {i}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[RADIUS, 0, 0],
            mass=BALL,
            contype=2**31 - 1,
            conaffinity=2**31 - 1,
        )
    floor = mujoco.mjtGeom.mjGEOM_PLANE
    spec.worldbody.add_geom(name="floor", type=floor, size=[9, 9, 1], pos=[0, 0, -0.3])


def pincers(spec: mujoco.MjSpec, tcp: str) -> None:
    """Two balls on the tool, each on a slide, that press on each other."""
    tool = spec.site(tcp)
    assert tool is not None
    for i, axis in enumerate(([1, 0, 0], [-1, 0, 0])):
        body = tool.parent.add_body(name=f"jaw {i}", pos=[0.3 - 0.03 * axis[0], 0.1 * i, 0.2])
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[RADIUS, 0, 0],
            mass=BALL,
            contype=1,
            conaffinity=1,
        )


@pytest.fixture(scope="module")
def world(robot: Robot) -> Simulation:
    def build(spec: mujoco.MjSpec) -> None:
        balls(spec)
        pincers(spec, robot.tcp)

    return Simulation(robot, build)


def bodies_of(world: Simulation, joint: str) -> set[int]:
    """The body of a joint and all below it, by walking up from every body."""
    m = world.model
    top, found = int(m.joint(joint).bodyid[0]), set()
    for body in range(m.nbody):
        above = body
        while above not in (0, top):
            above = int(m.body_parentid[above])
        if above == top:
            found.add(body)
    return found


def contacts(world: Simulation) -> Iterator[tuple[int, int, Vector]]:
    """Both bodies of every contact and the force of the first on the second, in the world."""
    m, d = world.model, world.data
    for i in range(d.ncon):
        wrench = np.zeros(6)
        mujoco.mj_contactForce(m, d, i, wrench)
        first, second = (int(m.geom_bodyid[geom]) for geom in d.contact[i].geom)
        yield first, second, d.contact[i].frame.reshape(3, 3).T @ wrench[:3]


def summed(world: Simulation) -> tuple[Vector, float, set[str]]:
    """Tool force and links' force by MuJoCo's contacts, and which kinds of contact there were."""
    joints = world.robot.joints
    tool, arm = bodies_of(world, joints[-1]), bodies_of(world, joints[0])
    on_tool, on_link = np.zeros(3), {body: np.zeros(3) for body in arm - tool}
    kinds = set()
    for first, second, force in contacts(world):
        for body, other, push in ((first, second, -force), (second, first, force)):
            if body in tool and other not in tool:
                on_tool += push
            if body in on_link:
                on_link[body] += push
            where = "tool" if body in tool else "link" if body in arm else "world"
            what = "tool" if other in tool else "link" if other in arm else "world"
            kinds.add(f"{what} on {where}")
    return on_tool, float(sum(np.linalg.norm(force) for force in on_link.values())), kinds


def collidable(world: Simulation, bodies: set[int]) -> list[int]:
    m = world.model
    solid = (m.geom_contype != 0) | (m.geom_conaffinity != 0)
    return [i for i in range(m.ngeom) if solid[i] and int(m.geom_bodyid[i]) in bodies]


def test_the_forces_are_the_sums_of_the_contacts(
    world: Simulation, rng: np.random.Generator
) -> None:
    """Anywhere, through itself and the floor, with balls pressed into random geoms."""
    m, d, joints = world.model, world.data, world.robot.joints
    tool, arm = bodies_of(world, joints[-1]), bodies_of(world, joints[0])
    dofs = [m.joint(joint).qposadr[0] for joint in joints]
    low, high = np.array([m.joint(joint).range for joint in joints]).T
    seen: set[str] = set()
    geoms = [found for group in (arm - tool, tool) if (found := collidable(world, group))]
    for _ in range(60):
        world.reset()
        d.qpos[dofs] = rng.uniform(low, high)
        if world.robot.gripper is not None:
            for finger in world.robot.gripper.joints:
                d.qpos[m.joint(finger).qposadr[0]] = rng.choice([-0.002, 0.02])
        mujoco.mj_kinematics(m, d)
        for name, group in zip(world.objects, geoms, strict=False):
            near = d.geom_xpos[rng.choice(group)] + rng.uniform(-0.05, 0.05, 3)
            world.place_object(name, SE3.from_translation(near))
        mujoco.mj_forward(m, d)
        on_tool, on_links, kinds = summed(world)
        assert world.last_tool_force() == pytest.approx(on_tool, rel=1e-9, abs=1e-6)
        assert world.last_links_force() == pytest.approx(on_links, rel=1e-9, abs=1e-6)
        seen |= kinds
    for bodies, kind in ((tool, "world on tool"), (arm - tool, "world on link")):
        assert (kind in seen) == bool(collidable(world, bodies))
    assert "tool on tool" in seen
    if world.robot is PANDA:
        assert {"link on link", "link on tool", "tool on link"} <= seen


def test_the_tool_feels_the_opposite_of_what_it_does_to_a_ball(world: Simulation) -> None:
    """By Newton, from the ball's acceleration alone."""
    world.reset()
    m, d = world.model, world.data
    below = d.body("jaw 0").xpos - [0.0, 0.0, 1.9 * RADIUS]
    world.place_object("ball 0", SE3.from_translation(below))
    mujoco.mj_forward(m, d)
    a = d.qacc[m.joint(m.body("ball 0").jntadr[0]).dofadr[0] :][:3]
    pull = -BALL * (a - [0.0, 0.0, -9.81])
    assert np.linalg.norm(pull) > 1.0
    assert world.last_tool_force() == pytest.approx(pull, rel=1e-6, abs=1e-6)
    assert world.last_tool_force()[2] > 0.0
    assert world.last_links_force() == 0.0


def test_a_held_cube_pulls_with_its_weight_and_a_table_pushes_up() -> None:
    world = Simulation(PANDA, cube_on_a_shelf)
    holder = grasp(world, 30.0)
    assert world.last_tool_force() == pytest.approx([0.0, 0.0, -WEIGHT], abs=1e-3)
    below = world.object_pose("cube").translation() - [0.0, 0.0, 0.02 + 0.01 - 0.003]
    world.place_marker("shelf", SE3.from_translation(below))
    holder.hold(400)
    assert world.last_tool_force()[2] > 1.0


def test_fingers_that_close_on_what_stands_fixed_press_on_it_with_both() -> None:
    """Opposite forces, whose sum is zero."""
    world = Simulation(PANDA, cube_on_a_shelf)
    x, y, z = HOME_TOOL.translation()
    world.place_marker("shelf", SE3.from_translation(np.array([x, y, z])))
    world.place_object("cube", SE3.from_translation(np.array([2.0, 2.0, 1.0])))
    holder = Holder(world)
    world.command_grip(Grip(width=0.0, force=30.0))
    holder.hold(900)
    world.fixed_force_peak()
    holder.hold(20)
    assert np.linalg.norm(world.last_tool_force()) < 1.0
    assert world.last_finger_forces() == pytest.approx([30.0, 30.0], rel=0.02)
    assert world.fixed_force_peak() == pytest.approx(60.0, rel=0.02)


def test_what_was_felt_does_not_change_any_more() -> None:
    world = Simulation(PANDA, cube_on_a_shelf)
    holder = grasp(world, 30.0)
    reads = [world.last_tool_force(), world.felt_force()]
    kept = [read.copy() for read in reads]
    world.command_grip(Grip(width=0.08, force=30.0))
    holder.hold(300)
    assert not world.last_tool_force().any()
    for read, copy in zip(reads, kept, strict=True):
        np.testing.assert_array_equal(read, copy)


def test_nothing_touches_a_robot_alone(robot: Robot) -> None:
    world = Simulation(robot, no_objects)
    world.step(world.motor_torque())
    assert not world.last_tool_force().any()
    assert not world.felt_force().any()
    assert world.last_links_force() == 0.0


NAMELESS = """
<mujoco><worldbody><body>
  <geom type="sphere" size="0.02"/>
  <body><joint name="a" axis="0 0 1" range="-2 2"/><geom type="sphere" size="0.02" pos="0.3 0 0"/>
    <body pos="0.6 0 0"><geom type="sphere" size="0.02"/></body>
    <body pos="0 1 0"><joint name="b" axis="0 0 1" range="-2 2"/><geom type="sphere" size="0.02"/>
      <body pos="0 0.3 0"><geom type="sphere" size="0.02"/><site name="tool"/></body>
</body></body></body></worldbody></mujoco>
"""


@pytest.mark.parametrize(
    ("place", "on_tool", "on_links"),
    [
        ((0.0, 0.0), False, False),
        ((0.3, 0.0), False, True),
        ((0.6, 0.0), False, True),
        ((0.0, 1.0), True, False),
        ((0.0, 1.3), True, False),
    ],
)
def test_bodies_need_no_names(
    tmp_path: Path, place: tuple[float, float], on_tool: bool, on_links: bool
) -> None:
    """Base, link, a body fixed to the link, tool, a body fixed to the tool."""
    robot = small_robot(tmp_path, NAMELESS, ("a", "b"))
    world = Simulation(replace(robot, has_motors=False, gripper=None), balls)
    above = np.array([*place, 0.018 + RADIUS])
    world.place_object("ball 0", SE3.from_translation(above))
    mujoco.mj_forward(world.model, world.data)
    assert bool(world.last_tool_force().any()) == on_tool
    assert (world.last_links_force() > 0.0) == on_links
    if on_tool:
        assert world.last_tool_force()[2] < 0.0


def test_an_arm_of_one_joint_has_a_tool_and_no_links(tmp_path: Path) -> None:
    robot = small_robot(tmp_path, NAMELESS, ("a",))
    world = Simulation(replace(robot, has_motors=False, gripper=None), balls)
    world.place_object("ball 0", SE3.from_translation(np.array([0.3, 0.0, 0.018 + RADIUS])))
    mujoco.mj_forward(world.model, world.data)
    assert world.last_tool_force()[2] < 0.0
    assert world.last_links_force() == 0.0


def test_a_peak_is_told_once_and_then_counts_from_the_last_look(world: Simulation) -> None:
    world.reset()
    force = world.data.sensor("contact/fixed 0").data
    told = []
    for pressed in (5.0, 2.0, 0.0, 0.0):
        force[:3] = [0.6 * pressed, 0.0, 0.8 * pressed]
        told.append(world.fixed_force_peak(0))
    assert told == pytest.approx([5.0, 5.0, 2.0, 0.0])
