"""Spaces of observations and actions for Gymnasium, and conversions to those of policies."""

from typing import Literal, TypeAlias

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.run.policy.policy import Action, JointTarget, Observation, ToolTarget, Torques

Mode: TypeAlias = Literal["joints", "tool", "torques"]
"""Kind of an action."""
Single: TypeAlias = NDArray[np.float32]
_REACH, _FAR = 1.5, 10.0
"""Range of tool targets, and of observed positions, along each axis of the world [m]."""
_FORCE = 500.0
"""Saturation of the observed force [N]."""
_SPEEDS = 5.0
"""Saturation of the observed velocities, in rated velocities [-]."""


class ActionScale:
    """Actions as vectors from -1 to 1: joint positions, a tool pose or torques, then the width."""

    def __init__(self, arm: Arm, mode: Mode) -> None:
        """Set the scale.

        -1 and 1 are the limits of the arm, half a turn where a joint has none; for a tool pose,
        1.5 m from the world's origin along each axis, with a quaternion that is normalised. If
        there is a gripper, the last number is its width: -1 for closed, 1 for fully open.

        Raises:
            InvalidValueError: There is no such mode.
        """
        robot = arm.robot
        pose = np.array([_REACH] * 3 + [1.0] * 4)
        bounds = {
            "joints": (arm.q_low, arm.q_high),
            "tool": (-pose, pose),
            "torques": (-robot.tau_max, robot.tau_max),
        }
        if mode not in bounds:
            raise InvalidValueError("mode", repr(mode), f"one of {', '.join(bounds)}")
        low, high = bounds[mode]
        self._mode, self._gripper = mode, robot.gripper is not None
        if robot.gripper is not None:
            low, high = np.append(low, 0.0), np.append(high, robot.gripper.width_max)
        self._middle, self._half = 0.5 * (low + high), 0.5 * (high - low)
        self.space = spaces.Box(-1.0, 1.0, shape=(len(low),), dtype=np.float32)

    def numbers(self, vector: ArrayLike) -> Single:
        """Return the vector of the space for quantities in SI units, with the width."""
        numbers: Single = ((np.asarray(vector) - self._middle) / self._half).astype(np.float32)
        return numbers

    def action(self, numbers: ArrayLike) -> Action:
        """Return the action for a vector of the space; its numbers are not checked.

        Raises:
            InvalidValueError: The shape is wrong, or these are no numbers.
        """
        try:
            given = np.asarray(numbers, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InvalidValueError("action", repr(numbers), "numbers") from error
        if given.shape != self.space.shape:
            raise InvalidValueError("shape of an action", given.shape, str(self.space.shape))
        vector = self._middle + self._half * given
        width = None
        if self._gripper:
            vector, width = vector[:-1], float(vector[-1])
        if self._mode == "joints":
            return JointTarget(q=vector, width=width)
        if self._mode == "torques":
            return Torques(tau=vector, width=width)
        length = float(np.linalg.norm(vector[3:]))
        if length > 0.0:
            vector[3:] /= length
        return ToolTarget(pose=vector, width=width)


def observation_space(
    arm: Arm, objects: int, markers: int, seconds: float, *, velocities: bool = True
) -> spaces.Dict:
    """Return the space of `Observation`, with objects and markers as rows in the scene's order.

    In place of when frames were taken it has their ages, of the objects and then the markers [s].
    Velocities are left out where they are not measured.
    """
    robot = arm.robot
    room = 0.1 * (arm.q_high - arm.q_low)
    v_max = _SPEEDS * robot.rated.v_max
    pose = np.array([_FAR] * 3 + [1.0] * 4)
    bounds = {
        "time": (np.zeros(1), np.array([seconds + 10.0])),
        "q": (arm.q_min - room, arm.q_max + room),
        "v": (-v_max, v_max),
        "tool": (-pose, pose),
        "force": (np.full(3, -_FORCE), np.full(3, _FORCE)),
        "objects": (np.tile(-pose, (objects, 1)), np.tile(pose, (objects, 1))),
        "markers": (np.tile(-pose, (markers, 1)), np.tile(pose, (markers, 1))),
    }
    if robot.gripper is not None:
        bounds["width"] = (np.array([-0.01]), np.array([robot.gripper.width_max + 0.01]))
        bounds["fingers"] = (np.zeros(2), np.full(2, _FORCE))
    if not velocities:
        del bounds["v"]
    bounds["ages"] = (np.zeros(objects + markers), np.full(objects + markers, seconds + 10.0))
    return spaces.Dict(
        {
            name: spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
            for name, (low, high) in bounds.items()
            if low.size
        }
    )


def numbers_of(observation: Observation, space: spaces.Dict) -> dict[str, Single]:
    """Return an observation as an element of the space, clipped to its bounds.

    Raises:
        InvalidValueError: The scene has another number of objects or markers.
    """
    seen = (*observation.objects, *observation.markers)
    rows: dict[str, Vector] = {
        "time": np.array([observation.time]),
        "q": observation.q,
        "v": observation.v,
        "tool": observation.tool,
        "force": observation.force,
        "objects": np.array(list(observation.objects.values())),
        "markers": np.array(list(observation.markers.values())),
        "ages": observation.time - np.array([observation.frames[name] for name in seen]),
    }
    if observation.width is not None:
        rows["width"] = np.array([observation.width])
    if observation.fingers is not None:
        rows["fingers"] = observation.fingers
    found: dict[str, Single] = {}
    for name, row in rows.items():
        box = space.spaces.get(name)
        if not isinstance(box, spaces.Box):
            continue
        if row.shape != box.shape:
            raise InvalidValueError(f"shape of {name}", row.shape, f"{box.shape} always")
        found[name] = np.clip(row.astype(np.float32), box.low, box.high)
    return found
