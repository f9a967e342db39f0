"""What crosses between a policy's process and the run: JSON with its length before it.

Nothing is unpickled on either side. Floats cross exactly: JSON has the shortest text that reads
back as the same number.
"""

import json
import socket
import struct
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from math import inf
from time import monotonic
from typing import Any, NamedTuple

import numpy as np

from robo47_qp.run.policy.policy import Action, JointTarget, Observation, ToolTarget, Torques
from robo47_qp.sim.cell_sheet import CellSheet

LONGEST = 1 << 20
"""Longest message of a policy's process that is read [B]."""
_LOOK = 0.5
"""How often is looked whether the other side lives, while nothing comes [s]."""
_HEAD = struct.Struct("<I")
_KINDS: dict[str, Callable[..., Action]] = {"q": JointTarget, "pose": ToolTarget, "tau": Torques}
"""Actions by the name of their field of numbers."""
_ARRAYS = ("q", "v", "tool", "force", "fingers")
_POSES = ("objects", "markers")


class WireError(Exception):
    """A message that cannot be read."""


class Stranger(NamedTuple):
    """What a policy returned that is no action."""

    kind: str
    """Name of its class."""


def send(line: socket.socket, content: Mapping[str, Any]) -> None:
    """Send a message."""
    text = json.dumps(content).encode("ascii")
    line.sendall(_HEAD.pack(len(text)) + text)


def receive(
    line: socket.socket,
    longest: int | None = LONGEST,
    *,
    deadline: float = inf,
    alive: Callable[[], bool] = lambda: True,
) -> dict[str, Any]:
    """Return the next message.

    Args:
        line: To the other side.
        longest: Longest message that is read [B]; None for any.
        deadline: When it must be there, by `time.monotonic`, however it comes [s].
        alive: Whether the other side lives, asked at times: another process may hold its end.

    Raises:
        WireError: It is longer than allowed, or no JSON object.
        TimeoutError: It is not there in time.
        EOFError: The other side has gone.
    """
    (length,) = _HEAD.unpack(_exactly(line, _HEAD.size, deadline, alive))
    if longest is not None and length > longest:
        raise WireError(f"it sent a message of {length} bytes; at most {longest} are read")
    try:
        content = json.loads(_exactly(line, length, deadline, alive))
    except (ValueError, RecursionError) as error:
        raise WireError("it sent a message that is no JSON") from error
    if not isinstance(content, dict):
        raise WireError("it sent a message that is no JSON object")
    return content


def _exactly(line: socket.socket, count: int, deadline: float, alive: Callable[[], bool]) -> bytes:
    parts, left = [], count
    while left:
        wait = deadline - monotonic()
        if wait <= 0.0:
            raise TimeoutError("the message is not there in time")
        line.settimeout(min(wait, _LOOK) if wait < inf else None)
        # Before it is read: who ends may have answered.
        gone = not alive()
        try:
            part = line.recv(min(left, 1 << 16))
        except TimeoutError:
            if not gone:
                continue
            part = b""
        if not part:
            raise EOFError("the other side has gone")
        parts.append(part)
        left -= len(part)
    return b"".join(parts)


def packed_observation(seen: Observation, *, sheet: bool) -> dict[str, Any]:
    """Return an observation as JSON; `sheet` is False where the other side has the sheet."""
    content: dict[str, Any] = {"time": seen.time, "width": seen.width, "frames": dict(seen.frames)}
    for name in _ARRAYS:
        value = getattr(seen, name)
        content[name] = None if value is None else value.tolist()
    for name in _POSES:
        content[name] = {key: pose.tolist() for key, pose in getattr(seen, name).items()}
    if sheet:
        content["sheet"] = asdict(seen.sheet)
    return content


def unpacked_observation(content: Mapping[str, Any], sheet: CellSheet) -> Observation:
    """Return the observation of JSON."""
    values = dict(content)
    for name in _ARRAYS:
        values[name] = None if values[name] is None else np.array(values[name])
    for name in _POSES:
        values[name] = {key: np.array(pose) for key, pose in values[name].items()}
    return Observation(**{**values, "sheet": sheet})


def packed_action(action: object) -> dict[str, Any] | None:
    """Return what a policy returned as JSON; its numbers are not checked.

    Raises:
        Exception: Whatever the conversion of its numbers raises.
    """
    if action is None:
        return None
    if not isinstance(action, JointTarget | ToolTarget | Torques):
        return {"kind": "", "class": type(action).__name__}
    (name,) = (name for name, kind in _KINDS.items() if isinstance(action, kind))  # type: ignore[arg-type]
    return {"kind": name, **{f.name: _numbers(getattr(action, f.name)) for f in fields(action)}}


def unpacked_action(content: object) -> object:
    """Return the action of JSON, not yet checked; a `Stranger` for what is none.

    Raises:
        WireError: It is not what `packed_action` returns.
    """
    if content is None:
        return None
    if not isinstance(content, dict):
        raise WireError("it sent an action that is no JSON object")
    name = content.get("kind")
    kind = _KINDS.get(name) if isinstance(name, str) else None
    if kind is None:
        return Stranger(str(content.get("class"))[:100])
    try:
        return kind(**{key: value for key, value in content.items() if key != "kind"})
    except TypeError as error:
        raise WireError(f"it sent an action with other fields: {error}") from error


def _numbers(value: object) -> Any:
    """Return numbers as lists; what is no number becomes a short text, which is refused later."""
    if value is None:
        return None
    try:
        return np.asarray(value, dtype=np.float64).tolist()
    except (TypeError, ValueError):
        return repr(value)[:100]
