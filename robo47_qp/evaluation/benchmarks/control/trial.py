"""Trial: one motion under one controller and one disturbance, and what came of it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf

import mujoco
import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.control.active import ActiveController
from robo47_qp.control.controller import Controller
from robo47_qp.evaluation.benchmarks.control.settled import settled_after
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Robot
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation

AT_REST = 2.0
"""How long the arm is watched after the motion [s]."""
PUSHED_AFTER, PUSH = 0.3, 0.2
"""When a push begins, after the motion, and how long it lasts [s]."""
TOLD_AFTER = 1.0
"""When the controller is told of the payload, after the motion, if it is [s]."""
_LAST = 0.2
"""The end, over which the remaining error is averaged [s]."""
_CALM = 0.1
"""Joint speed that no stable arm has at the end [rad/s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialCondition:
    """What is wrong, by name."""

    name: str
    disturbance: Disturbance = field(default_factory=Disturbance)
    told: Payload | None = None
    """What the controller learns of its payload while it holds still."""
    seed: int = 0
    """Of the sensor noise: the same for every controller."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """What happened."""

    controller: str
    condition: str
    moving: int
    """Periods of the motion; those after it are at rest."""
    joint_errors: Matrix
    """q_ref - q (N, n) [rad]."""
    tool_errors: Matrix
    """Tool from its reference, in the world (N, 3) [m]."""
    torque_use: Vector
    """Largest torque as a fraction of its limit (N,) [-]."""
    stable: bool
    """Whether the arm was calm at the end."""

    def figures(self) -> dict[str, float | bool | None]:
        """The numbers, by name with unit; None where the arm did not settle."""
        size = np.linalg.norm(self.tool_errors, axis=1)
        last, told = round(_LAST / TIMESTEP), self.moving + round(TOLD_AFTER / TIMESTEP)
        onset = self.moving + round(PUSHED_AFTER / TIMESTEP)
        settled = settled_after(self.tool_errors, self.moving, onset, round(PUSH / TIMESTEP))
        return {
            "max_joint_error_rad": float(np.abs(self.joint_errors[: self.moving]).max()),
            "max_tool_error_m": float(size[: self.moving].max()),
            "rms_tool_error_m": float(np.sqrt((size[: self.moving] ** 2).mean())),
            "max_tool_error_at_rest_m": float(size[self.moving :].max()),
            "tool_error_before_told_m": float(size[told - last : told].mean()),
            "last_tool_error_m": float(size[-last:].mean()),
            "settling_time_s": None if settled == inf else settled,
            "peak_torque_use": float(self.torque_use.max()),
            "stable": self.stable,
        }


class Bench:
    """The motion that every controller makes: from home to a goal, then at rest."""

    def __init__(self, robot: Robot, offset: Sequence[float]) -> None:
        """Plan the motion at the default profile, to an offset from home [rad]."""
        self.robot, self.arm = robot, Arm(robot)
        goal = self.arm.home + np.asarray(offset, dtype=np.float64)
        self.way: Trajectory = plan_ptp(self.arm.home, goal, robot.profile, TIMESTEP)
        self.duration = self.way.duration + AT_REST
        self._goal = self.way.end
        self._tool = np.array([self.arm.pose(q).translation() for q in self.way.q])

    def run(self, name: str, controller: Controller, condition: TrialCondition) -> Trial:
        """Make the motion once."""
        rng = np.random.default_rng(condition.seed)
        sim = DisturbedSimulation(self.robot, _nothing, condition.disturbance, rng)
        active = ActiveController(controller, self.arm, dt=TIMESTEP)
        steps, moving = round(self.duration / TIMESTEP), self.way.steps
        told = None if condition.told is None else moving + round(TOLD_AFTER / TIMESTEP)
        q, tool = np.empty((steps, self.arm.n)), np.empty((steps, 3))
        use, speed = np.empty(steps), np.empty(steps)
        for k in range(steps):
            if k == told:
                active.set_arm(self.arm.with_payload(condition.told))
            true = sim.true_state()
            q[k], tool[k] = true.q, sim.tool_pose().translation()
            speed[k] = np.abs(true.v).max()
            sim.step(active.torque(self._reference(k), sim.state()))
            use[k] = np.abs(sim.last_torque() / self.robot.tau_max).max()
        index = np.minimum(np.arange(steps), moving)
        return Trial(
            controller=name,
            condition=condition.name,
            moving=moving,
            joint_errors=self.way.q[index] - q,
            tool_errors=self._tool[index] - tool,
            torque_use=use,
            stable=bool(speed[-round(_LAST / TIMESTEP) :].max() < _CALM),
        )

    def _reference(self, k: int) -> JointReference:
        if k >= self.way.steps:
            return self._goal
        return JointReference(self.way.q[k], self.way.v[k], self.way.a[k])


def _nothing(spec: mujoco.MjSpec) -> None:
    """The robot is alone."""
