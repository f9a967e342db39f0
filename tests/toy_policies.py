"""Policies and drivers for tests: good ones, and ones that do not get to the end."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from robo47_qp.errors import InvalidValueError, PlanError

if TYPE_CHECKING:  # every process of a policy imports this
    from robo47_qp.run.failure import Failure
    from robo47_qp.run.runner import Runner


@dataclass(frozen=True)
class Drive:
    """Does not get to the end of an episode."""

    way: str

    def __call__(self) -> "Drive":
        return self

    def drive(self, runner: "Runner") -> "Failure | None":
        simulation = runner.loop.sim
        simulation.step(simulation.motor_torque())
        match self.way:
            case "nan":
                simulation.step(np.full(7, np.nan))
            case "plan":
                raise PlanError("lift", "no way")
            case "value":
                raise InvalidValueError("grip width", 3.0, "below 0.08")
        raise ZeroDivisionError("a bug of ours")


class GoodPolicy:
    """Says what it sees."""

    def reset(self, observation: Any) -> None:
        self.seen: Sequence[Any] = [observation]

    def act(self, observation: Any) -> Any:
        return observation


class LazyPolicy(GoodPolicy):
    """Is done at once."""

    def act(self, observation: Any) -> Any:
        return None


class UnmakeablePolicy(GoodPolicy):
    def __init__(self) -> None:
        raise OSError("no weights")


class NeedyPolicy(GoodPolicy):
    def __init__(self, weights: str) -> None:
        super().__init__()
        self.weights = weights


class NoPolicy:
    def reset(self, observation: Any) -> None:
        pass
