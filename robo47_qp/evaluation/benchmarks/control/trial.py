"""Trial: one motion under one controller and one disturbance."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf

import mujoco
import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.control.controller import Controller
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.evaluation.benchmarks.settling.settling import settling_after_disturbance
from robo47_qp.model.arm import Arm
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Robot
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.run.control_loop import ControlLoop
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation

AT_REST = 2.0
"""Time at rest after the motion [s]."""
PUSHED_AFTER, PUSH = 0.3, 0.2
"""When a push begins, after the motion, and how long it lasts [s]."""
TOLD_AFTER = 1.0
"""Time after the motion at which a payload is told at rest [s]."""
_LAST = 0.2
"""Final time over which the remaining error is averaged [s]."""
_CALM = 0.1
"""Joint speed at the end from which the arm counts as unstable [rad/s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialCondition:
    """A named disturbance."""

    name: str
    disturbance: Disturbance = field(default_factory=Disturbance)
    told: Payload | None = None
    """Payload that is set in the controller before it moves."""
    told_at_rest: Payload | None = None
    """Payload that is set in the controller while it holds still at the end."""
    seed: int = 0
    """Of the sensor noise: the same for every controller."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """Errors and torques of one motion, and its figures."""

    controller: str
    condition: str
    again: int
    """Period in which the last leg of the motion begins."""
    moving: int
    """Periods of the motion; those after it are at rest."""
    joint_errors: Matrix
    """q_ref - q (N, n) [rad]."""
    tool_errors: Matrix
    """Error of the tool position, in the world (N, 3) [m]."""
    torque_use: Vector
    """Largest torque as a fraction of its limit (N,) [-]."""
    stable: bool
    """True if the arm was at rest at the end."""

    def figures(self) -> dict[str, float | bool | None]:
        """The numbers, by name with unit; None where the arm did not settle."""
        size = np.linalg.norm(self.tool_errors, axis=1)
        last, told = round(_LAST / TIMESTEP), self.moving + round(TOLD_AFTER / TIMESTEP)
        onset = self.moving + round(PUSHED_AFTER / TIMESTEP)
        settled = settling_after_disturbance(
            self.tool_errors, self.moving, onset, round(PUSH / TIMESTEP)
        )
        return {
            "max_joint_error_rad": float(np.abs(self.joint_errors[: self.moving]).max()),
            "max_joint_error_again_rad": float(
                np.abs(self.joint_errors[self.again : self.moving]).max()
            ),
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
    """The motion that every controller makes: from home to a goal, back, and there again.

    Then it is at rest. Without a joint that turns, what is learned of friction would be worth
    nothing.
    """

    def __init__(self, robot: Robot, offset: Sequence[float]) -> None:
        """Plan the motion at the default profile, to an offset from home [rad]."""
        self.robot, self.arm = robot, Arm(robot)
        home = self.arm.home
        goal = home + np.asarray(offset, dtype=np.float64)
        ends = (home, goal), (goal, home), (home, goal)
        self.legs: tuple[Trajectory, ...] = tuple(
            plan_ptp(start, end, robot.profile, TIMESTEP) for start, end in ends
        )

    @property
    def duration(self) -> float:
        """Time until it is at rest [s]."""
        return sum(leg.duration for leg in self.legs)

    def run(
        self,
        name: str,
        controller: Controller,
        condition: TrialCondition,
        observer: DisturbanceObserver | None = None,
    ) -> Trial:
        """Make the motion once."""
        rng = np.random.default_rng(condition.seed)
        sim = DisturbedSimulation(self.robot, _empty_scene, condition.disturbance, rng)
        loop = ControlLoop(self._arm(condition.told), controller, sim, observer=observer)
        for leg in self.legs:
            loop.track(leg)
        loop.hold(TOLD_AFTER)
        if condition.told_at_rest is not None:
            loop.control.set_arm(self._arm(condition.told_at_rest))
        loop.hold(AT_REST - TOLD_AFTER)
        rows = loop.recording.rows()
        speed = np.abs(rows["joints/v"]).max(axis=1)
        return Trial(
            controller=name,
            condition=condition.name,
            again=sum(leg.steps for leg in self.legs[:-1]),
            moving=sum(leg.steps for leg in self.legs),
            joint_errors=rows["joints/q_ref"] - rows["joints/q"],
            tool_errors=(rows["tool/pose_ref"] - rows["tool/pose"])[:, :3],
            torque_use=np.abs(rows["joints/tau"] / self.robot.tau_max).max(axis=1),
            stable=bool(speed[-round(_LAST / TIMESTEP) :].max() < _CALM),
        )

    def _arm(self, payload: Payload | None) -> Arm:
        """What the controller believes."""
        return self.arm if payload is None else self.arm.with_payload(payload)


def _empty_scene(spec: mujoco.MjSpec) -> None:
    """The robot is alone."""
