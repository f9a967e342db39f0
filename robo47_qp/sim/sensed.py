"""Sensed: all that a program or a policy may know of a cell."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.errors import NoGripperError, UnknownNameError
from robo47_qp.model.arm import JointState, bare_arm
from robo47_qp.model.gripper import Gripper
from robo47_qp.model.robot import Robot
from robo47_qp.sim.camera import Sight
from robo47_qp.sim.cell_sheet import CellSheet
from robo47_qp.sim.simulation import Simulation

HIDDEN_BELOW = -0.5
"""Height below which a marker counts as hidden: completed ones are put under the floor [m]."""
AsSeen = Callable[[str, SE3], SE3 | None]
"""Returns what the cell's camera tells of an object or a marker whose pose it measures; None for
what it does not tell at all."""


class HandReading(NamedTuple):
    """What the sensors in one gripper measure."""

    width: float
    """Opening width [m]."""
    speed: float
    """Its rate [m/s]."""
    forces: Vector
    """Force on each finger (2,) [N]."""
    settled: bool
    """Whether the fingers stand still, at the commanded width or at the full force."""


class Reading(NamedTuple):
    """What all sensors of a cell measured at one instant."""

    time: float
    joints: JointState
    forces: Sequence[Vector]
    """Force at the wrist of each tool, in the world (3,) [N]."""
    hands: Sequence[HandReading | None]
    """Of each tool; None without a gripper."""
    sights: Mapping[str, Sight]
    """Objects, then markers, that the camera tells of."""


class Sensed:
    """What sensors and data sheets say of a cell, brought up to date by `Senses.read`.

    Programs and policies know this and nothing else: it holds copies of measurements, and leads
    to no part of the simulated world. Poses of tools follow from the measured joint positions.
    """

    def __init__(self, robot: Robot, sheet: CellSheet, objects: Sequence[str]) -> None:
        """Describe a cell before anything is measured; `objects` are the names of free bodies."""
        self.robot, self.sheet = robot, sheet
        self.objects = tuple(objects)
        self._arm = bare_arm(robot)
        self._now: Reading | None = None
        self._poses: dict[int, SE3] = {}

    def update(self, reading: Reading) -> None:
        """Take new measurements."""
        self._now = reading
        self._poses.clear()

    @property
    def reading(self) -> Reading:
        """The measurements.

        Raises:
            RuntimeError: Nothing has been measured yet.
        """
        if self._now is None:
            raise RuntimeError("nothing has been measured yet: call Senses.read() first")
        return self._now

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self.reading.time

    def state(self) -> JointState:
        """Return the measured joint positions and velocities, as copies."""
        q, v = self.reading.joints
        return JointState(q.copy(), v.copy())

    def tool_pose(self, tool: int = 0) -> SE3:
        """Return T_world_tcp of a tool, by its place in `Robot.tools`, as everywhere below."""
        if tool not in self._poses:
            self._poses[tool] = self._arm.pose(self.reading.joints.q, tool)
        return self._poses[tool]

    @property
    def gripper(self) -> Gripper:
        """The gripper of the main tool.

        Raises:
            NoGripperError: The tool has no gripper.
        """
        return self.gripper_of(0)

    def gripper_of(self, tool: int) -> Gripper:
        """Return the gripper of a tool.

        Raises:
            NoGripperError: The tool has no gripper.
        """
        gripper = self.robot.tools[tool].gripper
        if gripper is None:
            raise NoGripperError(self.robot.name, "the task")
        return gripper

    def width(self, tool: int = 0) -> float:
        """Return the opening width of a gripper [m]."""
        return self._hand("its width", tool).width

    def width_speed(self, tool: int = 0) -> float:
        """Return the rate of the opening width [m/s]."""
        return self._hand("its width", tool).speed

    def grip_settled(self, tool: int = 0) -> bool:
        """Return whether the fingers stand still, at the commanded width or at the full force."""
        return self._hand("a grip", tool).settled

    def finger_forces(self, tool: int = 0) -> Vector:
        """Return the force on each finger of a tool (2,) [N]."""
        return self._hand("the force of its fingers", tool).forces.copy()

    def felt_force(self, tool: int = 0) -> Vector:
        """Return the force on a tool as its wrist measures it, in the world (3,) [N]."""
        return self.reading.forces[tool].copy()

    @property
    def camera_noise(self) -> float:
        """Standard deviation of a seen position, per axis and frame, by the data sheet [m]."""
        return float(self.sheet.noise["pose_noise"])

    @property
    def weights_known(self) -> bool:
        """True where data sheets give no tolerance of the masses of objects."""
        return not self.sheet.noise["mass_tolerance"]

    @property
    def seen(self) -> tuple[str, ...]:
        """Names of what the camera tells of: objects, then markers."""
        return tuple(self.reading.sights)

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the markers that the camera tells of."""
        return tuple(name for name in self.seen if name not in self.objects)

    def seen_pose(self, name: str) -> SE3:
        """Return T_world_thing of an object or a marker as the camera of the cell measures it.

        A marker that stands for a pose that is asked for, and for no thing, is as asked for.

        Raises:
            UnknownNameError: The camera tells of nothing with this name.
        """
        return self._sight(name).pose

    def seen_time(self, name: str) -> float:
        """Return when the last frame with an object or a marker in it was taken [s].

        Raises:
            UnknownNameError: The camera tells of nothing with this name.
        """
        return self._sight(name).time

    def is_hidden(self, marker: str) -> bool:
        """Return whether a marker was hidden, as completed ones are.

        Raises:
            UnknownNameError: The camera tells of nothing with this name.
        """
        return bool(self._sight(marker).pose.translation()[2] < HIDDEN_BELOW)

    def _sight(self, name: str) -> Sight:
        sights = self.reading.sights
        if name not in sights:
            raise UnknownNameError("object or marker", name, tuple(sights))
        return sights[name]

    def _hand(self, wanted: str, tool: int) -> HandReading:
        hand = self.reading.hands[tool]
        if hand is None:
            raise NoGripperError(self.robot.name, wanted)
        return hand


