"""Where MuJoCo's functions and structures are in memory, for the compiled core to call."""

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

import mujoco

from robo47_qp._core.library import Structure, address
from robo47_qp.errors import CoreError


@cache
def function(name: str) -> Any:
    """Return the address of a function or variable of MuJoCo's library, such as "mj_step1".

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


def dynamics(model: mujoco.MjModel, data: mujoco.MjData) -> Structure:
    """Return the structure `r47_dynamics` of an arm without contacts; it works in `data`."""
    return Structure(
        "r47_dynamics",
        n=model.nv,
        model=structure(model),
        data=structure(data),
        kinematics=function("mj_kinematics"),
        centres=function("mj_comPos"),
        mass=function("mj_makeM"),
        factor=function("mj_factorM"),
        times=function("mj_mulM"),
        solve=function("mj_solveM"),
        velocities=function("mj_comVel"),
        passive=function("mj_passive"),
        bias=function("mj_rne"),
        qpos=data.qpos,
        qvel=data.qvel,
        qacc=data.qacc,
        qfrc_passive=data.qfrc_passive,
        qfrc_bias=data.qfrc_bias,
        qfrc_inverse=data.qfrc_inverse,
    )


def structure(of: mujoco.MjModel | mujoco.MjData) -> Any:
    """Return the address of a model or of its data."""
    where: int = of._address  # type: ignore[union-attr]
    return address(where)
