"""Policies of an evaluation: the classical stack by name, and classes from elsewhere."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

from robo47_qp.arrays import Checked, Positive
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.evaluation.policy_files import digest_of, files_in, package_folder
from robo47_qp.files import plain
from robo47_qp.run.foreign_code import absolute
from robo47_qp.run.policy.drivers import PolicyDriver, PolicyTiming
from robo47_qp.run.policy.process import PATIENCE, PolicyProcess
from robo47_qp.stack import IK_SOLVERS, ClassicalStack, solves_qp

CLASSICAL = "classical"
"""Name of the classical stack among the policies."""


@dataclass(frozen=True, kw_only=True)
class PolicyReference(Checked):
    """A policy from outside the package, by its module or file and class."""

    text: str
    """module:Class or path/to/file.py:Class."""
    timing: PolicyTiming = PolicyTiming()
    """Rate of its decisions and length of an episode."""
    stack: ClassicalStack = ClassicalStack()
    """Controller, and planner with the limits of all motions."""
    patience: Positive = PATIENCE
    """Longest wall time of an answer, and of loading it [s]."""

    def process(self) -> PolicyProcess:
        """Return the policy, to be run in a process of its own."""
        known = (CLASSICAL, f"{CLASSICAL}:IK with a name that --ik takes")
        return PolicyProcess(self.absolute.text, known, self.patience)

    def load(self) -> list[str]:
        """Load the class in a process of its own; see `PolicyProcess.files` for what is returned.

        Raises:
            ClassLoadError: There is no such class, or its module cannot be imported.
        """
        process = self.process()
        try:
            process.start()
        finally:
            process.close()
        return process.files

    def driver(self) -> PolicyDriver:
        """Return a driver with the policy, whose process begins anew with every episode."""
        return PolicyDriver(self.process(), self.timing)

    @property
    def absolute(self) -> "PolicyReference":
        """The same policy, for a process in another folder."""
        return replace(self, text=absolute(self.text))

    @cached_property
    def loaded(self) -> list[str]:
        """What `load` returns, of the first time."""
        return self.load()

    @property
    def digest(self) -> str | None:
        """SHA-256 of the policy's files as they are now; None for a module without any.

        Those are the modules that it loads from beside it, and all in the folder of its file or
        of its package; see `files_in`.

        Raises:
            ClassLoadError: See `load`.
            InvalidValueError: See `files_in`.
        """
        files = {Path(file) for file in self.loaded}
        place, _, _ = self.absolute.text.rpartition(":")
        folder = Path(place).parent if place.endswith(".py") else None
        if folder is None and files:
            folder = package_folder(min(files))
        if folder is not None:
            files.update(files_in(folder))
        return digest_of(files, folder) if files else None


IK_NAMES: tuple[str, ...] = tuple(IK_SOLVERS)
NAMES = (CLASSICAL, *(f"{CLASSICAL}:{ik}" for ik in IK_NAMES))
"""Names of the classical stack; without a suffix, it takes the IK of --ik."""
_LONGEST = 60
"""Characters of a label; a longer name keeps its end."""


@dataclass(frozen=True, kw_only=True)
class Contender:
    """A policy by name: the classical stack with an IK, or a class from elsewhere."""

    name: str
    """As given on the command line."""
    ik: str | None
    """Inverse kinematics of the classical stack; None for a policy from elsewhere."""

    @classmethod
    def of(cls, name: str, ik: str) -> "Contender":
        """Return the policy of a name; `ik` is that of a classical stack without a suffix.

        Raises:
            UnknownNameError: It is a classical stack with an unknown IK.
        """
        if name == CLASSICAL:
            return cls(name=name, ik=ik)
        stack, _, named = name.partition(":")
        if stack != CLASSICAL:
            return cls(name=name, ik=None)
        if named not in IK_NAMES:
            raise UnknownNameError("policy", name, (*NAMES, "module:Class", "file.py:Class"))
        return cls(name=name, ik=named)

    @property
    def reference(self) -> PolicyReference | None:
        """Place of the policy; None for the classical stack."""
        return None if self.ik is not None else PolicyReference(text=self.name).absolute

    @property
    def solves_qp(self) -> bool:
        """Whether a QP solver can be chosen for it."""
        return self.ik is not None and solves_qp(self.ik)

    @property
    def identity(self) -> str:
        """Text that is the same for two names of one policy."""
        return f"{CLASSICAL}:{self.ik}" if self.reference is None else self.reference.text


def check_different(contenders: Sequence[Contender]) -> None:
    """Check that no policy occurs twice, even under different names.

    Raises:
        InvalidValueError: One does.
    """
    seen: dict[str, str] = {}
    for contender in contenders:
        name = contender.name
        if contender.identity in seen:
            found = f"{seen[contender.identity]} and {name}, which are one and the same"
            raise InvalidValueError("--policy", found, "another one each time")
        seen[contender.identity] = name


def labels(contenders: Sequence[Contender]) -> list[str]:
    """Return a part of a file name for each policy, all different even if case is ignored."""
    bare = [re.sub(r"[^A-Za-z0-9_]+", "-", c.name)[-_LONGEST:].strip("-") for c in contenders]
    lower = [label.lower() for label in bare]
    digests = [sha256(contender.name.encode()).hexdigest()[:8] for contender in contenders]
    return [
        label if lower.count(label.lower()) == 1 else f"{label}-{digest}"
        for label, digest in zip(bare, digests, strict=True)
    ]


def policy_settings(policy: ClassicalStack | PolicyReference, name: str | None) -> dict[str, Any]:
    """Return the settings of a policy that results depend on, as JSON."""
    if isinstance(policy, ClassicalStack):
        settings: dict[str, Any] = {"name": name or CLASSICAL, "ik": policy.ik}
        settings |= {"speed": policy.pace, "qp_solver": policy.qp_solver}
        return {**settings, **_control(policy)}
    timing, stack = policy.timing, policy.stack
    settings = {"name": name or policy.text, "sha256": policy.digest, "process": "of its own"}
    settings |= {"rate": timing.rate}
    if timing.seconds is not None:
        settings["seconds"] = timing.seconds
    return {**settings, "speed": stack.pace, **_control(stack)}


def _control(stack: ClassicalStack) -> dict[str, Any]:
    # As in reports that were kept before settings of an observer were told.
    usual = stack.observer in (None, ClassicalStack.observer)
    observer = stack.observer is not None if usual else plain(stack.observer)
    return {"controller": stack.controller, "observer": observer, "profile": stack.profile}