class Senses:
    """Reads the sensors of a simulated cell into what programs and policies know of it."""

    def __init__(
        self,
        simulation: Simulation,
        sheet: CellSheet | None = None,
        as_seen: AsSeen = lambda _, pose: pose,
    ) -> None:
        """Use the sensors of a simulation.

        Args:
            simulation: The world.
            sheet: What data sheets say; by default nothing but the figures of the sensors.
            as_seen: What the camera tells of what it measures.
        """
        self._simulation, self._as_seen = simulation, as_seen
        self._hands = [tool.gripper is not None for tool in simulation.robot.tools]
        self._things = (*simulation.objects, *simulation.markers)
        self._last: dict[str, tuple[SE3, Sight | None]] = {}
        sheet = CellSheet(noise=simulation.noise_figures) if sheet is None else sheet
        self.sensed = Sensed(simulation.robot, sheet, simulation.objects)
        """What programs and policies know; a reading changes it."""

    def read(self) -> Sensed:
        """Measure everything now, and return what is known."""
        sim, tools = self._simulation, range(len(self._hands))
        sights = {name: sight for name in self._things if (sight := self._sight(name)) is not None}
        self.sensed.update(
            Reading(
                time=sim.time,
                joints=sim.state(),
                forces=[sim.felt_force(tool) for tool in tools],
                hands=[self._hand(tool) if self._hands[tool] else None for tool in tools],
                sights=sights,
            )
        )
        return self.sensed

    def _sight(self, name: str) -> Sight | None:
        sim = self._simulation
        measured = sim.seen_pose(name) if name in sim.objects else sim.seen_marker(name)
        last, sight = self._last.get(name, (None, None))
        # A camera gives the very same pose until its next frame.
        if measured is not last:
            pose = self._as_seen(name, measured)
            sight = None if pose is None else Sight(pose, sim.seen_time(name))
            self._last[name] = measured, sight
        return sight

    def _hand(self, tool: int) -> HandReading:
        sim = self._simulation
        return HandReading(
            width=sim.width(tool),
            speed=sim.width_speed(tool),
            forces=sim.last_finger_forces(tool),
            settled=sim.grip_settled(tool),
        )
