"""Pose error of the tool and its Jacobian, recomputed in place on the hot path."""

from functools import partial

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.tool_demand import FULL, ToolDemand
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target, ToolPoses


class ToolError:
    """Pose error and Jacobian of one tool; `move` and `update_jacobian` overwrite them.

    Both have the axes of the world and the tool point as their origin: norms are the same as in the
    tool frame, and no Jacobian needs to be rotated.
    """

    def __init__(self, arm: Arm, tool: int = 0, data: mujoco.MjData | None = None) -> None:
        """Allocate the memory for a tool of an arm; with `data`, measure on that state."""
        m = arm.model
        d = mujoco.MjData(m) if data is None else data
        tcp = arm.tool_sites[tool]
        self._data, self._q, self._position = d, d.qpos, d.site_xpos[tcp]
        self._target_position, self._target_quaternion = np.zeros(3), np.zeros(4)
        turn, quaternion = np.zeros(3), d.site_xquat[tcp]
        self.e: Vector = np.zeros(6)
        """Displacement [m] and rotation vector [rad] to the target."""
        self._p, self._w = self.e[:3], self.e[3:]
        self.J: Matrix = np.zeros((6, arm.n))
        """Twist of the tool per joint, linear part first."""
        # Every array keeps its place: what is called on the hot path is bound to them once.
        self._kinematics = partial(mujoco.mj_kinematics, m, d)
        self._turn_left = partial(mujoco.mju_subQuat, turn, self._target_quaternion, quaternion)
        self._to_world = partial(mujoco.mju_rotVecQuat, self._w, turn, quaternion)
        self._com_position = partial(mujoco.mj_comPos, m, d)
        self._jacobian = partial(mujoco.mj_jacSite, m, d, self.J[:3], self.J[3:], tcp)

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's state with the kinematics of the last `move`; not to be written to."""
        return self._data

    def set_target(self, T_world_target: Target) -> None:
        """Set the target pose."""
        if not isinstance(T_world_target, SE3):
            (T_world_target,) = T_world_target.values()
        pose = T_world_target.wxyz_xyz
        self._target_quaternion[:], self._target_position[:] = pose[:4], pose[4:]

    def move(self, q: Vector) -> tuple[float, float]:
        """Move the arm to q; return the squared distance [m²] and angle [rad²] to the target."""
        self._q[:] = q
        self._kinematics()
        return self.measure()

    def measure(self) -> tuple[float, float]:
        """Return the same where the kinematics are up to date."""
        p, w = self._p, self._w
        np.subtract(self._target_position, self._position, p)
        self._turn_left()
        self._to_world()
        return float(p.dot(p)), float(w.dot(w))

    def update_jacobian(self) -> None:
        """Update `J` for the configuration of the last `move`."""
        self._com_position()
        self._jacobian()


class DemandedError(ToolError):
    """The part of a pose error, and of its Jacobian, that a demand asks for; the rest is zero."""

    def __init__(self, arm: Arm, demand: ToolDemand, tool: int, data: mujoco.MjData | None) -> None:
        """Allocate the memory for a tool of an arm; see `ToolError`."""
        super().__init__(arm, tool, data)
        self._demand = demand
        self._rotation = self._data.site_xmat[arm.tool_sites[tool]].reshape(3, 3)

    def measure(self) -> tuple[float, float]:
        """Return the squared distance [m²] and angle [rad²] that are asked for."""
        super().measure()
        p, w = self._p, self._w
        if not self._demand.position:
            p[:] = 0.0
        w[:] = self._demand.turn(w, self._rotation)
        return float(p.dot(p)), float(w.dot(w))

    def update_jacobian(self) -> None:
        """Update the part of `J` that is asked for."""
        super().update_jacobian()
        if not self._demand.position:
            self.J[:3] = 0.0
        self.J[3:] = self._demand.turning(self.J[3:], self._rotation)


class ToolsError(ToolError):
    """Pose errors and Jacobians of several tools, stacked: `e` (6 tools,) and `J` (6 tools, n)."""

    def __init__(
        self, arm: Arm, tools: tuple[int, ...], data: mujoco.MjData | None, demand: ToolDemand
    ) -> None:
        """Allocate the memory for some tools of an arm; see `ToolError`."""
        super().__init__(arm, tools[0], data)
        self.parts = [error_to(arm, (tool,), self._data, demand) for tool in tools]
        self.e, self.J = np.zeros(6 * len(tools)), np.zeros((6 * len(tools), arm.n))

    def set_target(self, T_world_target: Target) -> None:
        """Set the target poses, in the order of the tools."""
        if isinstance(T_world_target, ToolPoses):
            for part, pose in zip(self.parts, T_world_target.values(), strict=True):
                part.set_target(pose)

    def move(self, q: Vector) -> tuple[float, float]:
        """Move the arm to q; return the sums of squared distances [m²] and angles [rad²]."""
        self._q[:] = q
        self._kinematics()
        return self.measure()

    def measure(self) -> tuple[float, float]:
        """Return the same where the kinematics are up to date."""
        distance2 = angle2 = 0.0
        for i, part in enumerate(self.parts):
            p2, w2 = part.measure()
            self.e[6 * i : 6 * i + 6] = part.e
            distance2, angle2 = distance2 + p2, angle2 + w2
        return distance2, angle2

    def update_jacobian(self) -> None:
        """Update `J` for the configuration of the last `move`."""
        for i, part in enumerate(self.parts):
            part.update_jacobian()
            self.J[6 * i : 6 * i + 6] = part.J


def error_to(
    arm: Arm,
    tools: tuple[int, ...],
    data: mujoco.MjData | None = None,
    demand: ToolDemand = FULL,
) -> ToolError:
    """Return the pose error of one or several tools of an arm; see `ToolError`."""
    if len(tools) > 1:
        return ToolsError(arm, tools, data, demand)
    if demand == FULL:
        return ToolError(arm, tools[0], data)
    return DemandedError(arm, demand, tools[0], data)


def tools_of(arm: Arm, target: Target) -> tuple[int, ...]:
    """Return the tools of a target, in its order.

    Raises:
        UnknownNameError: The robot has no tool of a name.
    """
    return (0,) if isinstance(target, SE3) else tuple(map(arm.robot.tool_index, target))
