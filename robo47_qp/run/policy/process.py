"""PolicyProcess: a policy in a process of its own, to which only observations and actions cross."""

import contextlib
import json
import os
import socket
import subprocess
import sys
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from tempfile import mkdtemp
from time import monotonic
from typing import Any

from robo47_qp.errors import Robo47Error
from robo47_qp.run.foreign_code import ClassLoadError
from robo47_qp.run.policy.child import shortened
from robo47_qp.run.policy.policy import Action, Observation
from robo47_qp.run.policy.tree import remove_tree
from robo47_qp.run.policy.wire import (
    Stranger,
    WireError,
    packed_observation,
    receive,
    send,
    unpacked_action,
)

PATIENCE = 300.0
"""Longest wall time of an answer, and of loading the policy, where no other is asked for [s]."""
_LONGEST_WAIT = 1e6
"""Longest time that a system call waits [s]."""
_GRACE = 2.0
"""Time in which a process that closed its line must end [s]."""
_ENDING = 10.0
"""Time in which the warden ends what the policy leaves; later it has been stopped itself [s]."""
_TOLD, _LINE = 20, 200
"""How many things are told of it that it did beyond its own, and characters of each."""
_START = "from robo47_qp.run.policy.child import main; main()"


class PolicyFault(Robo47Error):  # noqa: N818  # a failure, like StepFailed
    """A policy that gave no action: it raised, its process ended, or it sent something else."""

    def __init__(self, words: str) -> None:
        """Tell what happened; the words may be the policy's own."""
        super().__init__(shortened(words))


