"""The process of a policy: it answers observations with actions, and a warden ends what it leaves.

The process that is started is the warden. It forks before anything large is imported: the copy
runs the policy in a session of its own, while the warden waits until the policy has ended or the
run has, then ends all their descendants, and removes their temporary files.
"""

import contextlib
import ctypes
import json
import os
import random
import re
import select
import signal
import socket
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robo47_qp.run.policy.tree import remove_tree

if TYPE_CHECKING:
    from robo47_qp.run.policy.trespass import Trespass

_SUBREAPER, _DEATH_SIGNAL = 36, 1
"""PR_SET_CHILD_SUBREAPER and PR_SET_PDEATHSIG of Linux."""
_LONGEST = 2000
"""Characters that are told of an error."""
_ADDRESS = re.compile(r"0x[0-9a-fA-F]{6,}")


def main() -> None:
    """Run the warden, and the policy in a process that it forks."""
    settings = json.loads(sys.argv[1])
    adopt_orphans()
    warden = os.getpid()
    policy = os.fork()
    if policy == 0:
        # Who kills the warden dies with it.
        _prctl(_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != warden:
            os._exit(1)
        os.close(settings["life"])
        os.setsid()
        with contextlib.suppress(OSError):  # where memory runs out, this process goes first
            Path("/proc/self/oom_score_adj").write_text("1000")
        _answer(settings)
    os.close(settings["line"])
    code = _wait(policy, settings["life"])
    end_children()
    remove_tree(Path(settings["temporary"]))
    os._exit(code)


def _wait(policy: int, life: int) -> int:
    """Wait until the policy has ended, or the run has; return the exit code."""
    pause = 0.001
    while True:
        done, status = os.waitpid(policy, os.WNOHANG)
        if done:
            code = os.waitstatus_to_exitcode(status)
            return code if code >= 0 else 128 - code
        if select.select([life], [], [], pause)[0]:
            return 0
        pause = min(2.0 * pause, 0.02)


def adopt_orphans() -> None:
    """Have descendants of this process become its children when their parents die; on Linux."""
    _prctl(_SUBREAPER, 1)


def _prctl(option: int, value: int) -> None:
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def end_children(of: int | None = None) -> bool:
    """Kill all descendants of a process that lives; return whether there were any.

    As they die, their children become children of that process; see `adopt_orphans`.

    Args:
        of: The process; None for this one.
    """
    end, found = time.monotonic() + 5.0, False
    while (children := _children(os.getpid() if of is None else of)) and time.monotonic() < end:
        found = True
        for child in children:
            with contextlib.suppress(OSError):
                os.kill(child, signal.SIGKILL)
        time.sleep(0.001)
    with contextlib.suppress(ChildProcessError):
        while of is None and os.waitpid(-1, os.WNOHANG)[0]:
            pass
    return found


def _children(of: int) -> list[int]:
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            # The name, in parentheses, may hold anything.
            told = path.read_text(errors="replace").rpartition(")")[2].split()
            # A process whose first thread alone has ended is told as a zombie, too.
            dead = told[0] == "Z" and int(told[17]) <= 1
            if told[1] == str(of) and not dead:
                found.append(int(path.parent.name))
    return found


def _answer(settings: dict[str, Any]) -> None:
    """Load the policy and answer until the run is over."""
    from robo47_qp.run.foreign_code import ClassLoadError, Guard, files_beside, load_class
    from robo47_qp.run.policy.trespass import Trespass
    from robo47_qp.run.policy.wire import receive, send

    line = socket.socket(fileno=settings["line"])
    place, _, _ = settings["reference"].rpartition(":")
    if place.endswith(".py"):
        sys.path.insert(0, str(Path(place).parent))
    trespass = Trespass()
    random.seed(settings["seed"])
    _seed_numpy(settings["seed"])
    with Guard() as guard:
        made = load_class("policy", settings["reference"], ("reset", "act"), settings["known"])
    if guard.error is not None:
        kind = "load" if isinstance(guard.error, ClassLoadError) else "raise"
        send(line, {"failed": kind, "why": told(guard.error)})
        os._exit(1)
    file = getattr(sys.modules[made.__module__], "__file__", None)
    send(line, {"ready": [] if file is None else files_beside(file)})
    if file is not None:
        trespass.mind(file)
    if "torch" in sys.modules:
        sys.modules["torch"].manual_seed(settings["seed"])
    answers = _Answers(made, trespass)
    while True:
        try:
            asked = receive(line, None)
        except (EOFError, OSError):
            os._exit(0)
        with contextlib.suppress(OSError):
            send(line, answers.to(asked))


class _Answers:
    """The policy, made at the first question."""

    def __init__(self, made: Any, trespass: "Trespass") -> None:
        from robo47_qp.sim.cell_sheet import CellSheet

        self._made, self._trespass = made, trespass
        self._policy: Any = None
        self._sheet = CellSheet()

    def to(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Return the reply to a question."""
        from robo47_qp.run.foreign_code import Guard
        from robo47_qp.run.policy.wire import packed_action, unpacked_observation
        from robo47_qp.sim.cell_sheet import CellSheet

        reply: dict[str, Any] = {"number": asked["number"], "action": None}
        method = "its constructor" if self._policy is None else asked["method"]
        with Guard() as guard:
            if self._policy is None:
                self._policy = self._made()
            method, policy = asked["method"], self._policy
            if method != "end":
                if "sheet" in asked["seen"]:
                    self._sheet = CellSheet(**asked["seen"]["sheet"])
                seen = unpacked_observation(asked["seen"], self._sheet)
                found = policy.reset(seen) if method == "reset" else policy.act(seen)
                reply["action"] = packed_action(found) if method == "act" else None
        if guard.error is not None:
            kind = type(guard.error).__name__
            reply["raised"] = shortened(f"it raised {kind} in {method}: {told(guard.error)}")
        if method in ("reset", "end"):
            self._trespass.look()
        reply["beyond"] = self._trespass.told()
        return reply


def _seed_numpy(seed: int) -> None:
    import numpy as np

    np.random.seed(seed % 2**32)  # noqa: NPY002  # the generator that policies share


def told(error: BaseException) -> str:
    """Return the text of an error of a policy, of a bearable length."""
    from robo47_qp.run.foreign_code import Guard

    text = "an error without a readable text"
    with Guard():
        text = shortened(str(error))
    return text


def shortened(text: str) -> str:
    """Return a text of a policy as one line of a bearable length.

    It has no addresses, which differ from run to run, and no characters that cannot be written or
    printed: with line breaks, a text could pass for a part of a report.
    """
    text = text[: _LONGEST + 1].encode("utf-8", "backslashreplace").decode("utf-8")
    text = text[:_LONGEST] + (" ..." if len(text) > _LONGEST else "")
    return _ADDRESS.sub("0x...", one_line(text))


def one_line(text: str) -> str:
    """Return a text with a space in place of every character that is not printable."""
    return "".join(one if one.isprintable() else " " for one in text)
