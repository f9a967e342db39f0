"""Where MuJoCo's functions and structures are in memory, for the compiled core to call."""

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

import mujoco

from robo47_qp._core.library import address
from robo47_qp.errors import CoreError


@cache
def function(name: str) -> Any:
    """Return the address of a function of MuJoCo's library, such as "mj_step1".

    Raises:
        CoreError: The library of the installed MuJoCo is not where it should be.
    """
    folder = Path(mujoco.__file__).parent
    found = sorted(folder.glob("libmujoco*.so*")) + sorted(folder.glob("libmujoco*.dylib"))
    if len(found) != 1:
        raise CoreError(
            f"MuJoCo's library is not in {folder}: found {[path.name for path in found]}. Install "
            "mujoco again, or choose ROBO47_BACKEND=numpy."
        )
    # The one that Python's mujoco has loaded: the same path is loaded once.
    pointer = ctypes.cast(getattr(ctypes.CDLL(str(found[0])), name), ctypes.c_void_p)
    return address(pointer.value or 0)


def structure(of: mujoco.MjModel | mujoco.MjData) -> Any:
    """Return the address of a model or of its data."""
    where: int = of._address  # type: ignore[union-attr]
    return address(where)
