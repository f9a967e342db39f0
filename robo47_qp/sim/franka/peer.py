"""Peer: a client of the server, and the sockets by which clients come."""

import socket
from struct import Struct

_LARGEST = 1 << 12
"""Largest request [bytes]; those of the protocol are smaller."""


class Peer:
    """A client: its TCP connection, what has come of a request, and where its UDP goes."""

    def __init__(self, connection: socket.socket, address: str, header: Struct) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.settimeout(1.0)
        self.connection, self.address, self._header = connection, address, header
        self.udp: tuple[str, int] | None = None
        self._received = b""

    def requests(self) -> list[tuple[int, int, bytes]] | None:
        """Return command, id and body of the requests that have come; None if it is gone."""
        try:
            data = self.connection.recv(_LARGEST)
        except OSError:
            return None
        if not data:
            return None
        self._received += data
        found = []
        while len(self._received) >= self._header.size:
            command, number, size = self._header.unpack_from(self._received)
            if not self._header.size <= size <= _LARGEST:
                return None
            if len(self._received) < size:
                break
            found.append((command, number, self._received[self._header.size : size]))
            self._received = self._received[size:]
        return found

    def answer(self, command: int, number: int, body: bytes) -> None:
        """Answer a request; a client that is gone is noticed when it is read from."""
        try:
            size = self._header.size + len(body)
            self.connection.sendall(self._header.pack(command, number, size) + body)
        except OSError:
            return


def door(host: str, port: int) -> socket.socket:
    """Return a socket that listens at a port.

    Raises:
        OSError: The port cannot be bound.
    """
    one = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        one.bind((host, port))
        one.listen(4)
    except OSError:
        one.close()
        raise
    return one


def datagrams(host: str) -> socket.socket:
    """Return a socket for UDP at some port, which does not block.

    Raises:
        OSError: The address cannot be bound.
    """
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.setblocking(False)
    try:
        one.bind((host, 0))
    except OSError:
        one.close()
        raise
    return one
