"""Hand: one of several hands of a robot, what it holds, and its weight."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from mink import SE3

from robo47_qp.model.tool_poses import ToolPoses
from robo47_qp.motion.waypoint import Motion, Waypoint
from robo47_qp.run.failure import Cause, Condition
from robo47_qp.run.steps import Grasp, Release, StepLike, Wait
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.grasp_check import LEAST_SHARE, WIDTH_TOLERANCE
from robo47_qp.tasks.handling.pose_estimate import camera_errs

_AROUND, _GENTLY = 8e-3, 0.02
"""Opening beyond the width up to which the fingers close fast [m], and their rate then [m/s]."""
_STILL, _READINGS, _BETWEEN = 0.3, 20, 0.02
"""Time to come to rest [s], how many readings of a sensor are averaged, and the time between
two of the joints [s]."""
_PACE = 0.5
"""Pace on lines: on the first of a run, dry friction is not known yet [-]."""
_GRAVITY = 9.81


@dataclass(frozen=True, kw_only=True, eq=False)
class Hand:
    """One hand of a robot with several, by the name of its tool."""

    sensed: Sensed
    name: str

    @cached_property
    def place(self) -> int:
        """Its place among the robot's tools."""
        return self.sensed.robot.tool_index(self.name)

    def pose(self) -> SE3:
        """Return T_world_tcp."""
        return self.sensed.tool_pose(self.place)

    def target(self, T_world_tcp: SE3) -> ToolPoses:
        """Return the target of this hand alone."""
        return ToolPoses({self.name: T_world_tcp})

    def line(self, name: str, T_world_tcp: SE3) -> Waypoint:
        """Return a waypoint that this hand alone reaches on a straight line."""
        target = self.target(T_world_tcp)
        return Waypoint(name=name, target=target, motion=Motion.LIN, pace=_PACE)

    def against(self, width: float, force: float) -> str | None:
        """Return the evidence that something of a width [m] is not held; None if it is."""
        opening, pressing = self.sensed.width(self.place), self.sensed.finger_forces(self.place)
        part = float(self.sensed.sheet.noise["size_tolerance"])
        if abs(opening - width) > WIDTH_TOLERANCE + part * width:
            return (
                f"the fingers of the {self.name} hand are {1e3 * opening:.1f} mm apart, what it "
                f"is to hold measures {1e3 * width:.1f} mm"
            )
        if not _presses(pressing, force):
            return (
                f"the fingers of the {self.name} hand press with {pressing[0]:.1f} N and "
                f"{pressing[1]:.1f} N, {force:.1f} N were asked for"
            )
        return None

    def holds(self, width: float, force: float, cause: Cause) -> Condition:
        """Return the condition that something is held; a violation fails with `cause`."""
        return Condition(
            name=f"the {self.name} hand holds it",
            cause=cause,
            against=lambda: self.against(width, force),
        )

    def grasp(self, width: float, force: float) -> Generator[StepLike, None, None]:
        """Close the fingers on something of a width [m], gently; fails with GRASP."""
        name = f"close {self.name} hand"
        near = width + _AROUND
        if near < self.sensed.width(self.place):
            yield Grasp(name=name, tool=self.name, force=force, width=near)
        held = (self.holds(width, force, Cause.GRASP),)
        yield Grasp(name=name, tool=self.name, force=force, speed=_GENTLY, after=held)

    def release(self, name: str) -> Generator[StepLike, None, None]:
        """Open the fingers; where the camera errs, wait for an arm that had been pushed aside."""
        yield Release(name=name, tool=self.name)
        if camera_errs(self.sensed):
            yield Wait(name="settle", seconds=_STILL)

    def felt(self) -> Generator[StepLike, None, float]:
        """Return the vertical force on the hand at rest, by the sensor at its wrist [N]."""
        yield Wait(name="weigh", seconds=_STILL)
        readings: list[float] = []

        def against() -> str | None:
            readings.append(float(self.sensed.felt_force(self.place)[2]))
            return None if len(readings) >= _READINGS else "not read often enough"

        read = Condition(name="the sensor is read", cause=Cause.TIMEOUT, against=against)
        yield Wait(name="weigh", seconds=1.0, until=read)
        return float(np.mean(readings))

    def weigh(self, free: float) -> Generator[StepLike, None, float]:
        """Return the mass that hangs on the hand at rest [kg].

        Args:
            free: What was `felt` without it, shortly before: the sensor drifts [N].
        """
        now = yield from self.felt()
        return (free - now) / _GRAVITY


def still_poses(hands: Sequence[Hand]) -> Generator[StepLike, None, ToolPoses]:
    """Return T_world_tcp of hands at rest: the mean of some readings of their joints."""
    read: dict[str, list[SE3]] = {hand.name: [] for hand in hands}
    for _ in range(_READINGS):
        yield Wait(name="measure hands", seconds=_BETWEEN)
        for hand in hands:
            read[hand.name].append(hand.pose())
    return ToolPoses({name: _mean(poses) for name, poses in read.items()})


def _mean(poses: Sequence[SE3]) -> SE3:
    """Return the mean of poses that are close to each other."""
    first = poses[0]
    return first @ SE3.exp(np.mean([(first.inverse() @ pose).log() for pose in poses], axis=0))


def closed_on(simulation: Simulation, tool: int, width: float, force: float) -> bool:
    """Return whether fingers do press on something of a width [m], commanded a force [N]."""
    near = abs(simulation.width(tool) - width) <= WIDTH_TOLERANCE
    return near and _presses(simulation.last_finger_forces(tool), force)


def _presses(pressing: np.ndarray, force: float) -> bool:
    return bool(pressing.min() >= LEAST_SHARE * force)


def settled(there: Waypoint) -> Generator[StepLike, None, None]:
    """Tell the arms what they carry where they are, and wait until they have come up to it.

    Args:
        there: The waypoint that was reached last, with what is carried.
    """
    yield there
    yield Wait(name="settle", seconds=_STILL)
