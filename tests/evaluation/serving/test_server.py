"""The policy server against clients that behave, and against those that do not."""

import asyncio
import os
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from queue import Queue
from threading import Event, Thread
from typing import Any, ClassVar

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, ConnectionClosedError
from websockets.sync.client import ClientConnection, connect

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.serving.messages import packed, unpacked
from robo47_qp.evaluation.serving.server import PolicyServer

ROOT = Path(__file__).resolve().parents[3]
JUDGE = ROOT / ".judges" / "robosuite" / "bin" / "python"


class Counting:
    """Counts the observations of its connection; raises where it is asked to."""

    metadata: Mapping[str, Any] = {"name": "counting", "q": np.zeros(7)}

    def __init__(self) -> None:
        self.count = 0

    def infer(self, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        if "raise" in observation:
            raise RuntimeError("as asked")
        if "object" in observation:
            return {"actions": object()}
        self.count += 1
        return {"actions": observation["q"] + 1.0, "count": self.count}


class Unmade:
    """Cannot be made."""

    def __init__(self) -> None:
        raise RuntimeError("never made")


@contextmanager
def served(make: Any = Counting, **settings: Any) -> Iterator[tuple[str, list[str]]]:
    """The address of a server in a thread, and what it tells."""
    said: Queue[str] = Queue()
    told: list[str] = []
    loop, ended = asyncio.new_event_loop(), asyncio.Event()
    server = PolicyServer(make=make, port=0, told=told.append, **settings)
    thread = Thread(target=lambda: loop.run_until_complete(server.serve(said.put, ended)))
    thread.start()
    try:
        yield said.get(timeout=20.0), told
    finally:
        loop.call_soon_threadsafe(ended.set)
        thread.join(timeout=20.0)
        assert not thread.is_alive()
        loop.close()


@contextmanager
def joined(at: str) -> Iterator[ClientConnection]:
    with connect(at, compression=None) as client:
        assert unpacked(received(client))["name"] == "counting"
        yield client


def received(client: ClientConnection) -> bytes:
    message = client.recv(timeout=20.0)
    assert isinstance(message, bytes), message
    return message


def asked(client: ClientConnection, **observation: Any) -> dict[str, Any]:
    client.send(packed(observation or {"q": np.zeros(7)}))
    return unpacked(received(client))


def test_metadata_comes_first_then_actions() -> None:
    with served() as (at, told):
        assert at.startswith("ws://127.0.0.1:")
        with connect(at, compression=None) as client:
            np.testing.assert_array_equal(unpacked(received(client))["q"], np.zeros(7))
            answer = asked(client, q=np.arange(7.0))
            np.testing.assert_array_equal(answer["actions"], np.arange(7.0) + 1.0)
        # Each connection has a policy of its own.
        with joined(at) as first, joined(at) as second:
            assert [asked(first)["count"], asked(first)["count"]] == [1, 2]
            assert asked(second)["count"] == 1
    assert told == []


def refusal(client: ClientConnection) -> tuple[str, int]:
    """The text that a client is told, and the code that its connection ends with."""
    text = client.recv(timeout=20.0)
    assert isinstance(text, str)
    with pytest.raises(ConnectionClosed) as closed:
        client.recv(timeout=20.0)
    assert closed.value.rcvd is not None
    return text, closed.value.rcvd.code


def test_rubbish_ends_its_own_connection_only() -> None:
    with served(longest=10_000) as (at, told), joined(at) as good:
        assert asked(good)["count"] == 1
        for message, words, code in (
            (b"\xc1rubbish", "A message must be msgpack", 1007),
            ("a text", "A message must be binary; found a text", 1007),
            (packed({"raise": 1}), "the policy raised RuntimeError: as asked", 1011),
            (packed({"object": 1}), "must hold numbers, text and arrays; found a object", 1007),
        ):
            with joined(at) as bad:
                bad.send(message)
                said = refusal(bad)
            assert words in said[0]
            assert said[1] == code
        with joined(at) as bad:
            bad.send(bytes(10_001))
            with pytest.raises(ConnectionClosedError, match="1009"):
                bad.recv(timeout=20.0)
        assert asked(good)["count"] == 2
    assert len(told) == 5
    assert "too big" in told[4]


def header(size: int) -> bytes:
    """Begin of a masked binary frame of a websocket (RFC 6455, section 5.2)."""
    return b"\x82\xff" + size.to_bytes(8, "big") + bytes(4)


def shaken(at: str) -> socket.socket:
    """A socket after the handshake of a websocket (RFC 6455, section 1.3)."""
    host, port = at.removeprefix("ws://").split(":")
    line = socket.create_connection((host, int(port)), timeout=20.0)
    line.sendall(
        f"GET / HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    assert b"s3pPLMBiTxaQ9kYGzzhZRbK+xOo=" in line.recv(4096)
    return line


def test_a_gigabyte_or_a_death_ends_its_own_connection_only() -> None:
    with served() as (at, _), joined(at) as good:
        # A gigabyte is refused at its announcement.
        line = shaken(at)
        line.sendall(header(10**9))
        parts = b""
        while part := line.recv(4096):
            parts += part
        line.close()
        assert b"\x03\xf1" in parts  # 1009
        # Clients that die: in a message, while they are owed an answer, and before the handshake.
        line = shaken(at)
        line.sendall(header(1000) + bytes(10))
        line.close()
        with joined(at) as dead:
            dead.send(packed({"q": np.zeros(7)}))
            dead.socket.shutdown(socket.SHUT_RDWR)
        host, port = at.removeprefix("ws://").split(":")
        socket.create_connection((host, int(port))).close()
        assert asked(good)["count"] == 1


def test_a_client_that_takes_no_answer_is_left() -> None:
    class Long:
        metadata: Mapping[str, Any] = {"name": "counting"}

        def infer(self, observation: Mapping[str, Any]) -> Mapping[str, Any]:
            return {"actions": np.zeros(1_000_000 if "long" in observation else 1)}

    with served(Long, patience=0.2) as (at, told):
        line = shaken(at)
        content = packed({"long": 1})
        frame = b"\x82" + bytes([0x80 | len(content)]) + bytes(4) + content
        for _ in range(20):
            line.sendall(frame)
        with joined(at) as good:
            while not told:
                good.send(packed({}))
                received(good)
        line.close()
    assert told == ["a connection ended: an answer was not taken in 0.2 s"]


def test_more_clients_than_said_are_turned_away() -> None:
    with served(clients=1) as (at, _), joined(at) as good:
        with connect(at, compression=None) as late:
            words, code = refusal(late)
        assert "1 clients are served at once" in words
        assert code == 1013
        assert asked(good)["count"] == 1


def test_a_policy_that_cannot_be_made_is_told() -> None:
    with served(Unmade) as (at, _):
        with connect(at, compression=None) as client:
            words, code = refusal(client)
        assert (words, code) == ("the policy raised RuntimeError: never made", 1011)


def test_health_is_told_by_http() -> None:
    with served() as (at, _):
        url = at.replace("ws://", "http://") + "/healthz"
        with urllib.request.urlopen(url, timeout=20.0) as answer:
            assert answer.read() == b"OK\n"


DECIDED = Event()


class Waiting(Counting):
    """Decides once the test says so, and not while another one does."""

    deciding: ClassVar[list["Waiting"]] = []

    def infer(self, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        self.deciding.append(self)
        assert len(self.deciding) == 1
        assert DECIDED.wait(timeout=20.0)
        self.deciding.remove(self)
        return super().infer(observation)


def test_clients_are_looked_after_while_a_policy_decides() -> None:
    """Pings, and answers that others take, must not wait for a decision: they have their time."""
    DECIDED.clear()
    with served(Waiting) as (at, told), joined(at) as first, joined(at) as second:
        for client in (first, second):
            client.send(packed({"q": np.zeros(7)}))
        url = at.replace("ws://", "http://") + "/healthz"
        with urllib.request.urlopen(url, timeout=10.0) as answer:
            assert answer.read() == b"OK\n"
        assert first.ping().wait(timeout=10.0)
        DECIDED.set()
        assert [unpacked(received(one))["count"] for one in (first, second)] == [1, 1]
        assert told == []


@pytest.mark.parametrize("host", ["a..b", "no.such.host.invalid"])
def test_a_host_that_is_none_is_told(host: str) -> None:
    server = PolicyServer(make=Counting, host=host, port=0)
    with pytest.raises(InvalidValueError, match=f"{host}:0, which cannot be had: "):
        asyncio.run(server.serve(lambda _: None, asyncio.Event()))


def test_a_port_that_is_taken_is_told() -> None:
    with served() as (at, _):
        second = PolicyServer(make=Counting, port=int(at.rsplit(":", 1)[1]))
        told = f"a port that is free; found 127.0.0.1:{second.port}, which cannot be had"
        with pytest.raises(InvalidValueError, match=told):
            asyncio.run(second.serve(lambda _: None, asyncio.Event()))


COMMAND = ["-m", "robo47_qp", "serve-policy", "--policy", f"{__file__}:Counting", "--port", "0"]
IN_PYTHON = f"""
from robo47_qp.evaluation.serving.server import PolicyServer
from robo47_qp.run.foreign_code import load_class
made = load_class("policy", {f"{__file__}:Counting"!r}, ["infer"])
PolicyServer(make=made, port=0).run(lambda at: print(f"it is served at {{at}};", flush=True))
print("ended")
"""


@pytest.mark.parametrize(
    ("number", "command"), [(signal.SIGTERM, COMMAND), (signal.SIGINT, ["-c", IN_PYTHON])]
)
def test_it_serves_this_machine_and_ends_on_signals(
    number: signal.Signals, command: list[str]
) -> None:
    with subprocess.Popen(
        [sys.executable, *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert "is served at ws://127.0.0.1:" in line
        at = line.split(" at ")[1].split(";")[0]
        with joined(at) as client:
            assert asked(client)["count"] == 1
            process.send_signal(number)
            assert process.wait(timeout=20.0) == 0
        assert process.stdout.read() == "ended\n"


@pytest.mark.skipif(not JUDGE.exists(), reason="make judges was not run: no openpi-client")
def test_the_client_of_others_is_answered() -> None:
    text = """
import sys, numpy as np
from openpi_client.websocket_client_policy import WebsocketClientPolicy
client = WebsocketClientPolicy(sys.argv[1])
assert client.get_server_metadata()["name"] == "counting"
answer = client.infer({"q": np.arange(7.0), "image": np.zeros((2, 2, 3), np.uint8)})
assert (answer["actions"] == np.arange(7.0) + 1.0).all()
try:
    client.infer({"raise": 1})
except RuntimeError as error:
    assert "as asked" in str(error)
    print("refused")
"""
    with served() as (at, _):
        done = subprocess.run(
            [JUDGE, "-c", text, at], capture_output=True, text=True, timeout=60.0, check=False
        )
    assert (done.returncode, done.stdout) == (0, "refused\n"), done.stderr
