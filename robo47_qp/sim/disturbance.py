"""Disturbance: errors of the world that the controller does not know."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import mujoco
import numpy as np
from mink import SE3
from numpy.typing import ArrayLike

from robo47_qp._core.library import Structure
from robo47_qp.arrays import Matrix, NotNegative, Positive, Range, Vector, ends
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import JointState
from robo47_qp.model.mjcf import add_payload
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Robot
from robo47_qp.sim.camera import ObjectCamera
from robo47_qp.sim.compiled import CompiledWorld
from robo47_qp.sim.delay import AHEAD, Delay, moments
from robo47_qp.sim.push import Push, Pushes
from robo47_qp.sim.scene import BuildScene, free_bodies
from robo47_qp.sim.sensed import HIDDEN_BELOW
from robo47_qp.sim.sensing import (
    MASS_TOLERANCE,
    SIZE_TOLERANCE,
    ForceSensor,
    JointSensor,
    SensorErrors,
    figures,
)
from robo47_qp.sim.simulation import Simulation
from robo47_qp.sim.wrong_model import (
    change_inertias,
    change_joints,
    change_object,
    lowest,
    numbers,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Disturbance(SensorErrors):
    """The errors of one world; by default none.

    What every link, joint or object has may be one number for all of them, or one for each in
    the order of the model, from base to tip; further ones are left out.
    """

    force_drift_time: Positive = 30.0
    """Time constant of the drift of the measured force [s]."""
    payload: Payload | None = None
    """A body fixed to the tool that the controller does not know."""
    payload_factor: Positive = 1.0
    """Mass and moments of what the tool carries, as told to the controller, relative to what
    the program has told [-]."""
    link_mass_factor: Annotated[ArrayLike, Range(above=0.0)] = 1.0
    """Mass and moments of every body of the robot, relative to the model [-]."""
    link_inertia_factor: Annotated[ArrayLike, Range(above=0.0)] = 1.0
    """Further factor of its moments about the centre of mass [-]."""
    link_com_shift: Annotated[ArrayLike, Range()] = (0.0, 0.0, 0.0)
    """Shift of its centre of mass, along the axes of the body (3,) or (k, 3) [m]."""
    dry_friction: Annotated[ArrayLike, Range(at_least=0.0)] = 0.0
    """Dry friction of every joint that turns, beyond that of the model [N·m]."""
    wrist_friction: NotNegative = 0.6
    """Share of it that the joints from the fifth of these in an arm on have [-]."""
    damping_factor: Annotated[ArrayLike, Range(at_least=0.0)] = 1.0
    """Viscous friction of every joint, relative to the model [-]."""
    armature_factor: Annotated[ArrayLike, Range(above=0.0)] = 1.0
    """Inertia of the drive of every joint, relative to the model [-]."""
    pushes: Sequence[Push] = ()
    object_mass_factor: Annotated[ArrayLike, Range(above=0.0)] = 1.0
    """Mass and moments of every free body, relative to the model [-]."""
    mass_tolerance: NotNegative | None = None
    """What data sheets say of the objects' masses: by what part they may be off [-]; None for
    as much as these are."""
    object_com_shift: Annotated[ArrayLike, Range()] = (0.0, 0.0, 0.0)
    """Shift of its centre of mass, along its axes and at most 0.7 of the way to its sides (3,) or
    (k, 3) [m]."""
    object_size_factor: Annotated[ArrayLike, Range(above=0.0)] = 1.0
    """Its lengths, relative to the model, with the same mass [-]."""
    size_tolerance: NotNegative | None = None
    """What data sheets say of these lengths, like `mass_tolerance` [-]."""
    friction: NotNegative | None = None
    """Coefficient of the sliding friction of all contacts; None is that of the model [-]."""


class DisturbedSimulation(Simulation):
    """A simulation with a disturbance.

    It affects motors, inertias, friction and the measured state, tool force and poses;
    `write_now`, `write_last`, `true_state`, `last_tool_force` and `object_pose` are true values.
    """

    def __init__(
        self,
        robot: Robot,
        build_scene: BuildScene,
        disturbance: Disturbance,
        rng: np.random.Generator | None = None,
        *,
        goals_asked_for: bool = False,
        drawn: bool = True,
    ) -> None:
        """Compile the disturbed scene.

        Args:
            robot: See `Simulation`.
            build_scene: See `Simulation`.
            disturbance: The errors of the world.
            rng: Source of the seeds of the sensors, which are drawn here; each sensor has random
                numbers of its own, the same ones after every `reset`.
            goals_asked_for: Whether markers are poses that are asked for; else they are things
                that the camera sees.
            drawn: See `Simulation`.

        Raises:
            InvalidValueError: There is noise, but no generator; there are fewer numbers than
                links or joints, or they have another shape.
            UnknownNameError, ModelError: See `Simulation`.
        """
        if rng is None and disturbance.noisy:
            raise InvalidValueError("rng", None, "a numpy Generator where there is sensor noise")
        self.disturbance = disturbance
        self._seeds: list[int] | None = (
            None if rng is None else rng.integers(2**63, size=2).tolist()
        )
        self._joint_sensor, self._force_sensor = (
            JointSensor(disturbance),
            ForceSensor(disturbance, disturbance.force_drift_time, len(robot.tools)),
        )
        self._torque_delay = Delay(disturbance.torque_delay)
        self._camera: ObjectCamera | None = None
        super().__init__(robot, _changed(robot, build_scene, disturbance), drawn=drawn)
        self._seen_markers = () if goals_asked_for else self.markers
        self.disturbance = self._of_this_world(disturbance)
        if disturbance.friction is not None:
            self.model.geom_friction[:, 0] = disturbance.friction
            self.model.pair_friction[:, :2] = disturbance.friction
        if disturbance.camera_errs:
            seed = 0 if self._seeds is None else self._seeds[1]
            self._camera = ObjectCamera(
                [*self.objects, *self._seen_markers],
                disturbance,
                seed,
                self._occluded,
                self._is_hidden,
            )
        self.reset()

    def set_friction(self, name: str, friction: float) -> None:
        """See `Simulation.set_friction`; the disturbance's friction of all contacts stays."""
        if self.disturbance.friction is None:
            super().set_friction(name, friction)

    def reset(self) -> None:
        """See `Simulation.reset`; the errors are the same again, and the arm was held so far."""
        super().reset()
        self._pushes = Pushes(self.disturbance.pushes, self.model, self.data, self.robot.tcp)
        streams: list[np.random.Generator | None] = [None] * 4
        if self._seeds is not None:
            streams = [np.random.default_rng([self._seeds[0], i]) for i in range(4)]
        joint_noise, state_delays, torque_delays, force_noise = streams
        self._joint_sensor.start(super().state(), joint_noise, state_delays)
        self._torque_delay.start(self.motor_torque(), torque_delays)
        self._feels = force_noise is not None and not self._force_sensor.ideal
        if force_noise is not None:
            self._force_sensor.start(force_noise)
        if self._camera is not None:
            self._camera.start(self.time, self._thing_pose)
        if self._compiled is not None:
            self._compiled.sense(self._senses())

    def _senses(self) -> Structure:
        """Return what the compiled core has to know of the errors of sensors and lines."""
        late = {"torque": self._torque_delay.compiled()} if self._late else {}
        noisy = {} if self._joint_sensor.ideal else {"joints": self._joint_sensor.compiled()}
        felt = {"force": self._force_sensor.compiled()} if self._feels else {}
        return Structure("r47_senses", **late, **noisy, **felt)

    @property
    def _late(self) -> bool:
        return ends(self.disturbance.torque_delay) != (0.0, 0.0)

    @property
    def compiled(self) -> CompiledWorld | None:
        """See `Simulation.compiled`."""
        return self._compiled if type(self) is DisturbedSimulation else None

    def ahead(self) -> int:
        """See `Simulation.ahead`: up to the next frame of the camera, and without pushes."""
        periods = min(AHEAD, self._pushes.ahead(self.time))
        if periods and self._camera is not None:
            periods = min(periods, self._camera.ahead(self.time, TIMESTEP))
        if self._late:
            self._torque_delay.prepare()
        if not self._joint_sensor.ideal:
            self._joint_sensor.prepare()
        if self._feels:
            self._force_sensor.prepare()
        return periods

    def look(self) -> None:
        """See `Simulation.look`."""
        if self._camera is not None:
            self._camera.watch(self.time, self._thing_pose)

    def step(self, tau: Vector) -> None:
        """See `Simulation.step`; with the command that has arrived, and the pushes."""
        self._motors.check(tau)
        self._pushes.act(self.time)
        super().step(self._torque_delay.sample(tau))
        if not self._joint_sensor.ideal:
            self._joint_sensor.sample(super().state())
        if self._feels:
            self._force_sensor.sample()
        self.look()

    def state(self) -> JointState:
        """See `Simulation.state`; the same however often it is asked for in a period."""
        return super().state() if self._joint_sensor.ideal else self._joint_sensor.state()

    def felt_force(self, tool: int = 0) -> Vector:
        """See `Simulation.felt_force`; with the pushes on the main tool."""
        force = super().felt_force(tool)
        if tool == 0:
            force = force + self._pushes.felt
        return force if self._force_sensor.ideal else force + self._force_sensor.error[tool]

    def true_state(self) -> JointState:
        """See `Simulation.true_state`."""
        return super().state()

    @property
    def payload_factor(self) -> float:
        """See `Simulation.payload_factor`."""
        return self.disturbance.payload_factor

    def seen_pose(self, name: str) -> SE3:
        """See `Simulation.seen_pose`; measured in the last frame that has arrived."""
        if self._camera is None or name not in self.objects:
            return self.object_pose(name)
        return self._camera.seen(name).pose

    def seen_marker(self, name: str) -> SE3:
        """See `Simulation.seen_marker`."""
        if self._camera is None or name not in self._seen_markers:
            return self.marker_pose(name)
        return self._camera.seen(name).pose

    def seen_time(self, name: str) -> float:
        """See `Simulation.seen_time`."""
        if self._camera is None or name not in (*self.objects, *self._seen_markers):
            return super().seen_time(name)
        return self._camera.seen(name).time

    @property
    def noise_figures(self) -> dict[str, Any]:
        """See `Simulation.noise_figures`."""
        wrong = self.disturbance
        mass = _told(wrong.mass_tolerance, wrong.object_mass_factor)
        size = _told(wrong.size_tolerance, wrong.object_size_factor)
        return {**figures(wrong), MASS_TOLERANCE: mass, SIZE_TOLERANCE: size}

    @property
    def joint_data_sheet(self) -> tuple[float, float, float, float]:
        """See `Simulation.joint_data_sheet`."""
        wrong = self.disturbance
        (state, jitter), (command, _) = moments(wrong.state_delay), moments(wrong.torque_delay)
        return wrong.noise_q, state, command, jitter

    def place_object(self, name: str, T_world_object: SE3) -> None:
        """See `Simulation.place_object`; the camera sees it there at once."""
        up = SE3.from_translation(self._grown(name, T_world_object))
        super().place_object(name, T_world_object if self._sizes_known else up @ T_world_object)
        if self._camera is not None:
            self._camera.place(name, self.time, self.object_pose(name))

    def place_marker(self, name: str, T_world_marker: SE3) -> None:
        """See `Simulation.place_marker`; before the first step, the camera sees it at once."""
        super().place_marker(name, T_world_marker)
        if self._camera is not None and self.time == 0.0 and name in self._seen_markers:
            self._camera.place(name, self.time, self.marker_pose(name))

    @property
    def _sizes_known(self) -> bool:
        return bool(np.all(np.asarray(self.disturbance.object_size_factor) == 1.0))

    def _grown(self, name: str, T_world_object: SE3) -> Vector:
        """Return how far a body of another size is put up, so that it stands where it stood."""
        if name not in self.objects:
            return np.zeros(3)
        factors = self.disturbance.object_size_factor
        factor = numbers("object_size_factor", factors, len(self.objects))[self.objects.index(name)]
        below = lowest(self.model, name, T_world_object.rotation().as_matrix())
        return np.array([0.0, 0.0, below / float(factor[0]) - below])

    def _thing_pose(self, name: str) -> SE3:
        return self.object_pose(name) if name in self.objects else self.marker_pose(name)

    def _is_hidden(self, name: str, T_world_thing: SE3) -> bool:
        return name in self._seen_markers and T_world_thing.translation()[2] < HIDDEN_BELOW

    def _occluded(self, name: str) -> bool:
        """Return whether a finger touches an object, as far as that hides it."""
        if not self.disturbance.occlusion or name not in self.objects:
            return False
        m, contact = self.model, self.data.contact
        bodies = m.geom_bodyid[contact.geom]
        fingers = [m.body(f).id for gripper in self.robot.grippers for f in gripper.fingers]
        touched = bodies == m.body(name).id
        return bool((touched & np.isin(bodies[:, ::-1], fingers)).any())

    def _of_this_world(self, wrong: Disturbance) -> Disturbance:
        """Return the disturbance without the numbers that belong to no link or joint."""
        links = [self.model.body(i).name for i in robot_bodies(self.robot, self.model)]
        counts = {name: len(links) - (_PAYLOAD in links) for name in _PER_LINK}
        counts |= {name: len(self.robot.joints) for name in _PER_JOINT}
        counts |= {name: len(self.objects) for name in _PER_OBJECT}
        rows = {name: np.asarray(getattr(wrong, name)) for name in counts}
        dims = {name: 1 + name.endswith("_shift") for name in counts}
        given: dict[str, Any] = {
            k: row[: counts[k]] for k, row in rows.items() if row.ndim == dims[k]
        }
        return replace(wrong, **given)


