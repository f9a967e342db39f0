"""Held: whether the tool rests at a pose, and which poses it has held, one after the other."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.steps import Condition
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.memory import (
    add_memory,
    in_sight,
    memory,
    put_away,
)

_HOME = 0.01
"""How far a joint may be from home at the end [rad]."""
_ROUNDING = 1e-6
"""Slack for sums of control periods [s]."""


@dataclass(frozen=True, kw_only=True)
class Held:
    """When a pose counts as held.

    Each pose has a marker, which goes out of sight once its turn has come and it has been held.
    """

    position_tolerance: float
    """How far the tool point may be from the pose [m]."""
    turn_tolerance: float
    """How far the tool may be turned from it [rad]."""
    seconds: float
    """For how long, without a break [s]."""
    speed: float = inf
    """Joint speed at most [rad/s]; inf where it is enough not to leave the tolerances."""

    @staticmethod
    def remember(spec: mujoco.MjSpec) -> None:
        """Add to a scene what `notice` remembers: since when the tool has been there."""
        add_memory(spec, 1)

    @staticmethod
    def forget(simulation: Simulation) -> None:
        """Begin anew."""
        memory(simulation)[:] = 0.0

    def notice(self, simulation: Simulation, markers: Sequence[str]) -> None:
        """Look once: see `Task.notice`. What is noticed is the first pose that is left."""
        marker = next((name for name in markers if in_sight(simulation, name)), None)
        if marker is None:
            return
        note = memory(simulation)
        if not self._rests(simulation, simulation.marker_pose(marker)):
            # No look is at time 0: it stands for never.
            note[0] = 0.0
            return
        if note[0] == 0.0:
            note[0] = simulation.time
        if simulation.time - note[0] >= self.seconds - _ROUNDING:
            put_away(simulation, marker)
            note[0] = 0.0

    def condition(self, simulation: Simulation, marker: str) -> Condition:
        """That the tool rests at a pose now; where its marker was last, if that is put away.

        The marker must not be away yet.
        """
        goal = simulation.marker_pose(marker)

        def against() -> str | None:
            nonlocal goal
            if in_sight(simulation, marker):
                goal = simulation.marker_pose(marker)
            return self._against(simulation, marker, goal)

        name = f"the tool is at rest at {marker}"
        return Condition(name=name, cause=Cause.TRACK, against=against)

    def verdict(self, simulation: Simulation, markers: Sequence[str]) -> Failure | None:
        """What speaks against all poses having been held, and the arm being home."""
        measures = self.measures(simulation, markers)
        left, away = round(measures["poses_left"]), measures["home_error_rad"]
        against = []
        if left:
            against.append(
                f"{left} of {len(markers)} poses are left, {markers[-left]} the first: each is to "
                f"be held for {self.seconds:.2f} s within {self._allowed}"
            )
        if away > _HOME:
            against.append(f"a joint is {away:.3f} rad from home; allowed are {_HOME} rad")
        return Failure(cause=Cause.PLACE, evidence=", and ".join(against)) if against else None

    def measures(self, simulation: Simulation, markers: Sequence[str]) -> dict[str, float]:
        """Poses that are left [-], and how far a joint is from home at most [rad]."""
        q = simulation.true_state().q
        return {
            "poses_left": float(sum(in_sight(simulation, name) for name in markers)),
            "home_error_rad": float(np.abs(q - simulation.robot.home).max()),
        }

    def _rests(self, simulation: Simulation, goal: SE3) -> bool:
        """As `_against`, but quick where the tool is far away."""
        off = goal.translation() - simulation.tool_pose().translation()
        if float(off @ off) > (2.0 * self.position_tolerance) ** 2:
            return False
        return self._against(simulation, "", goal) is None

    def _against(self, simulation: Simulation, marker: str, T_world_goal: SE3) -> str | None:
        T_goal_tcp = T_world_goal.inverse() @ simulation.tool_pose()
        off = float(np.linalg.norm(T_goal_tcp.translation()))
        turn = float(np.linalg.norm(T_goal_tcp.rotation().log()))
        speed = float(np.abs(simulation.true_state().v).max())
        if off <= self.position_tolerance and turn <= self.turn_tolerance and speed <= self.speed:
            return None
        return (
            f"the tool is {1e3 * off:.2f} mm and {np.rad2deg(turn):.2f}° from {marker}, the "
            f"fastest joint moves at {1e3 * speed:.1f} mrad/s; allowed are {self._allowed}"
        )

    @property
    def _allowed(self) -> str:
        tolerances = (
            f"{1e3 * self.position_tolerance:.2f} mm, {np.rad2deg(self.turn_tolerance):.2f}°"
        )
        return (
            tolerances if self.speed == inf else f"{tolerances} and {1e3 * self.speed:.1f} mrad/s"
        )
