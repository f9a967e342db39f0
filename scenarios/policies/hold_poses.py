"""A policy written by hand for reach: goes straight to each pose that it observes, and holds it."""

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.run.policy.policy import Action, JointTarget, Observation, ToolTarget, pose_of

_DONE = -0.5
"""Height below which a marker is out of sight: what it marks is done [m]."""
_THERE = 2e-4
"""How far the tool is from a pose at most where the arm is to stop [m or rad]."""
_NEAR, _SLOW = 2e-3, 0.02
"""What counts as at joint positions [rad], and as slow [rad/s]."""
_PATIENCE = 5.0
"""How long a way may take before another one is tried [s]."""
_STARTS = [(0.0, 0.0), (0.0, 1.2), (0.0, -1.2), (0.6, 0.0), (-0.6, 0.0), (0.6, 1.2), (-0.6, -1.2)]
"""Turns of the first and the last joint from home [rad]. A way to a pose begins there; from some
of them the arm ends at a limit of its joints."""


class HoldPoses:
    """Takes the tool to the first marker in sight and stays until that goes; then home."""

    def reset(self, observation: Observation) -> None:
        self._q_home = observation.q
        self._left = len(_in_sight(observation))
        self._tried, self._begun = 0, observation.time
        self._stop: Vector | None = None
        """Where the joints are to be; None while the tool is on its way."""

    def act(self, observation: Observation) -> Action | None:
        poses, seen = _in_sight(observation), observation
        if len(poses) < self._left:
            self._left, self._tried, self._stop = len(poses), 0, self._q_home
        elif self._stop is None and seen.time - self._begun > _PATIENCE:
            self._tried += 1
            self._stop = self._start()
        elif self._stop is not None and self._is_at(self._start(), seen):
            self._stop, self._begun = None, seen.time
        if self._stop is None and not poses:
            return None
        if self._stop is None and _off(poses[0], seen) < _THERE:
            # Led by the tool alone, the joints go on moving: seven of them for six coordinates.
            self._stop = seen.q
        return ToolTarget(pose=poses[0]) if self._stop is None else JointTarget(q=self._stop)

    def _start(self) -> Vector:
        turns = np.zeros_like(self._q_home)
        turns[0], turns[-1] = _STARTS[self._tried % len(_STARTS)]
        return self._q_home + turns

    def _is_at(self, q: Vector, seen: Observation) -> bool:
        return bool(np.abs(seen.q - q).max() < _NEAR and np.abs(seen.v).max() < _SLOW)


def _in_sight(seen: Observation) -> list[Vector]:
    return [pose for pose in seen.markers.values() if pose[2] > _DONE]


def _off(pose: Vector, seen: Observation) -> float:
    """How far the tool is from a pose, metres and radians alike."""
    return float(np.abs((pose_of(pose).inverse() @ pose_of(seen.tool)).log()).max())
