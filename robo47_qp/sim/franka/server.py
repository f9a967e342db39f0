"""FrankaServer: a simulation that answers clients of libfranka."""

import select
import socket
from collections.abc import Callable
from struct import Struct
from time import monotonic

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError
from robo47_qp.sim.franka import protocol
from robo47_qp.sim.franka.peer import Peer, datagrams, door
from robo47_qp.sim.franka.protocol import (
    Command,
    Controller,
    Generator,
    HandCommand,
    HandStatus,
    MoveStatus,
)
from robo47_qp.sim.franka.served_arm import ServedArm
from robo47_qp.sim.franka.served_hand import ServedHand
from robo47_qp.sim.franka.urdf import urdf
from robo47_qp.sim.simulation import Simulation

_IDLE_SENDS = 0.005
"""Time between two states that are sent while a lock-step world stands still [s]."""
_HAND_EVERY = 0.02
"""Time between two states of the hand [s]."""
_BEHIND = 0.05
"""Delay beyond which a world on wall time gives up catching up [s]."""
_SETTLING, _AT_REST = 2000, 1e-4
"""Periods in which an arm comes to rest at most, and the speed of its joints then [rad/s]."""
_MONITOR_EVERY = 20
"""Periods between two looks at the world."""
_NUMBERS = ("q", "dq", "O_T_EE", "O_dP_EE", "elbow", "tau")
"""What of a command must be finite; libfranka sends nothing else."""
_GETTERS = {
    Command.SET_COLLISION_BEHAVIOR: Struct("<52d"),
    Command.SET_JOINT_IMPEDANCE: Struct("<7d"),
    Command.SET_CARTESIAN_IMPEDANCE: Struct("<6d"),
    Command.SET_EE_TO_K: Struct("<16d"),
    Command.SET_NE_TO_EE: Struct("<16d"),
    Command.SET_LOAD: protocol.LOAD,
}


