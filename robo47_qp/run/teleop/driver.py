"""TeleopDriver: moves the arm after a target, with streaming inverse kinematics."""

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from signal import SIGINT, signal
from threading import current_thread, main_thread
from typing import Annotated

import numpy as np
from mink import SE3

from robo47_qp.arrays import Checked, Matrix, NotNegative, Range
from robo47_qp.constants import TIMESTEP
from robo47_qp.ik.stream.settings import Event
from robo47_qp.ik.stream.stream import StreamIk
from robo47_qp.model.arm import JOINT_MARGIN, Arm
from robo47_qp.model.gripper import Grip
from robo47_qp.model.obstacle import Obstacle
from robo47_qp.motion.smooth_stream import SmoothStream
from robo47_qp.motion.trajectory import hold
from robo47_qp.run.control_loop import TICK_ROWS, ControlLoop
from robo47_qp.run.failure import Failure
from robo47_qp.run.runner import Runner
from robo47_qp.run.signals import followed
from robo47_qp.run.teleop.hand_path import HandPath
from robo47_qp.run.teleop.steering import SmoothedPose, moved_by_key

TARGET = "target"
"""Name of the mocap body that is followed."""
LONGEST = 590.0
"""Longest run [s]."""
_SMOOTHED = 20
"""Ticks over which commands are averaged, for the torque rate of the motors."""
_CLOSING = 2.0
"""Longest time for closing the fingers at the start [s]."""
_BRAKING = 10.0
"""Longest time for coming to rest at the end [s]."""
_AGAIN = 1.0
"""An event is noted again where it was absent for so long [s]."""


@dataclass(frozen=True, kw_only=True)
class TeleopSettings(Checked):
    """How long a target is followed, and how."""

    seconds: Annotated[float, Range(above=0.0, at_most=LONGEST)] = 60.0
    """Time after which it ends by itself [s]."""
    path: HandPath | None = None
    """What moves the target; None leaves it to a person in the viewer's window."""
    clearance: NotNegative = 0.01
    """Distance to keep between links and from obstacles [m]."""
    obstacles: tuple[Obstacle, ...] = ()
    """What is kept at this distance besides the arm itself."""


class TeleopDriver:
    """Follows the mocap body `TARGET`, in a run like any other.

    The target is dragged with the mouse in the viewer, moved by keys, or by a hand path. It ends
    when its time is over, when the window is closed, or with Ctrl-C; then the arm comes to rest.
    """

    def __init__(self, settings: TeleopSettings) -> None:
        """Keep the settings."""
        self._settings = settings
        self._keys: deque[int] = deque()
        self._noted: dict[Event, float] = {}
        self._left = False
        self.signals = followed()
        """Signals that it adds to a recording."""
        self.moves = TARGET
        """See `Operator.moves`."""
        self.interrupted = False
        """True once Ctrl-C has ended it."""

    @property
    def seconds(self) -> float:
        """Longest simulated time that it takes [s]."""
        return self._settings.seconds

    def press(self, key: int) -> None:
        """Move the target by a key; may be called from any thread."""
        self._keys.append(key)

    def leave(self) -> None:
        """End at the next control period that allows it."""
        self._left = True

    def drive(self, runner: Runner) -> Failure | None:
        """See `Driver.drive`."""
        loop, settings = runner.loop, self._settings
        start = loop.arm.pose(loop.reference.q)
        ik = StreamIk(
            dt=TIMESTEP, profile=loop.profile, margin=JOINT_MARGIN, clearance=settings.clearance
        )
        arm = Arm(loop.arm.robot, obstacles=settings.obstacles)
        stream = SmoothStream(ik.build(arm), _SMOOTHED)
        loop.sim.place_marker(TARGET, start)
        _close_gripper(loop, start)
        stream.reset(loop.reference)
        smoothed, began = SmoothedPose(start), loop.sim.time
        loop.begin("follow", streamed=True)
        with self._until_interrupted():
            while not self._left and loop.sim.time < began + settings.seconds - 0.5 * TIMESTEP:
                targets = self._next_targets(loop, start, smoothed, loop.sim.time - began)
                trajectory = stream.block(targets)
                events = [tick.events for tick in stream.ticks]
                loop.track(trajectory, extra=_columns(targets, events))
                self._note(loop, events)
        _brake(loop, stream)
        return None

    def _next_targets(
        self, loop: ControlLoop, start: SE3, smoothed: SmoothedPose, time: float
    ) -> list[SE3]:
        """Return the targets of the next block, and move the marker."""
        path = self._settings.path
        if path is not None:
            targets = path.poses(time + TIMESTEP * np.arange(TICK_ROWS), start)
            loop.sim.place_marker(TARGET, targets[-1])
            return targets
        goal = loop.sim.marker_pose(TARGET)
        while self._keys:
            goal = moved_by_key(self._keys.popleft(), goal, start)
            loop.sim.place_marker(TARGET, goal)
        return [smoothed.step(goal) for _ in range(TICK_ROWS)]

    def _note(self, loop: ControlLoop, events: Sequence[Sequence[Event]]) -> None:
        """Report events that were absent before."""
        time = loop.sim.time
        for event in dict.fromkeys(event for now in events for event in now):
            if time - self._noted.get(event, -_AGAIN) >= _AGAIN:
                loop.note(event.value)
            self._noted[event] = time

    @contextmanager
    def _until_interrupted(self) -> Iterator[None]:
        """Let Ctrl-C end the motion and not the program; a second one ends that, too."""
        if current_thread() is not main_thread():
            yield
            return

        def interrupt(*_: object) -> None:
            self.interrupted = True
            self.leave()
            signal(SIGINT, before)

        before = signal(SIGINT, interrupt)
        try:
            yield
        finally:
            signal(SIGINT, before)


def _close_gripper(loop: ControlLoop, target: SE3) -> None:
    """Close the fingers, as the arm takes them to be where it keeps its distances."""
    gripper = loop.arm.robot.gripper
    if gripper is None:
        return
    still = hold(loop.reference.q, round(_CLOSING / TIMESTEP), TIMESTEP)
    columns = np.repeat(_columns([target], [()]), still.steps, axis=0)
    loop.begin("close")
    loop.sim.command_grip(Grip(width=0.0, force=0.2 * gripper.force_max))
    loop.track(still, until=loop.sim.grip_settled, extra=columns)


def _brake(loop: ControlLoop, stream: SmoothStream) -> None:
    """Come to rest within the clearances, which a stop by the profile alone would not know."""
    end = loop.sim.time + _BRAKING
    loop.begin("brake", streamed=True)
    while not loop.resting and loop.sim.time < end:
        loop.track(stream.block([None] * TICK_ROWS))


def _columns(targets: Sequence[SE3], events: Sequence[Sequence[Event]]) -> Matrix:
    """Return the columns of `signals.followed` for each period."""
    poses = np.array([target.wxyz_xyz for target in targets])
    told = [[float(event in now) for event in Event] for now in events]
    return np.hstack([poses[:, 4:], poses[:, :4], told])
