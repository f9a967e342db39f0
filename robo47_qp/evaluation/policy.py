"""Policy: code that is not ours and decides what the robot does."""

import importlib.util
import pkgutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

from robo47_qp.errors import Robo47Error
from robo47_qp.evaluation.guard import Guard

CLASSICAL = "classical"
"""Name of the classical stack among the policies."""


class Policy(Protocol):
    """What decides: observations in, actions out. What both are is the cell's to say."""

    def reset(self, observation: Any) -> None:
        """An episode begins."""
        ...

    def act(self, observation: Any) -> Any:
        """What to do now."""
        ...


class PolicyLoadError(Robo47Error):
    """A policy that cannot be had."""

    def __init__(self, reference: str, why: str) -> None:
        """Tell what was asked for and why it cannot be had."""
        super().__init__(
            f"The policy {reference!r} cannot be loaded: {why}. Name it module:Class or "
            f"file.py:Class, a class that needs no arguments and has reset(observation) and "
            f"act(observation), or {CLASSICAL}."
        )


class PolicyFailed(Robo47Error):  # noqa: N818  # what it tells is a failure, as StepFailed does
    """A policy raised an exception of its own."""


@dataclass(frozen=True, kw_only=True)
class PolicyReference:
    """Where a policy is to be found: "module:Class" or "path/to/file.py:Class"."""

    text: str

    def load(self) -> Callable[[], Policy]:
        """The class.

        Raises:
            PolicyLoadError: There is no such module, file or class.
        """
        place, _, name = self.text.rpartition(":")
        if not place or not name.isidentifier():
            raise PolicyLoadError(self.text, "it has no form that could be one")
        with Guard() as guard:
            module = _file_module(Path(place)) if place.endswith(".py") else _module(place)
            found = getattr(module, name)
        if guard.error is not None:
            raise PolicyLoadError(
                self.text, f"{type(guard.error).__name__}: {guard.error}"
            ) from guard.error
        missing = [method for method in ("reset", "act") if not hasattr(found, method)]
        if missing or not callable(found):
            raise PolicyLoadError(self.text, f"it has no {' and no '.join(missing or ['call'])}")
        return found  # type: ignore[no-any-return]

    def make(self) -> "GuardedPolicy":
        """A new policy of this class, whose exceptions are its own.

        Raises:
            PolicyLoadError: See `load`.
            PolicyFailed: The class cannot be called without arguments.
        """
        maker = self.load()
        with Guard() as guard:
            return GuardedPolicy(maker())
        raise PolicyFailed(_said("making it", guard)) from guard.error

    @property
    def absolute(self) -> "PolicyReference":
        """The same for a process in another folder."""
        place, _, name = self.text.rpartition(":")
        if not place.endswith(".py"):
            return self
        return PolicyReference(text=f"{Path(place).resolve()}:{name}")

    @property
    def digest(self) -> str | None:
        """SHA-256 of the file; None for a module."""
        place = self.text.rpartition(":")[0]
        if not place.endswith(".py") or not Path(place).is_file():
            return None
        return sha256(Path(place).read_bytes()).hexdigest()


class GuardedPolicy:
    """A policy with a border around it: what it raises becomes `PolicyFailed`."""

    def __init__(self, policy: Policy) -> None:
        """Put the border around a policy."""
        self._policy = policy

    def reset(self, observation: Any) -> None:
        """See `Policy.reset`.

        Raises:
            PolicyFailed: The policy raised an exception.
        """
        with Guard() as guard:
            self._policy.reset(observation)
        if guard.error is not None:
            raise PolicyFailed(_said("reset", guard)) from guard.error

    def act(self, observation: Any) -> Any:
        """See `Policy.act`.

        Raises:
            PolicyFailed: The policy raised an exception.
        """
        with Guard() as guard:
            return self._policy.act(observation)
        raise PolicyFailed(_said("act", guard)) from guard.error


def _said(where: str, guard: Guard) -> str:
    error = guard.error
    return f"the policy raised {type(error).__name__} in {where}: {error}"


def _module(name: str) -> Any:
    return pkgutil.resolve_name(name)


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