_PAYLOAD = "unknown_payload"
_PER_LINK = ("link_mass_factor", "link_inertia_factor", "link_com_shift")
_PER_OBJECT = ("object_mass_factor", "object_com_shift", "object_size_factor")
_PER_JOINT = ("dry_friction", "damping_factor", "armature_factor")


def _told(tolerance: float | None, factors: ArrayLike) -> float:
    """Return the tolerance of a data sheet, that of these factors if none is given."""
    drawn = float(np.abs(np.asarray(factors) - 1.0).max(initial=0.0))
    return drawn if tolerance is None else tolerance


def _changed(robot: Robot, build_scene: BuildScene, wrong: Disturbance) -> BuildScene:
    """Return what builds the scene with the errors of its bodies and joints."""

    def build(spec: mujoco.MjSpec) -> None:
        build_scene(spec)
        model = spec.compile()
        change_inertias(spec, model, *_links(robot, model, wrong))
        free = free_bodies(model)
        rows = np.hstack(
            [
                numbers("object_size_factor", wrong.object_size_factor, len(free)),
                numbers("object_mass_factor", wrong.object_mass_factor, len(free)),
                numbers("object_com_shift", wrong.object_com_shift, len(free), 3),
            ]
        )
        for name, row in zip(free, rows, strict=True):
            change_object(spec, model, name, row)
        change_joints(spec, model, robot.joints, _joints(robot, wrong), wrong.wrist_friction)
        if wrong.payload is not None:
            add_payload(spec, model, robot.tools[0], wrong.payload, _PAYLOAD)

    return build


