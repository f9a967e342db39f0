"""CompiledVelocity: the joint velocity towards targets by the compiled core."""

from collections.abc import Mapping
from math import sqrt

import numpy as np
from mink import SE3

from robo47_qp._core.library import Structure, backend, functions, pointer
from robo47_qp._core.mujoco_functions import function, structure
from robo47_qp.arrays import Vector
from robo47_qp.ik.stream import target_velocity
from robo47_qp.ik.stream.settings import Event, StreamSettings
from robo47_qp.ik.stream.target_velocity import TargetVelocity, VelocityObjective, Way
from robo47_qp.ik.tool_demand import FULL
from robo47_qp.model.arm import Arm
from robo47_qp.model.chain import MAX_JOINTS
from robo47_qp.model.robot import MotionProfile


class CompiledVelocity(TargetVelocity):
    """The same as `TargetVelocity` up to rounding, for tools whose whole pose is asked for."""

    def __init__(self, settings: StreamSettings, arm: Arm, profile: MotionProfile) -> None:
        """See `TargetVelocity`."""
        super().__init__(settings, arm, profile)
        tools = len(arm.robot.tools)
        self._target, self._last = np.zeros((tools, 7)), np.zeros((tools, 7))
        self._given, self._known = np.zeros((2, tools), dtype=np.uint8)
        self._frozen_now = np.zeros(arm.n, dtype=np.uint8)
        self._at, self._home_now = np.zeros(arm.n), arm.home.copy()
        self._q_pointer = pointer(self._at)
        self._together: dict[tuple[int, ...], _Together] = {}

    def freeze(self, joints: list[int]) -> None:
        """See `TargetVelocity.freeze`."""
        super().freeze(joints)
        self._frozen_now[joints] = 1

    def reset(self) -> None:
        """See `TargetVelocity.reset`."""
        self._known[:] = 0

    def objective(self, targets: Mapping[int, SE3 | None], q: Vector) -> VelocityObjective:
        """See `TargetVelocity.objective`; the next call overwrites all arrays but v_ref."""
        events: tuple[Event, ...] = ()
        self._given[:] = 0
        for tool, pose in targets.items():
            if pose is None:
                events = (Event.TARGET_REFUSED,)
            else:
                self._target[tool], self._given[tool] = pose.wxyz_xyz, 1
        if not self._given.any():
            self.reset()
            self.update(q)
            return self._rest
        tools = tuple(targets)
        if tools not in self._together:
            self._together[tools] = _Together(self, tools)
        if len(tools) < len(self._given):
            self._known &= self._given
        self._at[:] = q
        self._home_now[:] = self._arm.nearest(self._home, q)
        return self._together[tools].objective(self._q_pointer, events)


class _Together:
    """Tools that are followed together: the core's structure, and what it writes."""

    def __init__(self, of: CompiledVelocity, tools: tuple[int, ...]) -> None:
        arm, d, settings = of._arm, of._data, of._settings
        m, n, rows = arm.model, arm.n, 6 * len(tools)
        moves = [arm.tool_joints(tool) for tool in tools]
        groups = target_velocity.joint_groups(moves) or [np.arange(n)]
        group = np.full(n, -1, dtype=np.int32)
        for i, joints in enumerate(groups):
            group[joints] = i
        self._H, self._v_ref = np.zeros((n, n)), np.zeros(n)
        self._way = Way(np.zeros(n), np.zeros(n), np.zeros((rows, n)))
        self._jumped = np.zeros(len(tools), dtype=np.uint8)
        self._core = Structure(
            "r47_follow",
            n=n,
            tools=len(tools),
            groups=len(groups),
            model=structure(m),
            data=structure(d),
            kinematics=function("mj_kinematics"),
            centres=function("mj_comPos"),
            difference=function("mju_subQuat"),
            rotated=function("mju_rotVecQuat"),
            qpos=d.qpos,
            site_xpos=d.site_xpos,
            site_xquat=d.site_xquat,
            cdof=d.cdof,
            com=d.subtree_com,
            root=m.body_rootid[m.jnt_bodyid].astype(np.int32),
            tool=np.array(tools, dtype=np.int32),
            site=np.array([arm.tool_sites[tool] for tool in tools], dtype=np.int32),
            moves=np.array(moves).astype(np.uint8),
            frozen=of._frozen_now,
            group=group,
            home=of._home_now,
            v_home=of._v_home,
            v_max=np.array(of._v_max),
            v_use=of._v_use,
            a_use=of._a_use,
            gain=settings.gain,
            home_gain=settings.home_gain,
            threshold=settings.singular_threshold,
            lost=target_velocity.LOST,
            tiny=target_velocity.TINY,
            max_distance=settings.max_distance,
            radian_length=settings.radian_length,
            joint_weight=settings.joint_weight,
            dt=settings.dt,
            target=of._target,
            given=of._given,
            last=of._last,
            known=of._known,
            J=self._way.rows,
            H=self._H,
            v_ref=self._v_ref,
            way=self._way.whole,
            paced=self._way.paced,
            jumped=self._jumped,
            rows=np.zeros((4, rows)),
            squares=np.zeros((3, rows, rows)),
        )

    def objective(self, q: object, events: tuple[Event, ...]) -> VelocityObjective:
        core = self._core.pointer
        functions().r47_follow_targets(core, q)
        if np.count_nonzero(self._jumped):
            events = (*events, Event.TARGET_JUMPED)
        away, turn = sqrt(core.away), sqrt(core.turn)
        return VelocityObjective(self._H, self._v_ref.copy(), away, turn, events, self._way)


def velocity_type(settings: StreamSettings, n: int) -> type[TargetVelocity]:
    """Return the class that the chosen backend has for an arm of n joints."""
    compiled = backend() == "compiled" and n <= MAX_JOINTS and settings.demand == FULL
    return CompiledVelocity if compiled else TargetVelocity
