"""Types of DAQP 0.11, written by hand.

minimize 0.5 x'Hx + f'x subject to blower <= [x; Ax] <= bupper.
"""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Flags = npt.NDArray[np.int32]

EQ_REDUCTION_AUTO: Final[int]
EQ_REDUCTION_OFF: Final[int]
EQ_REDUCTION_ON: Final[int]

class Model:
    settings: dict[str, Any]
    def __init__(self) -> None: ...
    def setup(
        self,
        H: Matrix | None,
        f: Vector,
        A: Matrix,
        bupper: Vector,
        blower: Vector | None = None,
        sense: Flags | None = None,
        break_points: Flags | None = None,
        primal_start: Vector | None = None,
        dual_start: Vector | None = None,
        is_avi: bool = False,
    ) -> tuple[int, float]: ...  # exit flag (< 0: failed), setup time [s]
    def solve(self) -> tuple[Vector, float, int, dict[str, Any]]: ...
    def update(
        self,
        H: Matrix | None = None,
        f: Vector | None = None,
        A: Matrix | None = None,
        bupper: Vector | None = None,
        blower: Vector | None = None,
        sense: Flags | None = None,
        break_points: Flags | None = None,
    ) -> int: ...
    def soft_weights(
        self,
        rho_l: Vector | None = None,
        rho_u: Vector | None = None,
        w_l: Vector | None = None,
        w_u: Vector | None = None,
    ) -> None: ...

def solve(
    H: Matrix | None,
    f: Vector,
    A: Matrix,
    bupper: Vector,
    blower: Vector | None = None,
    sense: Flags | None = None,
    **settings: Any,
) -> tuple[Vector, float, int, dict[str, Any]]: ...
