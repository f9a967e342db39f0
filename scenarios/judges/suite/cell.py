"""Stations: robosuite's Pandas as programs see and move them, through what a client observes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, ClassVar

import numpy as np
from mink import SE3, SO3
from numpy.typing import ArrayLike

from robo47_qp.arrays import Vector
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile, Robot
from robo47_qp.model.robots import load_robot
from robo47_qp.model.tool_poses import Target
from robo47_qp.motion.following.lin import Lin
from robo47_qp.motion.paths.segments import PathProfile
from robo47_qp.motion.planner import Planner
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.motion.waypoint import Motion, Waypoint
from robo47_qp.run.failure import Cause
from robo47_qp.stack import ClassicalStack

DT = 0.002
"""Time between samples of planned motions: robosuite's own step [s]."""
HOME = np.array([0.0, np.pi / 16, 0.0, -np.pi / 2 - np.pi / 3, 0.0, np.pi - 0.2, np.pi / 4])
"""Where robosuite's Panda starts [rad] (robosuite 1.5.2, panda_robot.py)."""
PROFILE = MotionProfile(
    v_max=np.full(7, 1.8),
    a_max=np.array([4.0, 4.0, 4.0, 4.0, 4.0, 2.5, 2.5]),
    j_max=np.full(7, 30.0),
)
"""Bounds of the joints [rad/s, rad/s², rad/s³]: robosuite's links have several times the inertia
of the real ones, and its motors 80 N·m and 12 N·m."""
TURN = 1.0
"""Largest angular speed of the hand [rad/s]. Robosuite's worlds are full of air (1.2 kg/m³), which
acts on each body as on a box of its mass and inertia, and fingertips of 10 g and 0.01 kg m² are
cubes of 2.4 m: they take 6.6 N·m at 1 rad/s, and grow with its square to all of the wrist's 12."""
TOOL = PathProfile(linear=(0.5, 2.0, 20.0), angular=(TURN, 5.0, 50.0))
"""Bounds of the tool on lines."""
FINGERTIPS, WIPER = 0.097, 0.03
"""From robosuite's hand to the grip site of its gripper, and of its wiper [m] (panda_gripper.xml,
wiping_gripper.xml)."""
OPEN, CLOSED = -1.0, 1.0
"""Commands of robosuite's gripper."""
FINGERS = 0.8
"""Time that the fingers take at most [s]."""
NOTHING = 0.004
"""Width at which there is nothing between the fingers [m]."""
LOOKS = 30
"""Places on a motion in joint space at which is looked how fast the hand turns."""
ARRIVED, LATE = 0.005, 1.0
"""How near the joints must come to where they are led [rad], and how much later they may [s]."""

Ticks = Iterator[None]
"""What a program is made of: each step of it is one period of the client."""


class Failed(Exception):  # noqa: N818  # a failure of the robot, like StepFailed
    """A program that cannot go on, with its cause and evidence."""

    def __init__(self, cause: Cause, evidence: str) -> None:
        super().__init__(f"{cause.value}: {evidence}")


def panda() -> Robot:
    """The Panda, which starts where robosuite's does."""
    return replace(load_robot("panda"), home=HOME)


def position(seen: Mapping[str, Any], name: str) -> Vector:
    """A measured position in the world of robosuite (3,) [m]."""
    return np.asarray(seen[f"{name}_pos"], float)


@dataclass(frozen=True)
class Axis:
    """An axis that something turns about, in the frame of the robot's base."""

    point: Vector
    direction: Vector

    def turned(self, pose: SE3, angle: float) -> SE3:
        """A pose after a turn [rad]."""
        turn = SO3.exp(angle * self.direction)
        there = SE3.from_rotation_and_translation(turn, self.point - turn.apply(self.point))
        return there @ pose