class PolicyProcess:
    """A policy whose process begins with `start` and ends with `close`; see `Policy`.

    Everything that it imports, changes or leaves behind is of its own process. It shares no memory
    with the run, and inherits no open file but its end of the line and the standard error.
    """

    def __init__(
        self, reference: str, known: Sequence[str] = (), patience: float = PATIENCE
    ) -> None:
        """Name a policy.

        Args:
            reference: As in `load_class`; a file by its absolute path.
            known: Other names that would work, for messages.
            patience: Longest wall time of an answer, and of loading it [s].
        """
        self._reference, self._known, self._patience = reference, list(known), patience
        self._process: subprocess.Popen[bytes] | None = None
        self._ending = contextlib.ExitStack()
        self._number = 0
        self.files: list[str] = []
        """Source files of the policy and of the modules that it has loaded from beside it, once
        started."""
        self.beyond: list[tuple[float, str]] = []
        """What it has done since the start beyond its own, by name, and when that was told [s]; see
        `Trespass`."""

    def start(self, seed: int | None = None) -> None:
        """Start the process and load the policy's class.

        Args:
            seed: Of the episode; the generators of `random`, numpy and torch are seeded by it.

        Raises:
            ClassLoadError: There is no such class, or its module cannot be imported.
        """
        digest = sha256(f"policy of episode {seed}".encode()).digest()
        path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)  # noqa: PTH109
        with contextlib.ExitStack() as ending, contextlib.ExitStack() as handed:
            temporary = mkdtemp(prefix="robo47-policy-")
            ending.callback(remove_tree, Path(temporary))
            ending.callback(self._wait)
            life, self._life = os.pipe()
            handed.callback(os.close, life)
            ending.callback(os.close, self._life)
            self._line, theirs = socket.socketpair()
            handed.callback(theirs.close)
            ending.callback(self._line.close)
            settings = {
                "reference": self._reference,
                "known": self._known,
                "seed": int.from_bytes(digest[:8], "little"),
                "line": theirs.fileno(),
                "life": life,
                "temporary": temporary,
            }
            self._process = subprocess.Popen(
                [sys.executable, "-u", "-c", _START, json.dumps(settings)],
                stdin=subprocess.DEVNULL,
                # What it prints must not mix with what the run prints; -u tells it however it ends.
                stdout=2,
                env={**os.environ, "PYTHONPATH": path, "PYTHONHASHSEED": "0", "TMPDIR": temporary},
                pass_fds=(theirs.fileno(), life),
                start_new_session=True,
            )
            self._ending = ending.pop_all()
        self._number, self.beyond = 0, []
        try:
            said = self._heard("while it was loaded", self._patience)
        except PolicyFault as fault:
            self.close()
            raise ClassLoadError("policy", self._reference, str(fault), self._known) from fault
        if "ready" not in said:
            self.close()
            raise PolicyLoadError(_words(said.get("why")))
        ready = said["ready"]
        ready = ready if isinstance(ready, list) else []
        self.files = [file for file in ready if isinstance(file, str)]

    def reset(self, observation: Observation) -> None:
        """See `Policy.reset`.

        Raises:
            PolicyFault: It raised, its process ended, or it sent something else.
        """
        self._ask("reset", packed_observation(observation, sheet=True), observation.time)

    def act(self, observation: Observation) -> Action | None:
        """See `Policy.act`; the action is not yet checked.

        Raises:
            PolicyFault: See `reset`.
        """
        seen = packed_observation(observation, sheet=False)
        try:
            action: Any = unpacked_action(self._ask("act", seen, observation.time).get("action"))
        except WireError as error:
            raise PolicyFault(str(error)) from error
        if isinstance(action, Stranger):
            expected = "a JointTarget, a ToolTarget, Torques, or None"
            raise PolicyFault(f"the action must be {expected}; found a {action.kind}.")
        return action  # type: ignore[no-any-return]

    def look(self, time: float) -> None:
        """Ask once more at the end of an episode [s] what it has done; see `beyond`."""
        with contextlib.suppress(PolicyFault):
            self._ask("end", {}, time, _GRACE)

    def close(self) -> None:
        """End the process and all that it has started, and remove its temporary files."""
        self._ending.close()

    def _wait(self) -> None:
        if self._process is None:
            return
        try:
            self._process.wait(_ENDING)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process = None

    def _ask(
        self, method: str, seen: dict[str, Any], time: float, patience: float | None = None
    ) -> dict[str, Any]:
        self._number += 1
        patience = self._patience if patience is None else patience
        self._line.settimeout(min(patience, _LONGEST_WAIT))
        try:
            send(self._line, {"number": self._number, "method": method, "seen": seen})
        except OSError as error:
            raise PolicyFault(self._death(f"in {method}")) from error
        said = self._heard(f"in {method}", patience)
        if said.get("number") != self._number:
            raise PolicyFault("its process sent an answer that nobody has asked for")
        beyond = said.get("beyond")
        for what in beyond if isinstance(beyond, list) else []:
            if len(self.beyond) < _TOLD:
                self.beyond.append((time, shortened(_words(what)[:_LINE])))
        if "raised" in said:
            raise PolicyFault(_words(said["raised"]))
        return said

    def _heard(self, when: str, patience: float) -> dict[str, Any]:
        try:
            return receive(self._line, deadline=monotonic() + patience, alive=self._lives)
        except WireError as error:
            raise PolicyFault(f"{error}, {when}") from error
        except (EOFError, OSError) as error:
            raise PolicyFault(self._death(when)) from error

    def _lives(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def _death(self, when: str) -> str:
        if self._process is None:
            return "its process was not started"
        try:
            code = self._process.wait(timeout=_GRACE)
        except subprocess.TimeoutExpired:
            return f"its process gave no answer {when}"
        # The warden's, or what it tells of the policy's.
        signal = code - 128 if code > 128 else -code
        how = f"signal {signal}" if signal > 0 else f"exit code {code}"
        return f"its process ended with {how} {when}"


def _words(said: object) -> str:
    """Return a text that the process has sent; what is deep inside a message is not told."""
    return said if isinstance(said, str) else f"something that is no text: a {type(said).__name__}"


class PolicyLoadError(ClassLoadError):
    """A class that cannot be loaded, in the words of the process that tried."""

    def __init__(self, words: str) -> None:
        """Repeat the words."""
        Robo47Error.__init__(self, shortened(words))
        self.reference = ""
