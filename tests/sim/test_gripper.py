"""The gripper of the simulated robot: its speed, its force, and when it has settled."""

import mujoco
import numpy as np
import pytest

from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.gripper import Grip
from robo47_qp.sim.simulation import Simulation
from tests.robots import GRIPPER
from tests.runs import Holder
from tests.sim.shelf import WEIGHT, N, grasp


def test_the_gripper_opens_and_closes_no_faster_than_its_speed(arm_alone: Simulation) -> None:
    holder, gripper = Holder(arm_alone), GRIPPER
    commands, speeds = [arm_alone.width_command()], []

    def look() -> None:
        commands.append(arm_alone.width_command())
        speeds.append(abs(arm_alone.width_speed()))

    for width in (0.0, gripper.width_max, 0.03, 0.0305):
        arm_alone.command_grip(Grip(width=width, force=30.0))
        holder.hold(1000, look)
        assert arm_alone.width() == pytest.approx(width, abs=1e-4)
        assert arm_alone.width_command() == width
        left, right = arm_alone.data.qpos[N : N + 2]
        assert left == pytest.approx(right, abs=1e-5)
    assert np.abs(np.diff(commands)).max() <= gripper.speed_max * TIMESTEP + 1e-12
    assert max(speeds) <= gripper.speed_max * 1.02
    # Full travel takes as long as the speed allows, not longer.
    arm_alone.command_grip(Grip(width=gripper.width_max, force=30.0))
    holder.hold(round((gripper.width_max - 0.0305) / gripper.speed_max / TIMESTEP) + 1)
    assert arm_alone.width_command() == gripper.width_max


@pytest.mark.parametrize("force", [3.0, 30.0, 70.0])
def test_each_finger_presses_with_the_force_asked_for(shelved: Simulation, force: float) -> None:
    grasp(shelved, force)
    model, data = shelved.model, shelved.data
    measured = {"left_finger": np.zeros(3), "right_finger": np.zeros(3)}
    for i in range(data.ncon):
        contact = data.contact[i]
        wrench = np.zeros(6)
        mujoco.mj_contactForce(model, data, i, wrench)
        bodies = [model.body(model.geom_bodyid[geom]).name for geom in contact.geom]
        finger = next(name for name in bodies if name in measured)
        measured[finger] += contact.frame.reshape(3, 3).T @ wrench[:3]
    sizes = [float(np.linalg.norm(f)) for f in measured.values()]
    # A finger bears half the weight besides its squeeze.
    expected = float(np.hypot(force, WEIGHT / 2))
    assert sizes == pytest.approx([expected, expected], rel=5e-3)
    assert shelved.last_finger_forces() == pytest.approx(sizes, rel=1e-3)
    assert shelved.grip_settled()


def test_a_second_grip_can_be_weaker_than_the_first(shelved: Simulation) -> None:
    holder = grasp(shelved, 70.0)
    shelved.command_grip(Grip(width=0.0, force=10.0))
    holder.hold(600)
    assert shelved.last_finger_forces() == pytest.approx([10.0, 10.0], rel=0.01)


def test_a_held_cube_hardly_creeps(shelved: Simulation) -> None:
    holder = grasp(shelved, 30.0)
    before = shelved.tool_pose().inverse() @ shelved.object_pose("cube")
    holder.hold(2000)
    after = shelved.tool_pose().inverse() @ shelved.object_pose("cube")
    shift = np.linalg.norm(after.translation() - before.translation())
    turn = np.linalg.norm((before.inverse() @ after).rotation().log())
    # Friction in MuJoCo is soft, and nothing removes the slip.
    assert shift / 2.0 < 5e-6
    assert turn / 2.0 < 1e-3


def test_an_open_grip_lets_the_cube_fall(shelved: Simulation) -> None:
    holder = grasp(shelved, 30.0)
    height = shelved.object_pose("cube").translation()[2]
    shelved.command_grip(Grip(width=0.08, force=30.0))
    holder.hold(400)
    assert shelved.object_pose("cube").translation()[2] < height - 0.1
    assert not shelved.last_finger_forces().any()


def test_a_grip_settles_at_the_width_asked_for(arm_alone: Simulation) -> None:
    holder = Holder(arm_alone)
    for width in (0.02, 0.06):
        holder.hold(200)
        assert arm_alone.grip_settled()
        arm_alone.command_grip(Grip(width=width, force=30.0))
        assert not arm_alone.grip_settled()
        settled: list[tuple[bool, float]] = []
        for _ in range(900):
            holder.hold(1)
            settled.append((arm_alone.grip_settled(), arm_alone.width()))
        first = next(i for i, (done, _) in enumerate(settled) if done)
        assert all(abs(where - width) < 1e-4 for done, where in settled if done)
        assert all(done for done, _ in settled[first:])


def test_a_grip_settles_on_an_object_before_the_servo_is_where_it_was_sent(
    shelved: Simulation,
) -> None:
    holder = Holder(shelved)
    shelved.command_grip(Grip(width=0.0, force=30.0))
    seen = []

    def look() -> None:
        if shelved.grip_settled():
            force, command = float(shelved.last_finger_forces().min()), shelved.width_command()
            seen.append((force, command, abs(shelved.width_speed())))

    holder.hold(900, look)
    assert seen
    assert seen[0][1] > 0.02
    assert all(force > 0.95 * 30.0 and speed < 1e-3 for force, _, speed in seen)


def test_a_finger_at_the_stop_of_a_short_grip_is_not_settled_by_pushing_the_wrong_way(
    shelved: Simulation,
) -> None:
    """The servo squeezes the cube with all its force; opening begins, it is not done."""
    grasp(shelved, 30.0)
    shelved.command_grip(Grip(width=0.08, force=30.0))
    assert not shelved.grip_settled()


@pytest.mark.parametrize("width", [-0.001, 0.081, np.nan])
def test_an_impossible_width_is_refused(arm_alone: Simulation, width: float) -> None:
    with pytest.raises(InvalidValueError, match=r"grip width must be (between 0 and|a finite)"):
        arm_alone.command_grip(Grip(width=width, force=30.0))


@pytest.mark.parametrize("force", [0.0, -1.0, 70.1, np.nan])
def test_an_impossible_force_is_refused(arm_alone: Simulation, force: float) -> None:
    with pytest.raises(InvalidValueError, match=r"grip force must be (above 0 and at|a finite)"):
        arm_alone.command_grip(Grip(width=0.04, force=force))


def test_a_refused_grip_changes_nothing(arm_alone: Simulation) -> None:
    Holder(arm_alone).hold(50)
    with pytest.raises(InvalidValueError):
        arm_alone.command_grip(Grip(width=0.04, force=1e3))
    assert arm_alone.grip_settled()
    Holder(arm_alone).hold(300)
    assert arm_alone.width() == pytest.approx(0.08, abs=1e-5)
