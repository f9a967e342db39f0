"""Types of OSQP 1.1, written by hand: the solver only, without code generation and derivatives.

minimize 0.5 x'Px + q'x subject to l <= Ax <= u, with P and A in sparse columns (csc).
"""

import enum
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

__version__: str

class OSQPException(Exception): ...

class SolverStatus(enum.IntEnum):
    OSQP_SOLVED = ...
    OSQP_SOLVED_INACCURATE = ...
    OSQP_MAX_ITER_REACHED = ...

SolverError: type[enum.IntEnum]

class OSQP:
    def __init__(self, *, algebra: str = ...) -> None: ...
    def setup(
        self,
        P: Any,
        q: npt.NDArray[np.float64] | None,
        A: Any,
        l: npt.NDArray[np.float64] | None,
        u: npt.NDArray[np.float64] | None,
        **settings: Any,
    ) -> None: ...
    def update(
        self, **data: npt.NDArray[np.float64]
    ) -> None: ...  # q, l, u, Px, Px_idx, Ax, Ax_idx
    def update_settings(self, **settings: Any) -> None: ...
    def warm_start(
        self,
        x: npt.NDArray[np.float64] | None = None,
        y: npt.NDArray[np.float64] | None = None,
    ) -> None: ...
    def solve(self, raise_error: bool | None = None) -> SimpleNamespace: ...  # x, y, info

def algebra_available(algebra: str) -> bool: ...
def algebras_available() -> list[str]: ...
def default_algebra() -> str: ...
def constant(which: str, algebra: str = "builtin") -> Any: ...
