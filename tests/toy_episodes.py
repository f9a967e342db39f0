"""Episodes for tests of workers: quick to load, and some go wrong in every way."""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from robo47_qp._core.library import backend
from robo47_qp.evaluation.episode import EpisodeResult, EpisodeSpec, failed
from robo47_qp.run.failure import Cause, Failure

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
    """What seeds do instead: raise, hang, exit, print, litter, backend."""
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
            case "litter":
                return EpisodeResult(
                    index=spec.index, seed=spec.seed, success=True, metrics={"grown": _littered()}
                )
            case "backend":
                told = {"backend": backend()}
                return EpisodeResult(index=spec.index, seed=spec.seed, success=True, metrics=told)
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


def _littered() -> float:
    """How much memory stays when large blocks are gone and small ones after them are not [B]."""
    # By its own rule, glibc takes blocks up to the largest that was freed for small ones.
    np.ones(20 << 20, dtype=np.uint8)
    kept, before = [], _resident()
    for i in range(20):
        large = np.ones((14 << 20) + (i << 16), dtype=np.uint8)
        kept.append(np.ones(1 << 16, dtype=np.uint8))
        del large
    return float(_resident() - before)


def _resident() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


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
