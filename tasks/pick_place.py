"""Pick a cube from the table and place it somewhere else."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError
from robo47_qp.failure import Cause, Failure
from robo47_qp.obstacle import Obstacle
from robo47_qp.simulation import Simulation
from robo47_qp.task import Program
from robo47_qp.waypoint import Grip, Motion, Payload, Place, Waypoint, tool_down
from tasks.headings import heading, quarter, upright
from tasks.table import TABLE_TOP, add_table

_CUBE = "cube"
_AREA = ((0.35, 0.60), (-0.35, 0.35))
"""Where random starts and goals lie: ranges of x and y [m]."""
_APART = 0.15
"""Random start and goal are at least this far apart [m]."""


@dataclass(frozen=True, kw_only=True)
class PickPlace:
    """Carry a cube from `pick` to `place`; with a seed, both are drawn at random.

    The cube counts as placed when its centre is within `place_tolerance` of the goal and it
    is at rest, the gripper is open and the arm is home. The goal has a position and a
    heading; as the cube looks the same after a quarter turn, so does the goal.
    """

    pick: tuple[float, float] = (0.40, 0.20)
    """Start of the cube's centre on the table, x and y [m]."""
    place: tuple[float, float] = (0.40, -0.20)
    """Goal of the cube's centre on the table, x and y [m]."""
    edge: float = 0.04
    """Edge of the cube [m]."""
    mass: float = 0.1
    """[kg]"""
    grip_force: float = 30.0
    """Force of a finger on the cube [N]."""
    clearance: float = 0.12
    """Height above the table at which the tool comes and goes [m]."""
    place_tolerance: float = 5e-3
    """[m]"""
    retries: int = 2
    """Further attempts after a missed or lost grasp."""
    force_max: float = 60.0
    """See `Task.force_max` [N]."""
    obstacles: tuple[Obstacle, ...] = ()
    """Nothing stands on the table but the cube."""
    name: str = "pick_place"

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: A place is not finite, or a size is not positive.
        """
        for name in ("pick", "place"):
            where = getattr(self, name)
            if len(where) != 2 or not np.isfinite(where).all():
                raise InvalidValueError(name, where, "two finite numbers, x and y [m]")
        for name in ("edge", "mass", "grip_force", "clearance", "place_tolerance"):
            if not getattr(self, name) > 0.0:
                raise InvalidValueError(name, getattr(self, name), "positive")

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`."""
        add_table(spec)
        cube = spec.worldbody.add_body(name=_CUBE, pos=self._on_table(self.pick))
        cube.add_freejoint()
        cube.add_geom(
            name=_CUBE,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[self.edge / 2] * 3,
            mass=self.mass,
            rgba=[0.85, 0.22, 0.18, 1.0],
        )
        goal = spec.worldbody.add_body(name="goal", mocap=True)
        goal.add_geom(
            name="goal",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[self.edge / 2 + 0.005, self.edge / 2 + 0.005, 0.0005],
            rgba=[0.15, 0.55, 0.30, 1.0],
            contype=0,
            conaffinity=0,
        )

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """See `Task.reset`."""
        start, goal = np.array(self.pick), np.array(self.place)
        turn_start = turn_goal = 0.0
        if rng is not None:
            start, goal = _random_place(rng), _random_place(rng)
            while np.linalg.norm(goal - start) < _APART:
                goal = _random_place(rng)
            turn_start, turn_goal = rng.uniform(-np.pi, np.pi, 2)
        simulation.place_object(_CUBE, upright(self._on_table(start), turn_start))
        simulation.place_marker("goal", upright([*goal, TABLE_TOP], turn_goal))

    def outlook(self, simulation: Simulation) -> Sequence[Waypoint]:
        """See `Task.outlook`."""
        T_world_cube = simulation.object_pose(_CUBE)
        T_world_tcp = self._grasp(T_world_cube)
        return [
            *self._approach(T_world_cube),
            self._lift(simulation, T_world_tcp, T_world_cube),
            self._carry(simulation, T_world_tcp, T_world_cube),
            self._lower(simulation, T_world_tcp, T_world_cube),
            *self._leave(self._release_pose(simulation, T_world_tcp, T_world_cube)),
        ]

    def program(self, simulation: Simulation) -> Program:
        """See `Task.program`."""
        failure = None
        for _ in range(1 + self.retries):
            failure = yield from self._attempt(simulation)
            if failure is None:
                yield from self._leave(simulation.tool_pose())
                return None
            yield self._back_off(simulation)
        yield Waypoint(name="home", target=Place.HOME)
        return failure

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`."""
        error = self.measures(simulation)["place_error_m"]
        speed = float(np.linalg.norm(simulation.object_twist(_CUBE)[:3]))
        if error > self.place_tolerance or speed > 1e-3:
            evidence = (
                f"the cube is {1e3 * error:.1f} mm from its goal and moves at "
                f"{1e3 * speed:.1f} mm/s; allowed are {1e3 * self.place_tolerance:.1f} mm, 1 mm/s"
            )
            return Failure(cause=Cause.PLACE, evidence=evidence)
        away = float(np.abs(simulation.state().q - simulation.robot.home).max())
        open_width = simulation.gripper.width_max - 1e-3
        if away > 0.01 or simulation.width() < open_width:
            evidence = (
                f"a joint is {away:.3f} rad from home, the gripper is open "
                f"{1e3 * simulation.width():.1f} mm; allowed are 0.01 rad, "
                f"at least {1e3 * open_width:.1f} mm"
            )
            return Failure(cause=Cause.PLACE, evidence=evidence)
        return None

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Distance of the cube's centre from its goal, in 3-D [m]."""
        goal = self._at_goal(simulation.marker_pose("goal"))
        cube = simulation.object_pose(_CUBE).translation()
        return {"place_error_m": float(np.linalg.norm(cube - goal))}

    def _attempt(self, simulation: Simulation) -> Program:
        yield from self._approach(simulation.object_pose(_CUBE))
        missing = self._not_held(simulation)
        if missing is not None:
            return Failure(cause=Cause.GRASP, evidence=missing)
        for step in (self._lift, self._carry):
            yield step(simulation, simulation.tool_pose(), simulation.object_pose(_CUBE))
            missing = self._not_held(simulation)
            if missing is not None:
                return Failure(cause=Cause.DROP, evidence=missing)
        lower = self._lower(simulation, simulation.tool_pose(), simulation.object_pose(_CUBE))
        yield lower
        missing = self._not_held(simulation)
        if missing is not None:
            return Failure(cause=Cause.DROP, evidence=missing)
        yield replace(lower, name="release", grip=self._open(simulation))
        return None

    def _approach(self, T_world_cube: SE3) -> list[Waypoint]:
        grasp = self._grasp(T_world_cube)
        squeeze = Grip(width=0.0, force=self.grip_force)
        descend = Waypoint(name="descend", target=grasp, motion=Motion.LIN, grip=squeeze)
        above = self._above(grasp)
        return [Waypoint(name="approach", target=above, onward=(descend,)), descend]

    def _lift(self, _: Simulation, T_world_tcp: SE3, T_world_cube: SE3) -> Waypoint:
        return Waypoint(
            name="lift",
            target=self._above(T_world_tcp),
            motion=Motion.LIN,
            carried=self._payload(T_world_tcp, T_world_cube),
        )

    def _carry(self, simulation: Simulation, T_world_tcp: SE3, T_world_cube: SE3) -> Waypoint:
        release = self._release_pose(simulation, T_world_tcp, T_world_cube)
        return Waypoint(
            name="carry",
            target=self._above(release),
            carried=self._payload(T_world_tcp, T_world_cube),
            onward=(self._lower(simulation, T_world_tcp, T_world_cube),),
        )

    def _lower(self, simulation: Simulation, T_world_tcp: SE3, T_world_cube: SE3) -> Waypoint:
        return Waypoint(
            name="lower",
            target=self._release_pose(simulation, T_world_tcp, T_world_cube),
            motion=Motion.LIN,
            carried=self._payload(T_world_tcp, T_world_cube),
        )

    def _leave(self, T_world_tcp: SE3) -> list[Waypoint]:
        return [
            Waypoint(name="retreat", target=self._above(T_world_tcp), motion=Motion.LIN),
            Waypoint(name="home", target=Place.HOME),
        ]

    def _back_off(self, simulation: Simulation) -> Waypoint:
        """Up and away from a grasp that went wrong, gripper open for the next one."""
        target = self._above(simulation.tool_pose())
        grip = self._open(simulation)
        return Waypoint(name="back off", target=target, motion=Motion.LIN, grip=grip)

    def _open(self, simulation: Simulation) -> Grip:
        return Grip(width=simulation.gripper.width_max, force=self.grip_force)

    def _not_held(self, simulation: Simulation) -> str | None:
        """What speaks against the cube being between the fingers; None where it is."""
        width, forces = simulation.width(), simulation.last_finger_forces()
        if abs(width - self.edge) > 3e-3:
            return (
                f"the fingers are {1e3 * width:.1f} mm apart, "
                f"the cube measures {1e3 * self.edge:.1f} mm"
            )
        if forces.min() < 0.1 * self.grip_force:
            return (
                f"the fingers press with {forces[0]:.1f} N and {forces[1]:.1f} N, "
                f"{self.grip_force:.1f} N were asked for"
            )
        return None

    def _grasp(self, T_world_cube: SE3) -> SE3:
        """Tool down at the cube's centre, fingers along the sides that need less turning."""
        return tool_down(T_world_cube.translation(), quarter(heading(T_world_cube)))

    def _release_pose(self, simulation: Simulation, T_world_tcp: SE3, T_world_cube: SE3) -> SE3:
        """Tool pose with the cube at the goal, held as it is held now."""
        T_world_goal = simulation.marker_pose("goal")
        tool, cube, goal = (heading(T) for T in (T_world_tcp, T_world_cube, T_world_goal))
        turn = SO3.from_z_radians(quarter(tool + goal - cube) - tool)
        T_world_placed = SE3.from_rotation_and_translation(
            turn @ T_world_cube.rotation(), np.array(self._at_goal(T_world_goal))
        )
        return T_world_placed @ T_world_cube.inverse() @ T_world_tcp

    def _payload(self, T_world_tcp: SE3, T_world_cube: SE3) -> Payload:
        moment = self.mass * self.edge**2 / 6
        T_tcp_cube = T_world_tcp.inverse() @ T_world_cube
        return Payload(mass=self.mass, inertia=(moment, moment, moment), T_tcp_com=T_tcp_cube)

    def _above(self, T_world_tcp: SE3) -> SE3:
        x, y, _ = T_world_tcp.translation()
        return SE3.from_rotation_and_translation(
            T_world_tcp.rotation(), np.array([x, y, TABLE_TOP + self.edge / 2 + self.clearance])
        )

    def _at_goal(self, T_world_goal: SE3) -> list[float]:
        """Centre of a cube that lies on the goal [m]."""
        x, y, z = T_world_goal.translation()
        return [x, y, z + self.edge / 2]

    def _on_table(self, where: Sequence[float] | np.ndarray) -> list[float]:
        return [float(where[0]), float(where[1]), TABLE_TOP + self.edge / 2]


def _random_place(rng: np.random.Generator) -> np.ndarray:
    return np.array([rng.uniform(*limits) for limits in _AREA])
