"""Worlds with errors in the compiled core, held to the same world period by period in Python."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pytest

from robo47_qp._core.library import using
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.control.computed_torque import ComputedTorque
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.model.arm import Arm
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.run.control_loop import ControlLoop
from robo47_qp.sim.delay import AHEAD
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.push import Push
from robo47_qp.sim.simulation import Simulation

MS = 1e-3
STEPS = 700
PUSHES = (
    Push(force=np.array([4.0, 0.0, 2.0]), start=0.1203, duration=0.05),
    Push(force=np.array([0.0, 6.0, 0.0]), start=0.3, duration=0.1),
)
CAMERA: dict[str, Any] = {
    "pose_bias": 2e-3,
    "pose_noise": 2e-3,
    "pose_noise_time": 0.3,
    "heading_noise": 0.03,
    "camera_latency": 50 * MS,
    "dropped_frames": 0.2,
    "outliers": 0.1,
}
LATE: dict[str, Any] = {"state_delay": (0.5 * MS, 1.2 * MS), "torque_delay": (0.5 * MS, 2.0 * MS)}
WRONG = {
    "all": Disturbance(
        noise_q=5e-5, noise_force=0.3, force_drift=1.0, dry_friction=0.4, **LATE, **CAMERA
    ),
    "pushes": Disturbance(noise_q=1e-4, pushes=PUSHES, **LATE),
    "fast camera": Disturbance(camera_rate=333.0, pose_noise=1e-3),
    "state late": Disturbance(state_delay=2.5 * MS),
    "torque late": Disturbance(torque_delay=3 * MS),
    "positions only": Disturbance(velocity_cutoff=0.0),
    "slow velocities": Disturbance(velocity_cutoff=30.0, pushes=PUSHES),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What was recorded, and what was sensed after every block."""

    rows: Matrix
    sensed: Matrix


def falling_box(spec: mujoco.MjSpec) -> None:
    body = spec.worldbody.add_body(name="box", pos=[0.5, 0.0, 1.2])
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02] * 3, mass=0.1)


def moved(robot: Robot, wrong: Disturbance, *, core: bool, backend: str = "compiled") -> Seen:
    """A motion with a grip in its middle, seen after every 20 periods; without `core`, in Python"""
    arm = Arm(robot)
    t = np.arange(STEPS + 1)[:, None] * MS
    size, w = 0.1 * np.cos(np.arange(arm.n)), 2.0 * np.pi / (STEPS * MS)
    q = arm.home + size * (1.0 - np.cos(w * t))
    motion = Trajectory(q=q, v=size * w * np.sin(w * t), a=size * w**2 * np.cos(w * t), dt=MS)
    sensed: list[Vector] = []

    def look() -> bool:
        pose, state = simulation.seen_pose("box"), simulation.state()
        time = [simulation.seen_time("box")]
        tools = range(len(robot.tools))
        felt = [
            read(i) for i in tools for read in (simulation.felt_force, simulation.last_tool_force)
        ]
        sensed.append(np.concatenate([pose.wxyz_xyz, *state, *felt, time]))
        if len(sensed) == 10:
            simulation.command_grip(Grip(width=0.02, force=20.0))
        return False

    with using(backend):
        rng = np.random.default_rng(4)
        simulation = DisturbedSimulation(robot, falling_box, wrong, rng)
        if not core:
            simulation._compiled = None
        assert (simulation.compiled is not None) == (core and backend == "compiled")
        loop = ControlLoop(arm, ComputedTorque(), simulation, observer=DisturbanceObserver())
        loop.begin("move")
        loop.track(motion, look)
    return Seen(rows=loop.recording.rows().values.copy(), sensed=np.array(sensed))


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_world_in_the_core_is_that_of_python_to_the_bit(name: str) -> None:
    one = moved(PANDA, WRONG[name], core=True)
    other = moved(PANDA, WRONG[name], core=False)
    np.testing.assert_array_equal(one.rows, other.rows)
    np.testing.assert_array_equal(one.sensed, other.sensed)


def test_two_arms_whose_joints_lie_apart_run_in_the_core() -> None:
    robot = panda_pair()
    one = moved(robot, WRONG["all"], core=True)
    other = moved(robot, WRONG["all"], core=False)
    np.testing.assert_array_equal(one.rows, other.rows)
    np.testing.assert_array_equal(one.sensed, other.sensed)


def test_a_wrong_world_in_the_core_is_that_of_numpy() -> None:
    """They differ by rounding, which observer, delays and contacts amplify."""
    one = moved(PANDA, WRONG["all"], core=True)
    other = moved(PANDA, WRONG["all"], core=False, backend="numpy")
    np.testing.assert_allclose(one.rows, other.rows, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(one.sensed, other.sensed, rtol=0.0, atol=1e-8)


def test_a_world_starts_anew_with_the_same_errors() -> None:
    rng = np.random.default_rng(4)
    simulation = DisturbedSimulation(PANDA, falling_box, WRONG["all"], rng)
    runs = []
    for _ in range(2):
        simulation.reset()
        loop = ControlLoop(Arm(PANDA), ComputedTorque(), simulation)
        loop.begin("hold")
        loop.hold(0.6)  # beyond the numbers that are drawn at once
        runs.append(loop.recording.rows().values.copy())
    np.testing.assert_array_equal(runs[0], runs[1])


def test_the_core_runs_every_world_but_one_that_a_test_steps_itself() -> None:
    class Another(Simulation):
        """A world that overrides what the core does."""

    assert Simulation(PANDA, falling_box).compiled is not None
    assert Another(PANDA, falling_box).compiled is None
    with using("numpy"):
        assert Simulation(PANDA, falling_box).compiled is None


def test_python_steps_while_a_push_acts_and_the_core_up_to_the_next_one() -> None:
    simulation = DisturbedSimulation(PANDA, falling_box, Disturbance(pushes=PUSHES))
    ahead = {}
    for k in range(450):
        ahead[k] = simulation.ahead()
        simulation.step(simulation.motor_torque())
    assert [ahead[k] for k in (0, 100, 119)] == [120, 20, 1]
    # The wrist still feels a push in the period after it.
    assert not any(ahead[k] for k in range(120, 171))
    assert [ahead[k] for k in (171, 299)] == [129, 1]
    assert not any(ahead[k] for k in range(300, 401))
    assert ahead[401] == AHEAD
