"""A policy written by hand that solves pick_place from what it observes, by targets of the tool."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from mink import SE3

from robo47_qp.motion.waypoint import tool_down
from robo47_qp.run.policy.policy import (
    Action,
    JointTarget,
    Observation,
    ToolTarget,
    pose_of,
    vector_of,
)

_ABOVE, _DEPTH, _FINGERTIP = 0.14, 0.03, 0.012
"""Heights [m]: to come and go at; of the fingers' grip, below the object's top at most and above
the table at least."""
_OPEN = 0.08
_NEAR, _STILL, _SLOW = 2e-3, 3e-4, 0.02
"""What counts as there [m or rad], as at rest between two looks [m], and as slow [rad/s]."""
_LEAN, _GAIN = 0.01, 0.15
"""How far to aim past a pose at most [m], and how much of what is missing in one decision."""
_FINGERS, _NOTHING = 0.9, 0.005
"""How long the fingers take [s], and the width at which there is nothing between them [m]."""


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One action, repeated until something is seen."""

    action: Action
    until: Callable[[Observation], bool]


class PickAndPlace:
    """Takes the first object to the first marker, and goes home."""

    def reset(self, observation: Observation) -> None:
        self._q_home = observation.q
        self._seen, self._lean = observation, np.zeros(3)
        self._stages = self._plan()
        self._stage: Stage | None = next(self._stages)

    def act(self, observation: Observation) -> Action | None:
        self._seen = observation
        while self._stage is not None and self._stage.until(observation):
            self._stage = next(self._stages, None)
        action = None if self._stage is None else self._stage.action
        return self._leaning(action, observation) if isinstance(action, ToolTarget) else action

    def _leaning(self, action: ToolTarget, seen: Observation) -> ToolTarget:
        """Aims past the pose by what the load pulls the tool off it: an integrator."""
        off = action.pose[:3] - seen.tool[:3]
        if np.linalg.norm(off) < _LEAN:
            self._lean = np.clip(self._lean + _GAIN * off, -_LEAN, _LEAN)
        return replace(action, pose=np.concatenate([action.pose[:3] + self._lean, action.pose[3:]]))

    def _plan(self) -> Iterator[Stage]:
        """The stages; each looks at what is seen when it is due."""
        height = 2.0 * self._object().translation()[2]
        down = max(0.5 * height, height - _DEPTH, _FINGERTIP)
        held = False
        while not held:
            grasp = _down_at(self._object(), down, _quarter(_heading(self._object())))
            yield self._to(_raised(grasp), _OPEN)
            yield self._to(grasp, _OPEN)
            yield self._wait(grasp, 0.0)
            yield self._to(_raised(grasp), 0.0)
            held = self._seen.width is not None and self._seen.width > _NOTHING
        turn = _quarter(_heading(self._marker()) - _heading(self._object()))
        yaw = _quarter(_heading(self._object())) + turn
        place = _down_at(self._marker(), down, yaw)
        yield self._to(_raised(place), 0.0)
        yield self._to(place, 0.0)
        yield self._wait(place, _OPEN)
        yield self._to(_raised(place), _OPEN)
        yield Stage(action=JointTarget(q=self._q_home), until=self._is_home)

    def _is_home(self, seen: Observation) -> bool:
        off = np.abs(seen.q - self._q_home).max()
        return bool(off < _NEAR and np.abs(seen.v).max() < _SLOW)

    def _wait(self, pose: SE3, width: float) -> Stage:
        """Stay there while the fingers move."""
        begun = self._seen.time

        def over(seen: Observation) -> bool:
            return seen.time > begun + _FINGERS

        return Stage(action=ToolTarget(pose=vector_of(pose), width=width), until=over)

    def _to(self, pose: SE3, width: float) -> Stage:
        before = self._seen.tool

        def there(seen: Observation) -> bool:
            nonlocal before
            off = np.linalg.norm(seen.tool[:3] - pose.translation())
            moved, before = np.linalg.norm(seen.tool[:3] - before[:3]), seen.tool
            return bool(off < _NEAR and moved < _STILL)

        return Stage(action=ToolTarget(pose=vector_of(pose), width=width), until=there)

    def _object(self) -> SE3:
        return pose_of(next(iter(self._seen.objects.values())))

    def _marker(self) -> SE3:
        return pose_of(next(iter(self._seen.markers.values())))


def _down_at(T_world_thing: SE3, height: float, yaw: float) -> SE3:
    x, y, _ = T_world_thing.translation()
    return tool_down([x, y, height], yaw)


def _raised(T_world_tcp: SE3) -> SE3:
    x, y, _ = T_world_tcp.translation()
    return SE3.from_rotation_and_translation(T_world_tcp.rotation(), np.array([x, y, _ABOVE]))


def _heading(T_world_body: SE3) -> float:
    R = T_world_body.rotation().as_matrix()
    return float(np.arctan2(R[1, 0], R[0, 0]))


def _quarter(angle: float) -> float:
    """The same up to quarter turns, within an eighth of a turn from zero [rad]."""
    return (angle + np.pi / 4) % (np.pi / 2) - np.pi / 4
