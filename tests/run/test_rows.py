"""Rows of a run: state, reference and torque are those of their instant."""

import numpy as np
from mink import SE3

from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.model.payload import Payload
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.control_loop import PAYLOAD_RAMP, TICK_ROWS
from robo47_qp.run.scenario import Run
from tests.run.witnesses import Eyewitness, Keeper, ends
from tests.runs import Reach, Witness, carry_out, picked_and_placed


def test_row_k_is_at_k_periods() -> None:
    time = picked_and_placed().rows["time"][:, 0]
    np.testing.assert_allclose(time, np.arange(len(time)) * TIMESTEP, atol=1e-12)


def test_the_state_in_a_row_is_that_of_its_time(
    witnessed: tuple[Run, Witness, Eyewitness, Keeper],
) -> None:
    run, _, eyes, _ = witnessed
    rows = run.rows
    assert len(eyes.seen) > len(rows) / TICK_ROWS
    for time, q, v, cube, tau, a in eyes.seen:
        k = round(time / TIMESTEP)
        np.testing.assert_array_equal(rows["joints/tau"][k - 1], tau)
        np.testing.assert_array_equal(rows["joints/a"][k - 1], a)
        if k < len(rows):
            np.testing.assert_array_equal(rows["joints/q"][k], q)
            np.testing.assert_array_equal(rows["joints/v"][k], v)
            pose = rows["objects/cube"][k]
            np.testing.assert_array_equal(pose, np.concatenate([cube[4:], cube[:4]]))


def test_the_reference_in_a_row_is_the_plan_for_its_time() -> None:
    run = picked_and_placed()
    rows, moving = run.rows, 0
    for phase, end in zip(run.phases, ends(run), strict=True):
        if phase.leg is None:
            still = rows["joints/q_ref"][phase.start : end]
            np.testing.assert_array_equal(still, np.tile(still[0], (len(still), 1)))
            assert not rows["joints/v_ref"][phase.start : end].any()
            continue
        plan = phase.leg.trajectory
        assert end - phase.start == plan.steps
        moving += plan.steps
        for signal, samples in (("q", plan.q), ("v", plan.v), ("a", plan.a)):
            part = rows[f"joints/{signal}_ref"][phase.start : end]
            np.testing.assert_array_equal(part, samples[:-1])
    assert moving > len(rows) / 2


def test_the_reference_never_jumps() -> None:
    rows = picked_and_placed().rows
    assert np.abs(np.diff(rows["joints/q_ref"], axis=0)).max() <= 2.0 * TIMESTEP
    moved = np.diff(rows["joints/q_ref"], axis=0) - rows["joints/v_ref"][:-1] * TIMESTEP
    assert np.abs(moved).max() < 3.0 * TIMESTEP**2


def test_references_of_another_instant_would_show_as_a_far_larger_error() -> None:
    rows = picked_and_placed().rows
    error = np.abs(rows["errors/q"]).max()
    ahead = np.abs(rows["joints/q_ref"][1:] - rows["joints/q"][:-1]).max()
    behind = np.abs(rows["joints/q_ref"][:-1] - rows["joints/q"][1:]).max()
    assert min(ahead, behind) > 5 * error
    moving = np.abs(rows["joints/v_ref"]).max(axis=1) > 0.5
    lag = np.sum((rows["errors/q"] * rows["joints/v_ref"])[moving])
    lag /= np.sum(rows["joints/v_ref"][moving] ** 2)
    assert abs(lag) < 0.1 * TIMESTEP


def test_the_tool_reference_is_where_the_joints_would_put_the_tool() -> None:
    rows, arm = picked_and_placed().rows, Arm(PANDA)
    for k in range(0, len(rows), 97):
        T = arm.pose(rows["joints/q_ref"][k])
        found = SE3(rows["tool/pose_ref"][k][[3, 4, 5, 6, 0, 1, 2]])
        np.testing.assert_allclose(found.as_matrix(), T.as_matrix(), atol=1e-12)
        T = arm.pose(rows["joints/q"][k])
        found = SE3(rows["tool/pose"][k][[3, 4, 5, 6, 0, 1, 2]])
        np.testing.assert_allclose(found.as_matrix(), T.as_matrix(), atol=1e-12)


