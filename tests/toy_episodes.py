"""Episodes and drives for tests: quick ones, and ones that go wrong in every way."""

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Any

import numpy as np

from robo47_qp.errors import InvalidValueError, PlanError
from robo47_qp.evaluation.episode import EpisodeResult, EpisodeSpec, failed
from robo47_qp.evaluation.policy import PolicyFailed
from robo47_qp.failure import Cause, Failure
from robo47_qp.runner import Runner

SETTINGS: dict[str, Any] = {
    "task": {"name": "toy"},
    "policy": {"name": "toy"},
    "robot": "none",
    "perturbation": {"range": (0.0, 1.0)},
}


@dataclass(frozen=True)
class Toy:
    """Draws a success from the seed, unless something else is asked for."""

    does: Mapping[int, str] = field(default_factory=dict)
    """What seeds do instead: raise, hang, exit, kill, print, unpicklable."""
    foreign: bool = True
    pause: float = 0.0

    def __call__(self, spec: EpisodeSpec) -> EpisodeResult:
        time.sleep(self.pause)
        match self.does.get(spec.seed):
            case "raise":
                raise ZeroDivisionError("a bug of ours")
            case "hang":
                while True:
                    pass
            case "exit":
                os._exit(7)
            case "print":
                print("not JSON")
        drawn = np.random.default_rng(spec.seed).uniform(size=3)
        more: dict[str, Any] = {
            "metrics": {"cycle_time_s": float(drawn[1]), "threads": threads()},
            "sha256": sha256(drawn.tobytes()).hexdigest(),
            "timing": {"wall_s": time.perf_counter()},
        }
        if drawn[0] < 0.7:
            return EpisodeResult(index=spec.index, seed=spec.seed, success=True, **more)
        cause = Cause.GRASP if drawn[0] < 0.9 else Cause.DROP
        return failed(spec, Failure(cause=cause, evidence="drawn", time=1.0), **more)


def threads() -> int:
    return int(os.environ["OMP_NUM_THREADS"])


class Unloadable:
    """Cannot be unpickled in another process."""

    foreign = False

    def __reduce__(self) -> tuple[Any, ...]:
        return _refuse, ()

    def __call__(self, spec: EpisodeSpec) -> EpisodeResult:
        raise NotImplementedError


def _refuse() -> None:
    raise ImportError("nothing like it here")


@dataclass(frozen=True)
class Drive:
    """Does not get to the end of an episode."""

    way: str

    def __call__(self, scenario: Any, simulation: Any, *, sinks: Any, observers: Any) -> Any:
        simulation.step(simulation.motor_torque())
        match self.way:
            case "nan":
                simulation.step(np.full(7, np.nan))
            case "policy":
                raise PolicyFailed("the policy raised KeyError in act: 'camera'")
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


class UnmakeablePolicy(GoodPolicy):
    def __init__(self) -> None:
        raise OSError("no weights")


class NoPolicy:
    def reset(self, observation: Any) -> None:
        pass


class GoodCell(Runner):
    """Lets the classical stack do the work while the policy looks on."""

    def __init__(self, scenario: Any, simulation: Any, policy: Any) -> None:
        super().__init__(scenario, simulation)
        policy.reset(simulation.state())
        policy.act(simulation.state())
