"""Friction in use: against MuJoCo's forces contact by contact, and the weight that is held."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mink import SE3

from robo47_qp.model.gripper import Grip
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.item import Item
from robo47_qp.tasks.table import add_table
from tests.robots import GRIPPER
from tests.runs import Holder

ITEM = Item(name="block", size=(0.04, 0.04, 0.06), mass=0.4)
FORCE = 20.0


def held(friction: float, item: Item = ITEM, seconds: float = 0.5) -> Simulation:
    """A block between the fingers, which were closed on it while its weight was borne."""

    def build(spec: mujoco.MjSpec) -> None:
        add_table(spec)
        item.add(spec, (0.6, 0.3, 0.03))

    world = Simulation(PANDA, build)
    world.set_friction(item.name, friction)
    world.place_object(item.name, world.tool_pose())
    body = world.model.body(item.name).id
    world.data.xfrc_applied[body, 2] = 9.81 * item.mass
    world.command_grip(Grip(width=0.0, force=FORCE))
    holder = Holder(world)
    holder.hold(450)
    world.data.xfrc_applied[body, 2] = 0.0
    holder.hold(int(1000 * seconds))
    return world


def use(world: Simulation) -> np.ndarray:
    world.look_at_friction()
    (views,) = (v for s, v in world.signals_last.items() if s.name == "gripper/friction_use")
    return views[0].copy()


def by_contact(m: mujoco.MjModel, d: mujoco.MjData) -> list[float]:
    """The same by MuJoCo's own function, at a state before it is stepped."""
    mujoco.mj_forward(m, d)
    told: list[float] = []
    for finger in (m.body(name).id for name in GRIPPER.fingers):
        shares, limits = [], []
        for i in range(d.ncon):
            contact, force = d.contact[i], np.zeros(6)
            mujoco.mj_contactForce(m, d, i, force)
            if finger in [int(m.geom_bodyid[geom]) for geom in contact.geom]:
                shares.append(float(np.linalg.norm(force[1:4] / contact.friction[:3])) / force[0])
                limits.append(contact.friction[0] * force[0])
        told += [max(shares), float(np.average(shares, weights=limits))]
    return told


def test_it_is_what_mujoco_solved_contact_by_contact() -> None:
    world = held(0.5)
    before = mujoco.MjData(world.model)
    mujoco.mj_copyData(before, world.model, world.data)
    np.testing.assert_allclose(use(world), by_contact(world.model, before), rtol=1e-3, atol=1e-4)
    # To look changes nothing.
    twin = mujoco.MjData(world.model)
    mujoco.mj_copyData(twin, world.model, world.data)
    world.look_at_friction()
    for name in ("qpos", "qvel", "qacc_warmstart", "ctrl", "sensordata"):
        np.testing.assert_array_equal(getattr(world.data, name), getattr(twin, name))


@pytest.mark.parametrize("friction", [0.3, 0.6, 0.9])
def test_a_hanging_weight_uses_what_it_must(friction: float) -> None:
    world = held(friction)
    least = ITEM.mass * 9.81 / (2.0 * friction * FORCE)
    share = use(world)[1::2]
    # The contacts of a flat pad pull against each other a little, too.
    assert (share > 0.95 * least).all()
    assert (share < 1.35 * least).all()
    assert (use(world)[::2] >= share).all()


def test_what_is_too_heavy_uses_all_and_slides() -> None:
    world = held(0.3, replace(ITEM, mass=1.5), seconds=0.1)
    np.testing.assert_allclose(use(world)[1::2], 1.0, atol=0.02)
    assert world.object_twist("block")[2] < -0.05


def test_empty_fingers_use_none() -> None:
    world = held(0.5)
    world.command_grip(Grip(width=0.08, force=FORCE))
    Holder(world).hold(300)
    assert (use(world) == 0.0).all()


@pytest.mark.parametrize(("friction", "off"), [(0.25, 0.0), (0.25, 0.005), (0.9, 0.01)])
def test_what_is_held_creeps_by_hundredths_of_a_millimetre_a_second(
    friction: float, off: float
) -> None:
    """Without MuJoCo's solver without slip: 30 N, 0.5 kg at most, off the middle."""
    world = held(friction, replace(ITEM, mass=0.3, com=(off, 0.0, 0.0)), seconds=0.3)
    assert world.model.opt.noslip_iterations == 0
    assert world.model.opt.cone == int(mujoco.mjtCone.mjCONE_ELLIPTIC)

    def in_hand() -> SE3:
        return world.tool_pose().inverse() @ world.object_pose("block")

    before = in_hand()
    Holder(world).hold(500)
    moved = before.inverse() @ in_hand()
    assert np.linalg.norm(moved.translation()) / 0.5 < 30e-6
    assert np.degrees(np.linalg.norm(moved.rotation().log())) / 0.5 < 0.1


def test_contacts_are_not_kind() -> None:
    world = held(0.25, seconds=0.0)
    m = world.model
    block = m.geom("block").id
    contact = world.data.contact
    on_fingers = contact.friction[(contact.geom == block).any(axis=1)]
    assert len(on_fingers) >= 2
    np.testing.assert_allclose(on_fingers[:, 0], 0.25)
    assert (on_fingers[:, 2] <= 0.005).all()


def test_the_friction_of_a_disturbed_world_stays() -> None:
    def build(spec: mujoco.MjSpec) -> None:
        add_table(spec)
        ITEM.add(spec, (0.6, 0.3, 0.03))

    wrong = Disturbance(friction=0.33)
    world = DisturbedSimulation(PANDA, build, wrong)
    ITEM.draw_friction(world, np.random.default_rng(0))
    assert world.model.geom_friction[world.model.geom("block").id, 0] == 0.33
    right = Simulation(PANDA, build)
    drawn = set()
    for seed in range(5):
        ITEM.draw_friction(right, np.random.default_rng(seed))
        drawn.add(float(right.model.geom_friction[right.model.geom("block").id, 0]))
    assert len(drawn) == 5
    assert all(0.25 <= friction <= 0.9 for friction in drawn)
