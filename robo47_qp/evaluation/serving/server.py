"""PolicyServer: answers the observations of websocket clients with a policy's actions.

The protocol is that of openpi-client 0.1.2: on connecting, the server sends the policy's metadata;
then every binary message of the client is an observation, and is answered with a map that has the
actions. An error is a text, after which the connection ends.
"""

import asyncio
import logging
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from http import HTTPStatus
from signal import SIGINT, SIGTERM
from typing import Annotated, Any, Protocol, TypeVar

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.http11 import Request, Response

from robo47_qp.arrays import Checked, Count, Positive, Range
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.serving.messages import MessageError, packed, unpacked
from robo47_qp.run.foreign_code import Guard

_T = TypeVar("_T")
_LOOPBACK = "127.0.0.1"
_QUEUE = 2
"""Messages of a client that are read before the first of them is answered."""
_OPENING, _CLOSING = 10.0, 2.0
"""Time in which a client must open, and in which it may close, its connection [s]."""
_HEALTH = "/healthz"
"""Path that tells plain HTTP clients that the server is there."""
_WORDS = 2000
"""Longest text of an error [characters]."""


class Served(Protocol):
    """Answers the observations of one connection.

    Its class is made without arguments, anew for each connection. It may have `metadata`: a map
    that the client gets first.
    """

    def infer(self, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return a map with the `actions` for an observation."""
        ...


@dataclass(frozen=True, kw_only=True)
class PolicyServer(Checked):
    """Serves a policy; decisions are made one after the other, in the order of their messages.

    What a client does, be it rubbish, a message that is too long, silence or its death, ends its
    own connection and nothing else. A policy that raises ends the connection that it answered.
    """

    make: Callable[[], Served]
    """Makes the policy of a connection."""
    host: str = _LOOPBACK
    """Address to listen at: by default, of this machine alone."""
    port: Annotated[int, Range(at_least=0, at_most=65535, whole=True)] = 8000
    """Port to listen at; 0 takes any that is free."""
    clients: Count = 16
    """Connections at once; more are turned away."""
    longest: Count = 16 * 2**20
    """Longest message that is read [B]."""
    patience: Positive = 60.0
    """Time in which a client must take in its answer, and answer pings [s]."""
    told: Callable[[str], None] = lambda _: None
    """Hears one line about every connection that ends otherwise than by its client's wish."""

    @cached_property
    def _thread(self) -> ThreadPoolExecutor:
        """Where policies are made, and decide: one thread, as they may share what is not safe."""
        return ThreadPoolExecutor(max_workers=1, thread_name_prefix="policy")

    def run(self, ready: Callable[[str], None]) -> None:
        """Serve until SIGINT or SIGTERM; to be called in the main thread.

        Args:
            ready: Called with the address (ws://host:port) once clients can connect.

        Raises:
            InvalidValueError: The address or the port cannot be had.
        """

        async def until_signal() -> None:
            ended, loop = asyncio.Event(), asyncio.get_running_loop()
            for number in (SIGINT, SIGTERM):
                loop.add_signal_handler(number, ended.set)
            await self.serve(ready, ended)

        asyncio.run(until_signal())

    async def serve(self, ready: Callable[[str], None], ended: asyncio.Event) -> None:
        """Serve until `ended` is set; see `run`."""
        try:
            server = await self._listening()
        except (OSError, ValueError) as error:
            expected = "an address of this machine and a port that is free"
            why = getattr(error, "strerror", None) or error
            found = f"{self.host}:{self.port}, which cannot be had: {why}"
            raise InvalidValueError("the address to serve at", found, expected) from error
        async with server:
            host, port = next(iter(server.sockets)).getsockname()[:2]
            ready(f"ws://{f'[{host}]' if ':' in host else host}:{port}")
            await ended.wait()

    async def _listening(self) -> Server:
        silent = logging.getLogger("robo47_qp.serving")
        silent.addHandler(logging.NullHandler())
        silent.propagate = False
        return await serve(
            self._answered,
            self.host,
            self.port,
            compression=None,
            max_size=self.longest,
            max_queue=_QUEUE,
            open_timeout=_OPENING,
            close_timeout=_CLOSING,
            ping_timeout=self.patience,
            process_request=_healthy,
            logger=silent,
        )

    async def _answered(self, connection: ServerConnection) -> None:
        """Answer one client until it leaves, or does what ends its connection."""
        try:
            if len(connection.server.connections) > self.clients:
                words = f"{self.clients} clients are served at once, and that many are connected"
                await self._refused(connection, words, CloseCode.TRY_AGAIN_LATER)
            else:
                await self._served(connection)
        except ConnectionClosed as closed:
            if closed.sent is not None and closed.sent.code != CloseCode.NORMAL_CLOSURE:
                self.told(f"a connection ended: {closed}")
        except _Stuck:
            self.told(f"a connection ended: an answer was not taken in {self.patience:g} s")
            connection.transport.abort()

    async def _served(self, connection: ServerConnection) -> None:
        with Guard() as guard:
            policy = await self._worked(self.make)
            await self._sent(connection, packed(dict(getattr(policy, "metadata", {}))))
            async for message in connection:
                if isinstance(message, str):
                    raise MessageError("A message must be binary; found a text")
                answer = await self._worked(policy.infer, unpacked(message))
                await self._sent(connection, packed(answer))
        match guard.error:
            case None:
                return
            case ConnectionClosed() | _Stuck():
                raise guard.error
            case MessageError():
                await self._refused(connection, str(guard.error), CloseCode.INVALID_DATA)
            case error:
                words = f"the policy raised {type(error).__name__}: {error}"
                await self._refused(connection, words, CloseCode.INTERNAL_ERROR)

    async def _worked(self, do: Callable[..., _T], *given: object) -> _T:
        """Have the one thread of policies do something, while connections are looked after."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, do, *given)

    async def _sent(self, connection: ServerConnection, message: str | bytes) -> None:
        try:
            async with asyncio.timeout(self.patience):
                await connection.send(message)
        except TimeoutError as error:
            raise _Stuck from error

    async def _refused(self, connection: ServerConnection, words: str, code: CloseCode) -> None:
        """Tell a client why, and end its connection."""
        self.told(f"a connection ended: {words}")
        await self._sent(connection, words[:_WORDS])
        await connection.close(code, "see the text before")


class _Stuck(Exception):  # noqa: N818  # a state of the client, not an error of the server
    """A client that does not take its answer."""


def _healthy(connection: ServerConnection, request: Request) -> Response | None:
    """Answer plain HTTP at the path of health; None goes on with the websocket."""
    if request.path != _HEALTH:
        return None
    return connection.respond(HTTPStatus.OK, "OK\n")
