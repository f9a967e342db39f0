"""Pair: two of robosuite's Pandas that face each other, led as one robot."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, cast

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots import load_robot
from robo47_qp.model.tool_poses import ToolPoses
from robo47_qp.motion.branch_choice import BranchChoice
from robo47_qp.motion.collision_check import Collisions
from robo47_qp.motion.waypoint import Motion, Waypoint
from robo47_qp.run.failure import Cause
from scenarios.judges.suite.cell import HOME, Failed, Station, Ticks

FIRST, SECOND = "left", "right"
"""Names of the hands: of robosuite's first robot, and of its second one, which faces it."""
HANDS = (FIRST, SECOND)
CLEARANCE = 0.005
"""Distance that arms, and what they hold, keep from each other and their surroundings [m]."""


def at(x: float, y: float, z: float) -> SE3:
    """A pose that is not turned [m]."""
    return SE3.from_translation(np.array([x, y, z]))


@dataclass(frozen=True)
class Solid:
    """A box or an upright cylinder of a thing, for collision checks."""

    pose: SE3
    """In the world, or in the frame of the base or grip site that it is fixed to."""
    size: tuple[float, float, float]
    """Half edges; of a cylinder its radius, half its length, and nothing [m]."""
    shape: mujoco.mjtGeom = mujoco.mjtGeom.mjGEOM_BOX

    def add(self, body: mujoco.MjsBody, frame: SE3 | None = None) -> None:
        """Add it to a body, in whose frame its own has a pose; the same where that is None."""
        pose = self.pose if frame is None else frame @ self.pose
        body.add_geom(
            type=self.shape, size=self.size, pos=pose.translation(), quat=pose.rotation().wxyz
        )


MOUNT = (
    Solid(at(-0.02, 0.0, -0.28), (0.18, 0.31, 0.0), mujoco.mjtGeom.mjGEOM_CYLINDER),
    Solid(at(-0.325, 0.0, -0.37), (0.11, 0.2, 0.265)),
    Solid(at(-0.1225, 0.0, -0.748), (0.385, 0.35, 0.155)),
)
"""What an arm stands on, in the frame of its base: pedestal, controller and feet
(rethink_mount.xml, which stands 10 mm above the base)."""


@dataclass(eq=False)
class Pair(Station):
    """Two arms; poses are those in robosuite's world.

    Motions are planned for both at once, and refused where the arms, or what they hold, would
    come too close to each other, to themselves or to what they stand on.
    """

    arms: ClassVar[int] = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        self.keep_clear()

    def model(self, bases: Sequence[SE3]) -> tuple[SE3, Robot]:
        """See `Station.model`."""
        pair = load_robot("panda_pair")
        mounts = tuple(
            replace(mount, T_world_base=base)
            for mount, base in zip(pair.mounts, bases, strict=True)
        )
        return SE3.identity(), replace(pair, mounts=mounts, home=np.tile(HOME, 2))

    def keep_clear(
        self,
        first: Sequence[Solid] = (),
        second: Sequence[Solid] = (),
        around: Sequence[Solid] = (),
    ) -> None:
        """Say what else must not collide.

        Args:
            first: What the first hand holds, in the frame of its grip site.
            second: What the second one holds.
            around: What stands in the world, which lines may touch.
        """
        robot = self.arm.robot

        def held(spec: mujoco.MjSpec) -> None:
            for mount in robot.mounts:
                for solid in MOUNT:
                    solid.add(spec.worldbody, mount.T_world_base)
            for tool, solids in zip(robot.tools, (first, second), strict=True):
                tcp = cast(mujoco.MjsSite, spec.site(tool.tcp))
                T_body_tcp = SE3(np.concatenate([tcp.quat, tcp.pos]))
                for solid in solids:
                    solid.add(tcp.parent, T_body_tcp @ self.T_tcp_grip)

        def standing(spec: mujoco.MjSpec) -> None:
            held(spec)
            for solid in around:
                solid.add(spec.worldbody)

        collisions = Collisions(robot, held, clearance=CLEARANCE)
        scene = None
        if around:
            scene = Collisions(robot, standing, clearance=CLEARANCE, touched_at_home=True)
        self.planner = replace(
            self.planner,
            collisions=collisions,
            surroundings=scene,
            branch_choice=BranchChoice(collisions=collisions),
        )

    @property
    def tools(self) -> ToolPoses:
        """T_world_grip of both hands at the last reference."""
        return self._tools(self.q)

    @property
    def measured_tools(self) -> ToolPoses:
        """T_world_grip of both hands from the measured joints."""
        return self._tools(self.measured_q)

    def _tools(self, q: Vector) -> ToolPoses:
        poses = {name: self.arm.pose(q, k) @ self.T_tcp_grip for k, name in enumerate(HANDS)}
        return ToolPoses(poses)

    def carry(self, T_world_now: SE3, T_world_then: SE3, *, pace: float = 1.0) -> Ticks:
        """Move a thing that both hands hold, on a straight line: they keep their places on it."""
        T_now_world = T_world_now.inverse()
        holding = self.tools.each(lambda _, pose: T_now_world @ self.tcp(pose))
        waypoint = Waypoint(
            name="carry", target=T_world_then, holding=holding, motion=Motion.LIN, pace=pace
        )
        yield from self.follow(waypoint)

    def nearest(self, name: str, poses: Sequence[SE3]) -> SE3:
        """The pose of a hand, among some, that is reached with the joints nearest to home.

        Raises:
            Failed: None is reached.
        """
        found = []
        for pose in poses:
            target = ToolPoses({name: self.tcp(pose)})
            result = self.planner.ik.solve(self.arm, target, self.arm.home)
            if result.converged:
                found.append((float(np.abs(result.q - self.arm.home).max()), pose))
        if not found:
            raise Failed(Cause.IK, f"the {name} arm reaches none of {len(poses)} poses")
        return min(found, key=lambda one: one[0])[1]
