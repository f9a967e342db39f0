"""ServedHand: the gripper of a simulation that does what libfranka's commands to a hand say."""

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.gripper import Grip
from robo47_qp.sim.franka import protocol
from robo47_qp.sim.franka.protocol import HandCommand, HandStatus
from robo47_qp.sim.simulation import Simulation

_STILL, _LONGEST = 50, 5000
"""Periods for which the fingers must stand still, and after which a command has failed."""
_HOLDS = 1.0
"""Force of a finger above which something is between them [N]."""
_TEMPERATURE = 25


class ServedHand:
    """The hand of a simulation: one command at a time, which takes as long as the fingers do."""

    def __init__(self, simulation: Simulation) -> None:
        """Serve the gripper of a simulation."""
        self._sim = simulation
        self.reset()

    def reset(self) -> None:
        """Forget what was grasped."""
        self._grasp: tuple[float, float] | None = None
        self._still = self._waited = 0
        self.busy = False
        """Whether a command is being carried out."""

    def start(self, command: HandCommand, body: bytes) -> HandStatus | None:
        """Start to carry out a command; return its answer, or None while it takes time."""
        width, force = self._sim.width(), self._sim.gripper_of().force_max
        speed = self._sim.gripper_of().speed_max
        within = None
        if command is HandCommand.GRASP:
            asked, inner, outer, speed, force = protocol.GRASP.unpack(body)
            # Whatever is in between, the fingers press on it; the width only judges.
            within, width = (asked - inner, asked + outer), 0.0
        elif command is HandCommand.MOVE:
            width, speed = protocol.HAND_MOVE.unpack(body)
        elif command is HandCommand.HOMING:
            width = self._sim.gripper_of().width_max
        try:
            self._sim.command_grip(Grip(width=width, force=force, speed=speed))
        except InvalidValueError:
            return HandStatus.FAIL
        self._grasp, self._still, self._waited = within, 0, 0
        self.busy = command is not HandCommand.STOP
        return None if self.busy else HandStatus.SUCCESS

    def look(self) -> HandStatus | None:
        """Look at the fingers after a period; return the answer to the command once it is done."""
        if not self.busy:
            return None
        self._waited += 1
        self._still = self._still + 1 if self._sim.grip_settled() else 0
        if self._still < _STILL and self._waited < _LONGEST:
            return None
        self.busy = False
        if self._still < _STILL:
            return HandStatus.FAIL
        if self._grasp is None or self.is_grasped:
            return HandStatus.SUCCESS
        return HandStatus.UNSUCCESSFUL

    @property
    def is_grasped(self) -> bool:
        """Whether the fingers press on something of the width that was asked for."""
        if self._grasp is None:
            return False
        least, most = self._grasp
        pressed = float(self._sim.last_finger_forces().min()) > _HOLDS
        return pressed and least < self._sim.width() < most

    def packed(self, message_id: int) -> bytes:
        """Return the state as a message."""
        sim = self._sim
        return protocol.HAND_STATE.pack(
            message_id & 0xFFFFFFFF,
            sim.width(),
            sim.gripper_of().width_max,
            self.is_grasped,
            _TEMPERATURE,
        )