def robot_bodies(robot: Robot, model: mujoco.MjModel) -> list[int]:
    """Return the ids of a robot's bodies, its base and what is fixed to it included."""
    tools = [int(model.site_bodyid[model.site(tool.tcp).id]) for tool in robot.tools]
    bodies: list[int] = np.flatnonzero(
        np.isin(model.body_rootid, model.body_rootid[tools])
    ).tolist()
    return bodies


def _links(robot: Robot, model: mujoco.MjModel, wrong: Disturbance) -> tuple[list[int], Matrix]:
    """Return ids of the robot's bodies, and what is wrong with them."""
    links = robot_bodies(robot, model)
    columns = [
        numbers("link_mass_factor", wrong.link_mass_factor, len(links)),
        numbers("link_inertia_factor", wrong.link_inertia_factor, len(links)),
        numbers("link_com_shift", wrong.link_com_shift, len(links), 3),
    ]
    return links, np.hstack(columns)


def _joints(robot: Robot, wrong: Disturbance) -> Matrix:
    """Return what is wrong with the robot's joints."""
    n = len(robot.joints)
    columns = [
        numbers("dry_friction", wrong.dry_friction, n),
        numbers("damping_factor", wrong.damping_factor, n),
        numbers("armature_factor", wrong.armature_factor, n),
    ]
    return np.hstack(columns)