class FrankaServer:
    """Serves one client at a time; use it as a context, which binds and releases its ports.

    On wall time a period takes a millisecond, and a command that has not come is lost. In
    lock-step a period of a motion passes when its command has come, and the world stands still
    without a motion and without a command to the hand: a loaded machine changes nothing.
    """

    def __init__(
        self,
        simulation: Simulation,
        reset: Callable[[], None],
        host: str = "127.0.0.1",
        *,
        lock_step: bool = False,
        left: Callable[[], bool] = lambda: False,
        monitor: Callable[[], None] = lambda: None,
    ) -> None:
        """Describe a server.

        Args:
            simulation: The world; its robot is an arm with seven joints and a hand.
            reset: Puts the world at the start, for every new client.
            host: Address to bind, at the ports 1337 and 1338.
            lock_step: Whether the world waits for commands.
            left: Called when a client has left; True ends the server.
            monitor: Called every few periods.

        Raises:
            InvalidValueError: The robot cannot be served.
        """
        self._sim, self._reset, self._host, self._left = simulation, reset, host, left
        self._lock_step, self._monitor = lock_step, monitor
        self._arm, self._hand = ServedArm(simulation), ServedHand(simulation)
        self._urdf = urdf(simulation.robot, simulation.model).encode()
        self._id = self._last_sent = self._frozen_answers = 0
        self._move: int | None = None
        self._grip: tuple[int, int] | None = None
        self._robot: Peer | None = None
        self._gripper: Peer | None = None
        self._sockets: list[socket.socket] = []
        self.periods = 0
        """Periods that have passed."""

    def __enter__(self) -> "FrankaServer":
        """Bind the ports.

        Raises:
            InvalidValueError: They cannot be bound.
        """
        try:
            self._robot_door = self._opened(door(self._host, protocol.ROBOT_PORT))
            self._hand_door = self._opened(door(self._host, protocol.HAND_PORT))
            self._udp = self._opened(datagrams(self._host))
            self._hand_udp = self._opened(datagrams(self._host))
        except OSError as error:
            self.__exit__()
            expected = "an address of this machine whose ports 1337 and 1338 are free"
            raise InvalidValueError("--host", f"{self._host} ({error})", expected) from error
        return self

    def __exit__(self, *_: object) -> None:
        """Release the ports."""
        for peer in (self._robot, self._gripper):
            if peer is not None:
                peer.connection.close()
        for one in self._sockets:
            one.close()

    def serve(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Serve until `stop` says so, or `left` did."""
        next_period = next_hand = monotonic()
        ended = False
        while not (ended or stop()):
            now = monotonic()
            if now >= next_hand:
                self._send_hand()
                next_hand = now + _HAND_EVERY
            ended = self._heard(max(0.0, min(next_period, next_hand) - now))
            now = monotonic()
            if self._lock_step:
                if self._grip is not None and not self._arm.moving:
                    self._pass(None)
                elif now >= next_period and not (self._arm.moving and self._frozen_answers):
                    self._send_state()
                    next_period = now + _IDLE_SENDS
            elif now >= next_period:
                self._pass(self._command if self._arm.moving else None)
                self._command = None
                next_period = max(next_period + TIMESTEP, now - _BEHIND)
                self._send_state()

    _command: np.void | None = None

    def _pass(self, command: np.void | None) -> None:
        """Let a period pass, and answer what it ends."""
        self.periods += 1
        if self._arm.advance(command):
            if self._arm.errors:
                # It is told at once, as a client does not wait for long.
                self._end_move(MoveStatus.REFLEX_ABORTED)
            self._settle()
            self._end_move(MoveStatus.SUCCESS)
        if self.periods % _MONITOR_EVERY == 0:
            self._monitor()
        status = self._hand.look()
        if status is not None:
            self._answer_grip(status)

    def _settle(self) -> None:
        """Let an arm that was stopped come to rest, in a world that would then stand still."""
        if self._lock_step:
            for _ in range(_SETTLING):
                if np.abs(self._sim.true_state().v).max() < _AT_REST:
                    return
                self._arm.advance(None)

    def _end_move(self, status: MoveStatus) -> None:
        # A client reads the state that ends its motion before the answer, or after it.
        self._send_state()
        if self._move is not None and self._robot is not None:
            self._robot.answer(Command.MOVE, self._move, protocol.REPLY["status"].pack(status))
        self._move = None

    def _heard(self, seconds: float) -> bool:
        """Wait for something to come, and take it; return whether the server has to end."""
        peers = [peer for peer in (self._robot, self._gripper) if peer is not None]
        doors = [self._robot_door, self._hand_door, self._udp]
        ready, _, _ = select.select([*doors, *(peer.connection for peer in peers)], [], [], seconds)
        if self._udp in ready:
            self._hear_command()
        if self._robot is not None and self._robot.connection in ready and self._robot_leaves():
            return self._left()
        if self._gripper is not None and self._gripper.connection in ready:
            self._hear_hand(self._gripper)
        if self._robot_door in ready:
            self._robot = self._met(self._robot_door, self._robot, protocol.HEADER)
        if self._hand_door in ready:
            self._gripper = self._met(self._hand_door, self._gripper, protocol.HAND_HEADER)
        return False

    def _met(self, entrance: socket.socket, known: Peer | None, header: Struct) -> Peer | None:
        """Return the client that comes in; a second one is turned away."""
        connection, (address, _) = entrance.accept()
        if known is not None:
            connection.close()
            return known
        return Peer(connection, address, header)

    def _robot_leaves(self) -> bool:
        """Answer the robot's client; return whether it has gone."""
        peer = self._robot
        if peer is None:
            return False
        requests = peer.requests()
        for command, number, body in requests or ():
            if command not in set(Command):
                requests = None
                break
            self._answer(peer, Command(command), number, body)
        if requests is not None:
            return False
        self._part()
        return True

    def _part(self) -> None:
        """Part from the robot's client, and stop what it moved."""
        if self._robot is not None:
            self._robot.connection.close()
        self._robot = self._move = None
        self._arm.stop()
        self._settle()

    def _answer(self, peer: Peer, command: Command, number: int, body: bytes) -> None:
        """Do what a request to the robot says, and answer."""
        status, arm = protocol.SUCCESS, self._arm
        if command is Command.CONNECT:
            peer.answer(command, number, self._connected(peer, body, protocol.ROBOT_VERSION))
            self._reset()
            self._arm.reset()
            self._hand.reset()
            return
        if command is Command.GET_ROBOT_MODEL:
            peer.answer(command, number, protocol.REPLY["status"].pack(status) + self._urdf)
            return
        if command is Command.MOVE:
            peer.answer(command, number, protocol.REPLY["status"].pack(self._start(number, body)))
            return
        if command is Command.STOP_MOVE:
            if arm.moving:
                arm.stop()
                self._settle()
                self._end_move(MoveStatus.PREEMPTED)
            peer.answer(command, number, protocol.REPLY["status"].pack(status))
            return
        if command is Command.AUTOMATIC_ERROR_RECOVERY:
            arm.recover()
        elif command in _GETTERS and len(body) == _GETTERS[command].size:
            status = self._set(command, np.array(_GETTERS[command].unpack(body)))
        elif command in _GETTERS:
            status = protocol.INVALID_ARGUMENT
        else:
            status = protocol.REJECTED
        # The state that the client reads next is that after its request.
        self._send_state()
        peer.answer(command, number, protocol.REPLY["status"].pack(status))

    def _start(self, number: int, body: bytes) -> MoveStatus:
        if len(body) != protocol.MOVE.size:
            return MoveStatus.INVALID_ARGUMENT
        controller, generator, *_ = protocol.MOVE.unpack(body)
        if self._arm.moving or self._arm.errors:
            return MoveStatus.NOT_POSSIBLE
        if controller > Controller.EXTERNAL or generator >= Generator.NONE:
            return MoveStatus.INVALID_ARGUMENT
        # A request counts the generators from 0, a state from 1.
        self._arm.start(Controller(controller), Generator(generator + 1))
        self._move, self._frozen_answers, self._command = number, 0, None
        self._last_sent = self._id
        self._started_at = self._id
        return MoveStatus.STARTED

    def _set(self, command: Command, values: Vector) -> int:
        """Take what a client sets while nothing moves; return the status."""
        if self._arm.moving and command is not Command.SET_COLLISION_BEHAVIOR:
            return protocol.REJECTED
        if not np.isfinite(values).all():
            return protocol.INVALID_ARGUMENT
        arm = self._arm
        if command is Command.SET_COLLISION_BEHAVIOR:
            arm.torque_limits = np.maximum(values[7:14], values[21:28])
            arm.force_limits = np.maximum(values[34:40], values[46:52])
        elif command is Command.SET_LOAD:
            arm.set_load(float(values[0]), values[1:4], values[4:])
        elif command in (Command.SET_EE_TO_K, Command.SET_NE_TO_EE):
            matrix = values.reshape(4, 4).T
            rotation = SO3.from_matrix(matrix[:3, :3])
            pose = SE3.from_rotation_and_translation(rotation, matrix[:3, 3].copy())
            if command is Command.SET_EE_TO_K:
                arm.set_frames(T_ee_k=pose)
            else:
                arm.set_frames(T_ne_ee=pose)
        return protocol.SUCCESS

    def _connected(self, peer: Peer, body: bytes, version: int) -> bytes:
        """Return the answer to a client that introduces itself."""
        hand = version == protocol.HAND_VERSION
        layout = protocol.REPLY["hand connect" if hand else "connect"]
        theirs, port = protocol.CONNECT.unpack(body)
        if theirs != version:
            return layout.pack(protocol.INCOMPATIBLE, version)
        peer.udp = (peer.address, port)
        return layout.pack(protocol.SUCCESS, version)

    def _hear_command(self) -> None:
        """Take the commands that have come by UDP."""
        while True:
            try:
                data, _ = self._udp.recvfrom(protocol.COMMAND.itemsize + 1)
            except BlockingIOError:
                return
            if len(data) != protocol.COMMAND.itemsize or not self._arm.moving:
                continue
            command = np.frombuffer(data, protocol.COMMAND)[0]
            if int(command["id"]) <= self._started_at:
                continue
            if not all(np.isfinite(command[name]).all() for name in _NUMBERS):
                self._part()
                return
            if not self._lock_step:
                self._command = command
            elif self._stepped(command):
                self._pass(command)
                if self._arm.moving:
                    self._send_state()

    def _stepped(self, command: np.void) -> bool:
        """Return whether a period of lock-step passes with a command.

        How many states a client has read of the world that stands still before its motion is a
        matter of chance. So it is let answer two of them, of which the first one is left out:
        whatever was sent beyond what it first answered, it answers the newest next.
        """
        self._frozen_answers += 1
        if self._frozen_answers > 1:
            return int(command["id"]) == self._last_sent
        if int(command["id"]) == self._last_sent:
            self._send_state()
        return False

    def _send_state(self) -> None:
        self._id += 1
        self._last_sent = self._id
        if self._robot is not None and self._robot.udp is not None:
            self._send(self._udp, self._arm.packed(self._id), self._robot.udp)

    def _send_hand(self) -> None:
        if self._gripper is not None and self._gripper.udp is not None:
            self._send(self._hand_udp, self._hand.packed(self._id), self._gripper.udp)

    def _hear_hand(self, peer: Peer) -> None:
        """Answer the hand's client."""
        requests = peer.requests()
        for number_of_command, number, body in requests or ():
            if number_of_command not in set(HandCommand):
                requests = None
                break
            command = HandCommand(number_of_command)
            if command is HandCommand.CONNECT:
                answer = self._connected(peer, body, protocol.HAND_VERSION)
                peer.answer(command, number, answer)
                continue
            if self._grip is not None:
                self._answer_grip(HandStatus.ABORTED)
            self._grip = (command, number)
            status = self._hand.start(command, body)
            if status is not None:
                self._answer_grip(status)
        if requests is None:
            peer.connection.close()
            self._gripper = self._grip = None

    def _answer_grip(self, status: HandStatus) -> None:
        if self._gripper is not None and self._grip is not None:
            # The state that the client reads next is that after its command.
            self._send_hand()
            command, number = self._grip
            body = protocol.REPLY["hand status"].pack(status)
            self._gripper.answer(command, number, body)
        self._grip = None

    def _send(self, udp: socket.socket, data: bytes, to: tuple[str, int]) -> None:
        try:
            udp.sendto(data, to)
        except OSError:
            return

    def _opened(self, one: socket.socket) -> socket.socket:
        self._sockets.append(one)
        return one
