"""Link: the connection to a real arm and its hand, by pylibfranka."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any

from robo47_qp.arrays import Vector
from robo47_qp.errors import ArmStopped, MissingExtraError

TORQUES, FORCES = (30.0, 30.0, 30.0, 30.0, 12.0, 12.0, 12.0), (60.0, 60.0, 60.0, 30.0, 30.0, 30.0)
"""External torques [N·m], forces [N] and moments [N·m] on the tool at which the robot stops."""
LATE = 10
"""Commands missed in a row at which the arm is stopped; the robot itself does so at 20."""
_PRIORITY = 49
"""Real-time priority of a motion: below that of the kernel's own interrupts."""
_NAMES = re.compile(r'\[("\w+"(?:, "\w+")*)\]')
_NOTHING = (0.0,) * 7


class Link:
    """Sends torques to a robot and reads its state, one period after the other.

    Torques are those that libfranka takes: without gravity, which the robot adds.
    """

    def __init__(self, host: str) -> None:
        """Connect to robot and hand, and read them.

        Args:
            host: Address of the robot.

        Raises:
            MissingExtraError: pylibfranka is not installed.
            ArmStopped: The robot cannot be reached.
        """
        try:
            self._franka: Any = import_module("pylibfranka")
        except ImportError as error:
            raise MissingExtraError("--at", "pylibfranka", "franka") from error
        with self._told():
            self._robot = self._franka.Robot(host, self._franka.RealtimeConfig.kIgnore)
            self._hand = self._franka.Gripper(host)
        _take_turns()
        self._control: Any = None
        self.lost = 0
        """Periods of which no state has come since the motion began."""
        self.state: Any = None
        """What the robot has told last."""
        self.look()

    @property
    def active(self) -> bool:
        """Whether the robot takes torques now."""
        return self._control is not None

    def look(self) -> None:
        """Read robot and hand while nothing moves."""
        with self._told():
            self.state = self._robot.read_once()
            self.hand = self._hand.read_once()

    def prepare(self) -> None:
        """Make ready to move: clear a reflex, and set at which forces the robot stops.

        Raises:
            ArmStopped: The robot is stopped by its user, guided, or not ready.
        """
        modes = self._franka.RobotMode
        with self._told():
            if self.state.robot_mode == modes.Reflex:
                self._robot.automatic_error_recovery()
                self.look()
            if self.state.robot_mode != modes.Idle:
                mode = self.state.robot_mode.name
                raise ArmStopped(
                    f"the robot is in mode {mode} and takes no motion; release the stop, leave "
                    "guiding, and activate the FCI"
                )
            self._robot.set_collision_behavior(TORQUES, TORQUES, FORCES, FORCES)

    def start(self) -> None:
        """Begin to control torques, from rest."""
        _come_first()
        with self._told():
            self._control = self._robot.start_torque_control()
            self.state, _ = self._control.readOnce()
            # The periods since the last motion are not lost ones: counting begins after this one.
            self._control.writeOnce(self._franka.Torques(_NOTHING))
            self.state, _ = self._control.readOnce()
        self.lost = 0

    def exchange(self, tau: Vector) -> None:
        """Send torques (7,) [N·m], and wait for the state after them.

        Raises:
            ArmStopped: The robot has stopped, or cannot be heard.
        """
        with self._told():
            self._control.writeOnce(self._franka.Torques(tau.tolist()))
            self.state, passed = self._control.readOnce()
        missed = round(1e3 * passed.to_sec()) - 1
        self.lost += max(missed, 0)
        if missed >= LATE:
            raise ArmStopped(
                f"{missed} periods went by without a command; {LATE} in a row end a run. Leave the "
                "processor to it, and see to the network"
            )

    def finish(self, tau: Vector) -> None:
        """End the control of torques with a last one; the robot then holds the arm itself."""
        control, self._control = self._control, None
        last = self._franka.Torques(tau.tolist())
        last.motion_finished = True
        with self._told():
            control.writeOnce(last)
        _take_turns()

    def close(self) -> None:
        """Leave robot and hand; a motion that goes on is ended by libfranka."""
        self._control = self._robot = self._hand = None

    def grip(self, width: float, speed: float, force: float | None) -> bool:
        """Move the fingers, or grasp with a force [N]; return whether the hand says it is done."""
        with self._told("the hand: "):
            if force is None:
                done = self._hand.move(width, speed)
            else:
                done = self._hand.grasp(width, speed, force, 0.005, 0.08)
            self.hand = self._hand.read_once()
        return bool(done)

    @contextmanager
    def _told(self, whose: str = "") -> Iterator[None]:
        """Tell of what libfranka raises by one error, with its names of what went wrong."""
        try:
            yield
        except (self._franka.FrankaException, RuntimeError) as error:
            self._control = None
            _take_turns()
            text = " ".join(str(error).split())
            raise ArmStopped(whose + text, named(text)) from error


def _come_first() -> None:
    """Take real-time priority for a motion, where the machine permits it."""
    with suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))


def _take_turns() -> None:
    """Give it back, also what libfranka has taken by itself.

    Planning at that priority starves all else on its core, which the kernel gives its time back
    in the midst of a motion: 100 ms, where the robot waits for 20.
    """
    with suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def named(text: str) -> str:
    """Return the names of errors in a message of libfranka, separated by commas."""
    found = _NAMES.search(text)
    return found[1].replace('"', "") if found else ""
