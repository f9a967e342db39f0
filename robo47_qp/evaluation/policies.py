"""Policies from elsewhere: where they are found, and how they drive an episode."""

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeAlias

from robo47_qp.errors import InvalidValueError, Robo47Error, UnknownNameError
from robo47_qp.run.foreign_code import Guard, absolute, load_class
from robo47_qp.run.observers import Observer
from robo47_qp.run.recording import Sink
from robo47_qp.run.runner import Driver, Runner
from robo47_qp.run.scenario import Run, Scenario
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import IK_SOLVERS

CLASSICAL = "classical"
"""Name of the classical stack among the policies."""
MakeDriver: TypeAlias = Callable[[Any], Driver]
"""Makes the driver of a run from a policy; goes to worker processes by pickle."""


class PolicyFailed(Robo47Error):  # noqa: N818  # what it tells is a failure, as StepFailed does
    """A policy raised an exception of its own."""


@dataclass(frozen=True, kw_only=True)
class PolicyReference:
    """Where a policy is to be found."""

    text: str
    """module:Class or path/to/file.py:Class."""

    def load(self) -> Callable[[], Any]:
        """Return the class.

        Raises:
            ClassLoadError: There is no such module, file or class, or it is no policy.
        """
        known = (CLASSICAL, f"{CLASSICAL}:IK with a name that --ik takes")
        return load_class("policy", self.text, ("reset", "act"), known)

    def make(self) -> Any:
        """A new policy.

        Raises:
            ClassLoadError: See `load`.
            PolicyFailed: The class raised something.
        """
        maker = self.load()
        with Guard() as guard:
            return maker()
        error = guard.error
        words = f"the policy raised {type(error).__name__} as it was made: {error}"
        raise PolicyFailed(words) from error

    @property
    def absolute(self) -> "PolicyReference":
        """The same for a process in another folder."""
        return PolicyReference(text=absolute(self.text))

    @property
    def digest(self) -> str | None:
        """SHA-256 of the source file; None where there is none."""
        path = sys.modules[self.load().__module__].__file__
        return None if path is None else sha256(Path(path).read_bytes()).hexdigest()


@dataclass(frozen=True, kw_only=True, eq=False)
class PolicyDrive:
    """Drives an episode by a policy, made anew for it; see `Drive`."""

    reference: PolicyReference
    driver: MakeDriver

    def __call__(
        self,
        scenario: Scenario,
        simulation: Simulation,
        *,
        sinks: Sequence[Sink],
        observers: Sequence[Observer],
    ) -> Run:
        """See `Drive`."""
        runner = Runner(scenario, simulation, self.driver(self.reference.make()))
        return runner.run(sinks=sinks, observers=observers)


IK_NAMES: tuple[str, ...] = tuple(IK_SOLVERS)
NAMES = (CLASSICAL, *(f"{CLASSICAL}:{ik}" for ik in IK_NAMES))
"""Names of the classical stack; plain, it takes the IK of --ik."""
_LONGEST = 60
"""Characters of a label; the end of a long name tells more than its beginning."""


@dataclass(frozen=True, kw_only=True)
class Contender:
    """A policy by its name: the classical stack with an IK, or one from elsewhere."""

    name: str
    """As it was asked for."""
    ik: str | None
    """Inverse kinematics of the classical stack; None for a policy from elsewhere."""

    @classmethod
    def of(cls, name: str, ik: str) -> "Contender":
        """The policy of a name; `ik` is for a classical stack that names none.

        Raises:
            UnknownNameError: It is a classical stack with an IK that nobody knows.
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
        """Where it is found; None for the classical stack."""
        return None if self.ik is not None else PolicyReference(text=self.name).absolute

    @property
    def identity(self) -> str:
        """What two names of the same policy share."""
        return f"{CLASSICAL}:{self.ik}" if self.reference is None else self.reference.text


def check_different(contenders: Sequence[Contender]) -> None:
    """Check that no policy is there twice, under whatever names.

    Raises:
        InvalidValueError: One is.
    """
    seen: dict[str, str] = {}
    for contender in contenders:
        name = contender.name
        if contender.identity in seen:
            found = f"{seen[contender.identity]} and {name}, which are one and the same"
            raise InvalidValueError("--policy", found, "another one each time")
        seen[contender.identity] = name


def labels(contenders: Sequence[Contender]) -> list[str]:
    """A part of a file name for each: different ones, also where case does not count."""
    plain = [re.sub(r"[^A-Za-z0-9_]+", "-", c.name)[-_LONGEST:].strip("-") for c in contenders]
    lower = [label.lower() for label in plain]
    return [
        label if lower.count(label.lower()) == 1 else f"{label}-{_digest(contender.name)}"
        for label, contender in zip(plain, contenders, strict=True)
    ]


def _digest(name: str) -> str:
    return sha256(name.encode()).hexdigest()[:8]
