"""Reach tool poses that are spread over the workspace."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Annotated, ClassVar

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Longest, Positive, Range
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.obstacle import Obstacle
from robo47_qp.motion.waypoint import Place, Waypoint, tool_down
from robo47_qp.run.failure import Failure
from robo47_qp.run.steps import Move, StepLike, Wait
from robo47_qp.run.task import Program, Task, option
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.hold_criterion import HOME_WORDS, STILL, HoldCriterion
from robo47_qp.tasks.table import TABLE, TABLE_TOP, add_table

_DISTANCE = (0.35, 0.75)
"""Range of the horizontal distance from the base of the arm, wherever a rail takes it [m]."""
_DIRECTION = np.deg2rad(90.0)
"""Largest angle from straight ahead, seen from the base [rad]."""
_HEIGHT = (0.15, 0.60)
"""Range of heights above the table [m]."""
_TILT = np.deg2rad(60.0)
"""Largest angle of the tool's axis from straight down [rad]."""
_ROOM = (0.015, 0.010)
"""Distance that random poses keep between links, unless these are closer at home: room for a
clearance [m]."""
_SPARE = 0.02
"""Room that random poses leave to joint limits, of which a controller keeps some [rad or m]."""
_DRAWS = 100_000
"""Largest number of configurations drawn per pose; about one in a hundred is in the workspace."""
_DEFAULT = (
    ((0.50, 0.25, 0.30), 0.4, 0.5),
    ((0.55, 0.00, 0.25), -0.3, -0.4),
    ((0.50, -0.25, 0.40), 0.2, 0.8),
    ((0.48, 0.10, 0.40), -0.3, 0.0),
    ((0.55, -0.10, 0.30), 0.0, -0.7),
)
"""Poses without a seed: position [m], tilt about the tool's y axis and yaw [rad]."""


@dataclass(frozen=True, kw_only=True)
class Reach(Task):
    """Hold tool poses, one after the other, and go home; with a seed they are random.

    A random pose is that of a random configuration within the joint limits and without collision:
    it can be reached, but its configuration is not known to the program. It lies in the workspace
    in front of the base, with the tool tilted from straight down by at most 60°; the workspace of
    an arm on a rail or a mobile base is wherever its base may be. The marker of a pose that was
    held is hidden. The program goes home between poses, so that all motions stay above the table.
    """

    count: Annotated[int, Range(at_least=1, at_most=5, whole=True)] = option(
        5, "Poses to visit, 1 to 5."
    )
    position_tolerance: Positive = 1e-3
    """Largest position error of a held tool [m]."""
    angle_tolerance: Positive = float(np.deg2rad(0.5))
    """Largest orientation error of a held tool [rad]."""
    seconds: Positive = 0.5
    """Time for which each pose is held [s]."""
    force_max: Longest = 1.0
    """See `Task.force_max`; nothing is to be touched [N]."""
    obstacles: tuple[Obstacle, ...] = (TABLE,)
    """All obstacles."""
    name: str = "reach"
    goals_asked_for: ClassVar[bool] = True

    @property
    def judged(self) -> Sequence[str]:
        """See `Task.judged`."""
        return self._held.words, HOME_WORDS

    @property
    def time_limit(self) -> float:
        """See `Task.time_limit` [s]."""
        return 120.0

    @property
    def usual_time(self) -> float:
        """See `Task.usual_time` [s]."""
        return 6.0 * self.count

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`; each pose is shown by the three axes of the tool."""
        add_table(spec)
        HoldCriterion.add_state(spec)
        for i in range(self.count):
            marker = spec.worldbody.add_body(name=f"pose {i + 1}", mocap=True)
            for axis in range(3):
                end, rgba = np.zeros(3), np.array([0.2, 0.2, 0.2, 1.0])
                end[axis], rgba[axis] = 0.05, 0.9
                marker.add_geom(
                    name=f"pose {i + 1} {'xyz'[axis]}",
                    type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                    fromto=[0.0, 0.0, 0.0, *end],
                    size=[0.003, 0.0, 0.0],
                    rgba=rgba,
                    contype=0,
                    conaffinity=0,
                )

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """See `Task.reset`."""
        HoldCriterion.reset(simulation)
        for i, name in enumerate(self._poses):
            if rng is None:
                position, tilt, yaw = _DEFAULT[i]
                pose = tool_down(position, yaw) @ SE3.from_rotation(SO3.from_y_radians(tilt))
            else:
                pose = _reachable(simulation, rng)
            simulation.place_marker(name, pose)

    def preview(self, sensed: Sensed) -> Sequence[StepLike]:
        """See `Task.preview`."""
        return [step for step in self._steps(sensed) if isinstance(step, Move)]

    def program(self, sensed: Sensed) -> Program:
        """See `Task.program`."""
        yield from self._steps(sensed)
        return None

    def monitor(self, simulation: Simulation) -> None:
        """See `Task.monitor`."""
        self._held.monitor(simulation, self._poses)

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`."""
        return self._held.verdict(simulation, self._poses)

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Return the number of remaining poses [-] and the largest joint distance from home
        [rad]."""
        return self._held.measures(simulation, self._poses)

    @property
    def _poses(self) -> list[str]:
        return [f"pose {i + 1}" for i in range(self.count)]

    @property
    def _held(self) -> HoldCriterion:
        return HoldCriterion(
            position_tolerance=self.position_tolerance,
            turn_tolerance=self.angle_tolerance,
            seconds=self.seconds,
            speed=STILL,
        )

    def _steps(self, sensed: Sensed) -> list[Move | Wait]:
        steps: list[Move | Wait] = []
        for name in self._poses:
            target = sensed.seen_pose(name)
            steps += [
                Move(waypoints=(Waypoint(name=name, target=target),)),
                self._held.hold(sensed, name),
                Move(waypoints=(Waypoint(name="home", target=Place.HOME),)),
            ]
        return steps


