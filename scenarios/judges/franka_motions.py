"""Random motions of the tool, one after the other: PTP, LIN and CIRC in turn."""

from dataclasses import dataclass

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Count, CountOrZero
from robo47_qp.errors import InvalidValueError
from robo47_qp.motion.waypoint import Motion, Waypoint, tool_down
from robo47_qp.run.failure import Cause, Failure, StepFailed
from robo47_qp.run.task import Program, Task
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation

LOW, HIGH = np.array([0.30, -0.40, 0.15]), np.array([0.65, 0.40, 0.60])
"""Corners of the box of all goals and all points through which arcs go [m]."""
TILT, YAW = np.radians(30.0), np.radians(90.0)
"""Largest angle of the tool to the vertical, and of its turn about that [rad]."""
_BOW = (0.1, 0.4)
"""Height of an arc over its chord, as a share of that [-]."""
_TRIES = 20
"""Draws for each motion: what cannot be planned is drawn anew."""


@dataclass(frozen=True, kw_only=True)
class RandomMotions(Task):
    """Move the tool to random poses in the free space before the arm."""

    draw: CountOrZero = 80_000
    """Seed of the poses."""
    count: Count = 20
    """Motions."""
    kinds: tuple[str, ...] = ("PTP", "LIN", "CIRC")
    """Kinds of motion, which take turns."""
    name: str = "random_motions"

    def __post_init__(self) -> None:
        """Check the fields; see `Checked`.

        Raises:
            InvalidValueError: There is no kind, or one is unknown.
        """
        super().__post_init__()
        known = [motion.name for motion in Motion]
        if not self.kinds or not set(self.kinds) <= set(known):
            raise InvalidValueError("kinds", self.kinds, f"some of {', '.join(known)}")

    @property
    def time_limit(self) -> float:
        """See `Task.time_limit` [s]."""
        return 30.0 * self.count

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`: there is nothing but the arm."""

    def program(self, sensed: Sensed) -> Program:
        """See `Task.program`."""
        rng, here = np.random.default_rng(self.draw), sensed.tool_pose()
        for i in range(self.count):
            for _ in range(_TRIES):
                goal = _pose(rng)
                try:
                    yield _way(rng, here, goal, Motion[self.kinds[i % len(self.kinds)]])
                except StepFailed as failed:
                    if failed.failure.cause not in (Cause.IK, Cause.PLAN):
                        raise
                    continue
                here = goal
                break
            else:
                return Failure(cause=Cause.PLAN, evidence=f"no motion {i} was found")
        return None

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`: a program that has ended has done all motions."""
        return None


def _way(rng: np.random.Generator, here: SE3, goal: SE3, motion: Motion) -> Waypoint:
    """Return a motion; an arc goes through a point aside of the middle, in the box."""
    through = None
    if motion is Motion.CIRC:
        start, end = here.translation(), goal.translation()
        side = np.cross(end - start, rng.normal(size=3))
        bow = rng.uniform(*_BOW) * np.linalg.norm(end - start)
        through = np.clip(0.5 * (start + end) + bow * side / np.linalg.norm(side), LOW, HIGH)
    return Waypoint(name=motion.name, target=goal, motion=motion, through=through)


def _pose(rng: np.random.Generator) -> SE3:
    """Return a pose in the box whose tool points down within `TILT`."""
    azimuth, tilt = rng.uniform(-np.pi, np.pi), rng.uniform(0.0, TILT)
    lean = SO3.exp(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
    down = tool_down(rng.uniform(LOW, HIGH), rng.uniform(-YAW, YAW))
    return SE3.from_rotation_and_translation(lean @ down.rotation(), down.translation())
