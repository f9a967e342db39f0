"""Policies from elsewhere: where they are found, and how they drive an episode."""

import importlib.util
import pkgutil
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from inspect import signature
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias, get_args

from robo47_qp.errors import InvalidValueError, Robo47Error, UnknownNameError
from robo47_qp.run.observers import Observer
from robo47_qp.run.policy.guard import Guard
from robo47_qp.run.recording import Sink
from robo47_qp.run.runner import Driver, Runner
from robo47_qp.run.scenario import Run, Scenario
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import IkName

CLASSICAL = "classical"
"""Name of the classical stack among the policies."""
MakeDriver: TypeAlias = Callable[[Any], Driver]
"""Makes the driver of a run from a policy; goes to worker processes by pickle."""


class PolicyLoadError(Robo47Error):
    """A policy that cannot be had."""

    def __init__(self, reference: str, why: str) -> None:
        """Tell what was asked for and why it cannot be had."""
        super().__init__(
            f"The policy {reference!r} cannot be loaded: {why}. Name it module:Class or "
            f"file.py:Class, a class that needs no arguments and has reset(observation) and "
            f"act(observation), or {CLASSICAL}, or {CLASSICAL}:IK with a name that --ik takes."
        )


class PolicyFailed(Robo47Error):  # noqa: N818  # what it tells is a failure, as StepFailed does
    """A policy raised an exception of its own."""


@dataclass(frozen=True, kw_only=True)
class PolicyReference:
    """Where a policy is to be found."""

    text: str
    """module:Class or path/to/file.py:Class."""

    def load(self) -> Callable[[], Any]:
        """The class.

        Raises:
            PolicyLoadError: There is no such module, file or class, or it is no policy.
        """
        place, _, name = self.text.rpartition(":")
        if not place or not name.isidentifier():
            raise PolicyLoadError(self.text, "it names no place and class")
        with Guard() as guard:
            of_file = place.endswith(".py")
            module = _file_module(Path(place)) if of_file else pkgutil.resolve_name(place)
            found = getattr(module, name, None)
        if guard.error is not None:
            why = f"{type(guard.error).__name__}: {guard.error}"
            raise PolicyLoadError(self.text, why) from guard.error
        if found is None:
            raise PolicyLoadError(self.text, f"{place} has no {name}")
        missing = [method for method in ("reset", "act") if not hasattr(found, method)]
        if missing or not isinstance(found, type):
            why = f"it has no {' and no '.join(missing)}" if missing else "it is no class"
            raise PolicyLoadError(self.text, why)
        with Guard() as guard:
            signature(found).bind()
        if guard.error is not None:
            raise PolicyLoadError(self.text, f"it cannot be made without arguments: {guard.error}")
        return found

    def make(self) -> Any:
        """A new policy.

        Raises:
            PolicyLoadError: See `load`.
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
        place, _, name = self.text.rpartition(":")
        if not place.endswith(".py"):
            return self
        return PolicyReference(text=f"{Path(place).resolve()}:{name}")

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


def _file_module(path: Path) -> ModuleType:
    """The module in a file, the same one every time in a process."""
    path = path.resolve(strict=True)
    name = f"policy_{sha256(str(path).encode()).hexdigest()[:16]}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        if spec is None or spec.loader is None:
            raise ImportError(f"{path} is no Python file")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


IK_NAMES: tuple[IkName, ...] = get_args(IkName)
NAMES = (CLASSICAL, *(f"{CLASSICAL}:{ik}" for ik in IK_NAMES))
"""Names of the classical stack; plain, it takes the IK of --ik."""
_LONGEST = 60
"""Characters of a label; the end of a long name tells more than its beginning."""


@dataclass(frozen=True, kw_only=True)
class Contender:
    """A policy by its name: the classical stack with an IK, or one from elsewhere."""

    name: str
    """As it was asked for."""
    ik: IkName | None
    """Inverse kinematics of the classical stack; None for a policy from elsewhere."""

    @classmethod
    def of(cls, name: str, ik: IkName) -> "Contender":
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
