"""Hold criterion: whether the tool is held at a sequence of poses, one after the other."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import mujoco
import numpy as np
from mink import SE3

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
_PATIENCE = 4.0
"""Longest time to wait until a pose counts as held, beside the time that is asked for [s]: the arm
comes to rest, or comes back from where it was pushed."""
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
        note = task_state(simulation)
        if not self._rests(simulation, simulation.marker_pose(marker)):
            # `monitor` is never called at time 0, so 0 means "not there".
            note[0] = 0.0
            return
        if note[0] == 0.0:
            note[0] = simulation.time
        if simulation.time - note[0] >= self.seconds - _ROUNDING:
            hide_marker(simulation, marker)
            note[0] = 0.0

    def hold(self, sensed: Sensed, marker: str) -> Wait:
        """Return a step that stays until the pose of a marker was held, also if the tool is pushed
        off it meanwhile."""
        seconds = self.seconds + _PATIENCE
        return Wait(name=f"hold {marker}", seconds=seconds, until=self.held(sensed, marker))

    def held(self, sensed: Sensed, marker: str) -> Condition:
        """Return the condition that the pose of a marker was held: then the marker is hidden.

        What is against it is where the tool is, as far as is measured. Speeds are not told: those
        that are measured are noisy.
        """
        still, unit = replace(self, speed=inf), sensed.robot.unit("mrad/s", "mm/s")

        def against() -> str | None:
            if sensed.is_hidden(marker):
                return None
            off = still._off(sensed.seen_pose(marker), sensed.tool_pose(), 0.0, marker, unit)
            return off or f"{marker} does not count as held yet"

        return Condition(name=f"{marker} was held", cause=Cause.TRACK, against=against)

    @property
    def words(self) -> str:
        """What holding a pose means, in words."""
        return f"each pose in order for {self.seconds:g} s within {self._allowed}"

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