@dataclass(eq=False)
class Station:
    """Arms, their grippers and what is seen, of one episode."""

    arms: ClassVar[int]
    """How many arms there are."""

    seen: Mapping[str, Any]
    """Robosuite's last observations, by its own names."""
    grip_site: float = FINGERTIPS
    """Distance of the grip site from the hand [m]."""

    def __post_init__(self) -> None:
        bases = [
            SE3.from_rotation_and_translation(SO3(base[3:].copy()), base[:3])
            for base in np.asarray(self.seen["bases"], float)
        ]
        self.T_suite_base, robot = self.model(bases)
        self.T_base_suite = self.T_suite_base.inverse()
        # Robosuite's hand stands 0.1065 m beyond the last link, ours 0.107 m and the tool 0.1034 m
        # beyond it (panda/robot.xml). Programs name poses of the grip site, turned like our tool:
        # the fingers close along y.
        beyond = 0.1065 + self.grip_site - 0.107 - 0.1034
        self.T_tcp_grip = SE3.from_translation(np.array([0.0, 0.0, beyond]))
        self.arm = Arm(robot)
        self.profile = reduce(MotionProfile.followed_by, [PROFILE] * self.arms)
        self.planner = Planner(
            ik=ClassicalStack().solver(), profile=self.profile, lin=Lin(profile=TOOL)
        )
        self._quick = ClassicalStack(ik="lm").solver()
        self._stride = round(1.0 / (float(self.seen["rate"]) * DT))
        self._kp = float(self.seen["kp"])
        self.q = self.measured_q
        self.goal, self.grips = self.q.copy(), np.full(self.arms, OPEN)

    def model(self, bases: Sequence[SE3]) -> tuple[SE3, Robot]:
        """The frame in which programs name poses, in robosuite's world, and the arms in it.

        Args:
            bases: Where the arms stand in robosuite's world.
        """
        raise NotImplementedError

    def pose(self, name: str) -> SE3:
        """The measured pose of a thing in the frame of the base; of a pair, in the world."""
        x, y, z, w = np.asarray(self.seen[f"{name}_quat"], float)
        R = SO3(np.array([w, x, y, z]) / np.linalg.norm([w, x, y, z]))
        return self.T_base_suite @ SE3.from_rotation_and_translation(R, position(self.seen, name))

    def place(self, name: str) -> Vector:
        """The measured position of a thing in the frame of the robot's base (3,) [m]."""
        return self.T_base_suite.apply(position(self.seen, name))

    def here(self, point: Vector) -> Vector:
        """A point that robosuite's data sheet gives in its world, in that of the base (3,) [m]."""
        return self.T_base_suite.apply(np.asarray(point, float))

    @property
    def widths(self) -> Vector:
        """Distances between the fingers (arms,) [m]."""
        fingers = [self.seen[f"robot{i}_gripper_qpos"] for i in range(self.arms)]
        return np.array([left - right for left, right in np.asarray(fingers, float)])

    @property
    def measured_q(self) -> Vector:
        """The measured joints (7 arms,) [rad]."""
        joints = [self.seen[f"robot{i}_joint_pos"] for i in range(self.arms)]
        return np.concatenate(joints, dtype=float)

    @property
    def actions(self) -> Vector:
        """What the client is answered: each arm's joints, and its gripper's command if it has
        fingers."""
        parts: list[Vector] = []
        for i, goal in enumerate(np.split(self.goal, self.arms)):
            fingers = np.size(self.seen.get(f"robot{i}_gripper_qpos", ())) == 2
            parts += [goal, self.grips[i : i + 1]] if fingers else [goal]
        return np.concatenate(parts)

    def to(
        self,
        T_base_grip: Target,
        *,
        line: bool = False,
        pace: float = 1.0,
        then: Sequence[Target] = (),
    ) -> Ticks:
        """Move the grip sites to poses, on straight lines or as the joints please.

        Args:
            T_base_grip: The pose, or those of several arms by the names of their tools.
            line: On a straight line.
            pace: Ratio of the speeds to those of the profiles.
            then: Poses that lines will lead to from there: the joints are chosen so that they can.
        """
        onward = tuple(self._waypoint(pose, Motion.LIN, 1.0) for pose in then)
        if line:
            yield from self.follow(self._waypoint(T_base_grip, Motion.LIN, pace))
            return
        yield from self.follow(self._waypoint(T_base_grip, Motion.PTP, pace, onward))
        yield from self._arrive()

    def _arrive(self) -> Ticks:
        """Wait until the joints are where they were led.

        Raises:
            Failed: They do not come there.
        """
        for _ in range(self._periods(LATE)):
            if np.abs(self.measured_q - self.q).max() < ARRIVED:
                return
            yield
        far = 1e3 * np.abs(self.measured_q - self.q).max()
        raise Failed(Cause.TRACK, f"{far:.0f} mrad from the end of a motion")

    def tcp(self, T_base_grip: SE3) -> SE3:
        """The pose of the tool frame with which a grip site is at a pose."""
        return T_base_grip @ self.T_tcp_grip.inverse()

    def _waypoint(
        self, pose: Target, motion: Motion, pace: float, onward: tuple[Waypoint, ...] = ()
    ) -> Waypoint:
        if isinstance(pose, SE3):
            target: Target = self.tcp(pose)
        else:
            target = pose.each(lambda _, one: self.tcp(one))
        name = "line" if motion is Motion.LIN else "way"
        return Waypoint(name=name, target=target, motion=motion, pace=pace, onward=onward)

    def planned(self, waypoint: Waypoint) -> Trajectory:
        """The motion to a waypoint; in joint space as slow as the hands must turn."""
        trajectory = self.planner.plan(self.arm, waypoint, self.q, DT).trajectory
        if waypoint.motion is not Motion.PTP:
            return trajectory
        start, end = trajectory.q[0], trajectory.q[-1]
        looks = start + np.linspace(0.0, 1.0, LOOKS)[:, None] * (end - start)
        turns = [
            np.linalg.norm(self.arm.jacobian(q, tool)[3:] @ (end - start))
            for q in looks
            for tool in range(self.arms)
        ]
        slow = np.abs(end - start) * TURN / max(float(max(turns)), 1e-6) + 1e-6
        profile = self.profile.slowed(waypoint.pace)
        return plan_ptp(start, end, replace(profile, v_max=np.minimum(profile.v_max, slow)), DT)

    def follow(self, waypoint: Waypoint) -> Ticks:
        """Command the motion to a waypoint; the reference is the middle of each period."""
        trajectory = self.planned(waypoint)
        ratio = 2.0 / np.sqrt(self._kp)
        last = trajectory.steps
        for k in range(self._stride // 2, last + self._stride, self._stride):
            i = min(k, last)
            self.q = trajectory.q[i]
            # Robosuite's controller damps the velocity itself, not its error:
            # M (kp (goal - q) - 2 sqrt(kp) v).
            self.goal = self.q + ratio * trajectory.v[i] + trajectory.a[i] / self._kp
            yield
        self.q = self.goal = trajectory.q[-1]

    def wait(self, seconds: float) -> Ticks:
        """Stay."""
        for _ in range(self._periods(seconds)):
            yield

    def _periods(self, seconds: float) -> int:
        return round(seconds / (self._stride * DT))

    def open(self, seconds: float = 0.4) -> Ticks:
        """Open the fingers."""
        self.grips[:] = OPEN
        yield from self.wait(seconds)

    def close(self) -> Ticks:
        """Close the fingers until they rest; something must be between those of each hand.

        Raises:
            Failed: There is nothing.
        """
        self.grips[:], before = CLOSED, np.full(self.arms, np.inf)
        for k in range(self._periods(FINGERS)):
            yield
            if k > 10 and np.abs(before - self.widths).max() < 2e-5:
                break
            before = self.widths
        self.check_held()

    def check_held(self) -> None:
        """Check that something is between the fingers of each hand.

        Raises:
            Failed: There is nothing.
        """
        least = self.widths.min()
        if least < NOTHING:
            raise Failed(Cause.GRASP, f"the fingers closed to {1e3 * least:.1f} mm")


@dataclass(eq=False)
class Cell(Station):
    """One arm; poses are those in the frame of its base."""

    arms: ClassVar[int] = 1

    def model(self, bases: Sequence[SE3]) -> tuple[SE3, Robot]:
        """See `Station.model`."""
        return bases[0], panda()

    @property
    def tool(self) -> SE3:
        """T_base_grip at the last reference."""
        return self.arm.pose(self.q) @ self.T_tcp_grip

    @property
    def measured_tool(self) -> SE3:
        """T_base_grip from the measured joints."""
        return self.arm.pose(self.measured_q) @ self.T_tcp_grip

    def by(self, shift: ArrayLike, *, pace: float = 1.0) -> Ticks:
        """Move the grip site by (3,) [m] in the frame of the base, on a straight line."""
        yield from self.to(moved(self.tool, shift), line=True, pace=pace)

    def around(self, axis: Axis, angle: float, *, pace: float = 1.0) -> Ticks:
        """Turn the grip site about an axis [rad]."""
        start = self.tool
        middle, end = (self.tcp(axis.turned(start, part * angle)) for part in (0.5, 1.0))
        waypoint = Waypoint(
            name="turn",
            target=end,
            motion=Motion.CIRC,
            through=middle.translation(),
            pace=pace,
        )
        yield from self.follow(waypoint)

    def reaches(self, T_base_grip: SE3) -> bool:
        """Whether inverse kinematics finds the arm a way to hold the grip site at a pose."""
        return self._quick.solve(self.arm, self.tcp(T_base_grip), self.arm.home).converged


def moved(pose: SE3, shift: ArrayLike) -> SE3:
    """A pose moved by (3,) [m] in the frame that it is given in."""
    return SE3.from_rotation_and_translation(
        pose.rotation(), pose.translation() + np.asarray(shift, float)
    )
