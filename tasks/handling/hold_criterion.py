"""Hold criterion: whether the tool is held at a sequence of poses, one after the other."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import mujoco
import numpy as np
from mink import SE3
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Vector
from robo47_qp.run.failure import Cause, Condition, Failure
from robo47_qp.run.steps import Wait
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.task_state import add_task_state, hide_marker, is_visible, task_state

STILL = 2e-3
"""Joint speed below which an arm counts as at rest [rad/s]."""
_HOME = 0.01
"""Largest distance of a joint from home at the end [rad]."""
HOME_WORDS = f"every joint within {_HOME:g} rad of home (slides: m)"
"""What the end of the motion must be, in words."""
_PATIENCE = 20.0
"""Longest time to wait until a pose counts as held, beside the time that is asked for [s]: the arm
comes to rest, or comes back from where it was pushed."""
_SURE, _QUIVER = 0.2, 1e4
"""Time for which a program stays longer than is asked for [s], and by how much for each radian of
noise of the measured positions [s/rad]: joints with friction quiver by it, unseen."""
_WHILE = 0.3
"""Time over which measured positions tell how fast the joints are [s]."""
_ROUNDING = 1e-6
"""Tolerance for sums of control periods [s]."""


@dataclass(frozen=True, kw_only=True)
class HoldCriterion:
    """The conditions under which a pose counts as held.

    Poses must be held in order. Each has a marker, which is hidden once its pose was held.
    """

    position_tolerance: float
    """Largest distance of the tool point from the pose [m]."""
    turn_tolerance: float
    """Largest angle between the tool and the pose [rad]."""
    seconds: float
    """Uninterrupted time at the pose [s]."""
    speed: float = inf
    """Largest joint speed [rad/s]; inf if only the tolerances count."""

    @staticmethod
    def add_state(spec: mujoco.MjSpec) -> None:
        """Reserve task state in a scene for the time at which the tool arrived at the pose."""
        add_task_state(spec, 1)

    @staticmethod
    def reset(simulation: Simulation) -> None:
        """Clear the task state for a new episode."""
        task_state(simulation)[:] = 0.0

    def monitor(self, simulation: Simulation, markers: Sequence[str]) -> None:
        """Check the first remaining pose, and hide its marker once it was held."""
        marker = next((name for name in markers if is_visible(simulation, name)), None)
        if marker is None:
            return
        note, goal = task_state(simulation), simulation.marker_pose(marker)
        if not self._rests(simulation, goal):
            # No pose is held since time 0, so 0 means "not there".
            note[0] = 0.0
            return
        since, broken = self._since(simulation, goal)
        if broken or note[0] == 0.0:
            note[0] = max(since, 1e-3 * _ROUNDING)
        if simulation.time - note[0] >= self.seconds - _ROUNDING:
            hide_marker(simulation, marker)
            note[0] = 0.0

    def hold(self, sensed: Sensed, marker: str) -> Wait:
        """Return a step that stays until the pose of a marker was held, also if the tool is pushed
        off it meanwhile."""
        seconds = self.seconds + _PATIENCE
        return Wait(name=f"hold {marker}", seconds=seconds, until=self.held(sensed, marker))

    def held(self, sensed: Sensed, marker: str) -> Condition:
        """Return the condition that the pose of a marker was held, as far as sensors tell.

        The tool is to be within the tolerances, and the joints at rest, for as long as is asked
        for. How fast they are is how their measured positions change over a while: velocities that
        are measured are noisy. A marker that is hidden is taken to be where it was.
        """
        goal, robot = sensed.seen_pose(marker), sensed.robot
        still, unit = replace(self, speed=inf), robot.unit("mrad/s", "mm/s")
        long = self.seconds + _SURE + _QUIVER * float(sensed.sheet.noise["noise_q"])
        readings: deque[tuple[float, Vector]] = deque()
        since = inf

        def against() -> str | None:
            nonlocal since, goal
            if not sensed.is_hidden(marker):
                goal = sensed.seen_pose(marker)
            now = sensed.time
            if not readings or readings[-1][0] < now:
                readings.append((now, sensed.state().q))
            while now - readings[0][0] > _WHILE + _ROUNDING:
                readings.popleft()
            off = still._off(goal, sensed.tool_pose(), 0.0, marker, unit)
            speed = _speed(readings)
            if off is None and speed == inf:
                off = f"for how long the tool is at {marker} tells little of its speed yet"
            elif off is None and speed > self.speed:
                off = f"the fastest joint moves at {1e3 * speed:.1f} {unit}, as far as is measured"
            if off is not None:
                since = inf
                return off
            since = min(since, now)
            if now - since < long - _ROUNDING:
                return f"the tool has been at {marker} for {now - since:.2f} s"
            return None

        return Condition(name=f"{marker} was held", cause=Cause.TRACK, against=against)

    @property
    def words(self) -> str:
        """What holding a pose means, in words."""
        return f"each pose in order for {self.seconds:g} s within {self._allowed} in every period"

    def verdict(self, simulation: Simulation, markers: Sequence[str]) -> Failure | None:
        """Return why not all poses were held or the arm is not home; None on success."""
        measures = self.measures(simulation, markers)
        left, away = round(measures["poses_left"]), float(simulation.from_home().max())
        against = []
        if left:
            against.append(
                f"{left} of {len(markers)} poses are left, {markers[-left]} the first: each is to "
                f"be held for {self.seconds:.2f} s within {self._allowed}"
            )
        if away > _HOME:
            unit = simulation.robot.unit("rad", "m")
            against.append(f"a joint is {away:.3f} {unit} from home; allowed are {_HOME} {unit}")
        return Failure(cause=Cause.PLACE, evidence=", and ".join(against)) if against else None

    def measures(self, simulation: Simulation, markers: Sequence[str]) -> dict[str, float]:
        """Return the number of remaining poses [-] and the largest distances from home: of a
        joint that turns [rad] and, where there is one, of a joint that slides [m]."""
        units, away = np.array(simulation.robot.units), simulation.from_home()
        found = {"poses_left": float(sum(is_visible(simulation, name) for name in markers))}
        for unit in dict.fromkeys(["rad", *units.tolist()]):
            found[f"home_error_{unit}"] = float(away[units == unit].max(initial=0.0))
        return found

    def _since(self, simulation: Simulation, goal: SE3) -> tuple[float, bool]:
        """Return since when the tool, which is at a goal now, has been there at most since the last
        look [s], and whether it was not there in between."""
        if simulation.lately is None:
            return simulation.time, False
        poses, v = simulation.lately("tool/pose"), simulation.lately("joints/v")
        off = np.linalg.norm(poses[:, :3] - goal.translation(), axis=1)
        R_goal = Rotation.from_quat(goal.rotation().wxyz, scalar_first=True)
        turn = (R_goal.inv() * Rotation.from_quat(poses[:, 3:], scalar_first=True)).magnitude()
        fast = np.abs(v).max(axis=1)
        away = (off > self.position_tolerance) | (turn > self.turn_tolerance) | (fast > self.speed)
        times = [*simulation.lately("time")[:, 0].tolist(), simulation.time]
        rows = np.flatnonzero(away)
        return times[int(rows[-1]) + 1 if len(rows) else 0], len(rows) > 0

    def _rests(self, simulation: Simulation, goal: SE3) -> bool:
        """Do the same as `_against`, but fast if the tool is far away."""
        off = goal.translation() - simulation.tool_pose().translation()
        if float(off @ off) > (2.0 * self.position_tolerance) ** 2:
            return False
        return self._against(simulation, "", goal) is None

    def _against(self, simulation: Simulation, marker: str, T_world_goal: SE3) -> str | None:
        speed = float(np.abs(simulation.true_state().v).max())
        unit = simulation.robot.unit("mrad/s", "mm/s")
        return self._off(T_world_goal, simulation.tool_pose(), speed, marker, unit)

    def _off(
        self, T_world_goal: SE3, T_world_tcp: SE3, speed: float, marker: str, unit: str
    ) -> str | None:
        """Return the evidence that a tool is not at a goal."""
        T_goal_tcp = T_world_goal.inverse() @ T_world_tcp
        off = float(np.linalg.norm(T_goal_tcp.translation()))
        turn = float(np.linalg.norm(T_goal_tcp.rotation().log()))
        if off <= self.position_tolerance and turn <= self.turn_tolerance and speed <= self.speed:
            return None
        moves = (
            "" if self.speed == inf else f", the fastest joint moves at {1e3 * speed:.1f} {unit}"
        )
        where = f"{1e3 * off:.2f} mm and {np.rad2deg(turn):.2f}° from {marker}{moves}"
        return f"the tool is {where}; allowed are {self._allowed}"

    @property
    def _allowed(self) -> str:
        tolerances = (
            f"{1e3 * self.position_tolerance:.2f} mm, {np.rad2deg(self.turn_tolerance):.2f}°"
        )
        return (
            tolerances if self.speed == inf else f"{tolerances} and {1e3 * self.speed:.1f} mrad/s"
        )


def _speed(readings: Sequence[tuple[float, Vector]]) -> float:
    """Return the speed of the fastest joint by a straight line through positions [rad/s, m/s].

    Infinite until they span two thirds of the time that they are to.
    """
    times = np.array([time for time, _ in readings])
    if times[-1] - times[0] < 2.0 / 3.0 * _WHILE - _ROUNDING:
        return inf
    slopes = np.polyfit(times - times.mean(), np.array([q for _, q in readings]), 1)[0]
    return float(np.abs(slopes).max())