def _reachable(simulation: Simulation, rng: np.random.Generator) -> SE3:
    """Return T_world_tcp of a random configuration without collision in the workspace.

    Raises:
        InvalidValueError: None was found: the robot does not reach into the workspace.
    """
    model, robot = copy(simulation.model), simulation.robot
    # MuJoCo passes over parent and child, but neighbours can meet: an elbow folds up.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FILTERPARENT
    data = mujoco.MjData(model)
    data.qpos[:] = simulation.data.qpos
    as_built = [_close(model, data, gap) for gap in _ROOM]
    joints = [model.joint(name) for name in robot.joints]
    addresses = [int(joint.qposadr[0]) for joint in joints]
    limited = model.jnt_limited[[joint.id for joint in joints], None] == 1
    spare = np.array((_SPARE, -_SPARE))
    room = [joint.range + spare for joint in joints]
    low, high = np.where(limited, room, (-np.pi, np.pi)).T
    tcp = model.site(robot.tcp).id
    # Slides carry the first joint that turns.
    base = next(joint.id for joint in joints if joint.name not in robot.slides)
    for _ in range(_DRAWS):
        data.qpos[addresses] = rng.uniform(low, high)
        mujoco.mj_kinematics(model, data)
        from_base = data.site_xpos[tcp] - [*data.xanchor[base][:2], 0.0]
        if not _in_workspace(from_base, -float(data.site_xmat[tcp][8])):
            continue
        if all(
            _close(model, data, gap) <= close for gap, close in zip(_ROOM, as_built, strict=True)
        ):
            rotation = SO3.from_matrix(data.site_xmat[tcp].reshape(3, 3))
            return SE3.from_rotation_and_translation(rotation, data.site_xpos[tcp].copy())
    raise InvalidValueError(
        "workspace", f"none of {_DRAWS} configurations of {robot.name} in it", "within reach"
    )


def _close(model: mujoco.MjModel, data: mujoco.MjData, gap: float) -> set[tuple[int, int]]:
    """Return the pairs of geoms that are closer than a distance [m]."""
    model.geom_margin[:] = 0.5 * gap  # of both geoms of a pair, added up
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    return {(int(a), int(b)) for a, b in data.contact.geom}


def _in_workspace(position: np.ndarray, down: float) -> bool:
    """Return True if a tool pose is in the workspace above the table and points almost down."""
    x, y, z = position
    return bool(
        _DISTANCE[0] <= np.hypot(x, y) <= _DISTANCE[1]
        and abs(np.arctan2(y, x)) <= _DIRECTION
        and _HEIGHT[0] <= z - TABLE_TOP <= _HEIGHT[1]
        and down >= np.cos(_TILT)
    )