def belief(run: Run, row: int) -> Arm:
    """What the controller should believe: the cube is in the hand from lift to lower."""
    index = int(run.rows["phase"][row, 0])
    leg = run.phases[index].leg
    return Arm(PANDA, None if leg is None else leg.waypoint.carried)


def let_go(run: Run, start: int) -> int:
    """Return after how many rows of a release the fingers press with less than the cube weighs."""
    lowered = run.legs[4].waypoint.carried
    assert isinstance(lowered, Payload)
    pressed = run.rows["gripper/force"][start:].min(axis=1) >= 9.81 * lowered.mass
    # The cube is believed in for as long, and its weight is on the arm.
    k = start + int(np.argmin(pressed)) - 2
    tau = Arm(PANDA, lowered).inverse_dynamics(*(run.rows[f"joints/{s}_ref"][k] for s in "qva"))
    np.testing.assert_allclose(run.rows["joints/tau_ref"][k], tau, atol=1e-9)
    return int(np.argmin(pressed)) + 2


def test_torques_follow_from_the_belief_the_reference_and_the_state_of_the_row() -> None:
    """Without an observer, whose estimates take the place of the state."""
    run = picked_and_placed(observer=None)
    rows, controller = run.rows, run.scenario.controller
    loaded = 0
    for phase, end in zip(run.phases, ends(run), strict=True):
        if phase.name == "close gripper":
            continue
        arm = belief(run, phase.start)
        loaded += arm.payload is not None
        settled = phase.start + round(PAYLOAD_RAMP / TIMESTEP)
        if phase.name == "release":
            settled += let_go(run, phase.start)
        for k in (settled, (settled + end) // 2, end - 1):
            q, v, a = (rows[f"joints/{s}_ref"][k] for s in "qva")
            tau = arm.inverse_dynamics(q, v, a)
            np.testing.assert_allclose(rows["joints/tau_ref"][k], tau, atol=1e-9)
            state = JointState(rows["joints/q"][k], rows["joints/v"][k])
            # The law sees the reference's velocity in the middle of the period that has ended.
            tau = controller.torque(arm, JointReference(q, v - 0.5 * TIMESTEP * a, a), state)
            np.testing.assert_allclose(rows["joints/tau_command"][k], tau, atol=1e-9)
    assert loaded == 3


def test_an_arm_that_believes_in_a_payload_pushes_against_its_weight() -> None:
    """The payload is not there: the arm rises by what its stiffness lets it."""
    T_tcp_com = SE3.identity()
    payload = Payload(mass=0.5, inertia=(1e-4,) * 3, T_tcp_com=T_tcp_com)
    plain = carry_out(Reach(), observer=None).rows
    fooled = carry_out(Reach(carried=payload), observer=None).rows
    k = round(0.5 * plain["joints/q"].shape[0])
    assert plain["phase"][k, 0] in (0, 1)
    up = slice(0, int(np.argmax(fooled["phase"][:, 0] == 1)))
    excess = (fooled["joints/tau_ref"] - plain["joints/tau_ref"])[up]
    J = Arm(PANDA).jacobian(PANDA.home)
    # At rest, tau = J^T f with f the weight, in the tool frame that points down.
    np.testing.assert_allclose(excess[0], J[:3].T @ [0.0, 0.0, -0.5 * 9.81], atol=1e-6)
    assert (fooled["tool/pose"][up][-1, 2] - plain["tool/pose"][up][-1, 2]) > 1e-3
    # On the way home nothing is carried.
    after = slice(up.stop, None)
    tau = fooled["joints/tau_ref"][after] - plain["joints/tau_ref"][after]
    assert np.abs(tau).max() < 1e-9
