"""Two arms in one simulation: joints, fingers and contacts of each are its own."""

from typing import Any

import mujoco
import numpy as np
import pytest
from mink import SE3

from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import Arm
from robo47_qp.model.gripper import Grip
from robo47_qp.model.payload import Payload
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.sim.columns import Columns, spans
from robo47_qp.sim.simulation import Simulation

PAIR = panda_pair()
ARM = Arm(PAIR)
TABLE_Z = float(ARM.pose(ARM.home, 1).translation()[2]) - 0.05


def shelf_below_the_right_hand(spec: mujoco.MjSpec) -> None:
    x, y, _ = ARM.pose(ARM.home, 1).translation()
    box = mujoco.mjtGeom.mjGEOM_BOX
    body = spec.worldbody.add_body(name="weight", pos=[x, y, TABLE_Z + 0.05])
    body.add_freejoint()
    body.add_geom(type=box, size=[0.02] * 3, mass=0.4)
    spec.worldbody.add_geom(type=box, size=[0.05, 0.05, 0.01], pos=[x, y, TABLE_Z + 0.02])


def make(build=lambda _: None) -> Simulation:  # type: ignore[no-untyped-def]
    return Simulation(PAIR, build)


def hold(sim: Simulation, seconds: float, arm: Arm = ARM) -> None:
    still = np.zeros(arm.n)
    for _ in range(round(seconds / TIMESTEP)):
        state = sim.state()
        spring = 600.0 * (PAIR.home - state.q) - 40.0 * state.v
        sim.step(arm.inverse_dynamics(state.q, state.v, still) + spring)


def test_pieces_of_consecutive_places() -> None:
    assert spans([3, 4, 5]) == [slice(3, 6)]
    assert spans([0, 1, 4, 5, 9]) == [slice(0, 2), slice(4, 6), slice(9, 10)]


def test_columns_in_pieces_are_read_and_written_in_their_order() -> None:
    array = np.arange(8.0)
    columns = Columns(array, [slice(1, 3), slice(5, 8)])
    assert columns.read().tolist() == [1.0, 2.0, 5.0, 6.0, 7.0]
    columns.write(np.array([10.0, 20.0, 30.0, 40.0, 50.0]))
    assert array.tolist() == [0.0, 10.0, 20.0, 3.0, 4.0, 30.0, 40.0, 50.0]


def test_it_starts_at_home_at_rest_with_open_grippers() -> None:
    sim = make()
    assert sim.state().q.tolist() == PAIR.home.tolist()
    for tool, gripper in enumerate(PAIR.grippers):
        assert sim.width(tool) == gripper.width_max
        away = sim.tool_pose(tool).inverse() @ ARM.pose(PAIR.home, tool)
        assert np.linalg.norm(away.log()) < 1e-9


def test_torques_reach_the_joints_of_each_arm() -> None:
    sim = make()
    hold(sim, 0.2)
    assert np.abs(sim.state().q - PAIR.home).max() < 1e-6
    tau = ARM.inverse_dynamics(sim.state().q, np.zeros(14), np.zeros(14))
    tau[10] += 2.0
    for _ in range(20):
        sim.step(tau)
    moved = np.abs(sim.state().q - PAIR.home)
    assert moved.argmax() == 10
    assert moved[:7].max() < 1e-6
    assert sim.last_torque().tolist() == sim.motor_torque().tolist()


def test_each_gripper_closes_alone() -> None:
    sim = make()
    sim.command_grip(Grip(width=0.0, force=20.0), tool=1)
    hold(sim, 1.2)
    assert sim.width(1) < 1e-3
    assert sim.width(0) > 0.079
    assert sim.grip_settled(0)
    assert sim.grip_settled(1)


def test_contact_belongs_to_the_arm_that_touches() -> None:
    sim = make(shelf_below_the_right_hand)
    sim.command_grip(Grip(width=0.0, force=30.0), tool=1)
    hold(sim, 1.0)
    assert min(sim.last_finger_forces(1)) > 20.0
    assert sim.last_finger_forces(0).tolist() == [0.0, 0.0]
    assert not sim.last_tool_force(0).any()
    assert sim.last_links_force() == 0.0


def test_a_weight_is_carried_by_the_arm_that_is_told_of_it() -> None:
    def shift(arm: Arm) -> np.ndarray:
        sim = make(_held)
        hold(sim, 1.5, arm)
        return np.abs(sim.state().q - PAIR.home)

    def _held(spec: mujoco.MjSpec) -> None:
        hand: Any = spec.body("right_hand")
        load = hand.add_body(name="load", pos=[0.0, 0.0, 0.1034])
        load.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02], mass=0.5, contype=0)
        load.geoms[0].conaffinity = 0

    sphere = 0.4 * 0.5 * 0.02**2
    payload = Payload(mass=0.5, inertia=(sphere,) * 3, T_tcp_com=SE3.identity())
    unknown, told = shift(ARM), shift(ARM.with_payload({"right": payload}))
    assert unknown[7:].max() > 1e-3
    assert unknown[:7].max() < 1e-6
    assert told.max() < 1e-6
    wrong = shift(ARM.with_payload({"left": payload}))
    assert wrong[:7].max() > 1e-3


def test_signals_of_the_second_tool_have_its_name() -> None:
    sim = make()
    now = {signal.name: views for signal, views in sim.signals_now.items()}
    assert [len(view) for view in now["joints/q"]] == [7, 7]
    row = np.empty(sum(len(s.labels) for s in sim.signals_now))
    sim.write_now(row)
    names = [signal.name for signal in sim.signals_now]
    starts = np.cumsum([0, *(len(s.labels) for s in sim.signals_now)])
    at = starts[names.index("tool/right_pose")]
    assert row[at : at + 3] == pytest.approx(sim.tool_pose(1).translation())
    assert {"gripper/right_fingers", "gripper/right_width_command"} <= set(names)
    assert "contact/right_tool" in [signal.name for signal in sim.signals_last]
