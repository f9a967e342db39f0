"""Every IK solver of the package, found by looking, with the settings it is tested under."""

import importlib
import inspect
import pkgutil
from collections.abc import Callable

from robo47_qp import ik
from robo47_qp.ik.box_qp import backends
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import IkSolver

Variants = dict[str, IkSolver]

_FEWER = 80
"""Iterations of DLS: what it reaches at all it reaches in so many, and what is out of reach costs
two fifths of the default."""

KNOWN: dict[type, Callable[[], Variants]] = {
    DlsIk: lambda: {
        "dls": DlsIk(max_iterations=_FEWER),
        "dls-free": DlsIk(max_iterations=_FEWER, clip=False),
        "dls-position": DlsIk(max_iterations=_FEWER, position_only=True),
        "dls-position-free": DlsIk(max_iterations=_FEWER, position_only=True, clip=False),
    },
    LmIk: lambda: {
        "lm": LmIk(),
        "lm-free": LmIk(within_limits=False),
        "lm-position": LmIk(position_only=True),
        "lm-stall": LmIk(max_iterations=20, stall=Stall()),
    },
    MinkIk: lambda: {"mink": MinkIk(max_iterations=20)},
    # Every iteration costs OSQP milliseconds where a target cannot be reached.
    QpIk: lambda: {f"qp-{name}": QpIk(backend=name, max_iterations=20) for name in backends()},
}
"""Settings worth a test of their own; any other solver is tested under its defaults."""
NOT_WRAPPED = ("dls-position", "dls-position-free", "lm-free", "lm-stall", "qp-osqp")
"""Settings that are not tested again inside a wrapper: it takes its solver as it comes, and one
of each kind, one that ignores limits and one that ignores the orientation are left."""


def discovered() -> list[type]:
    """Classes with a `solve` method in robo47_qp/ik, protocols and abstract ones aside."""
    found = []
    for module in pkgutil.iter_modules(ik.__path__, f"{ik.__name__}."):
        for member in vars(importlib.import_module(module.name)).values():
            if not inspect.isclass(member) or member.__module__ != module.name:
                continue
            private = member.__name__.startswith("_") or inspect.isabstract(member)
            if private or getattr(member, "_is_protocol", False):
                continue
            if hasattr(member, "solve"):
                found.append(member)
    return found


def members() -> Variants:
    """All solvers by name, and each again inside whatever wraps a solver."""
    plain: Variants = {}
    wrappers: list[type] = []
    for kind in discovered():
        if kind in KNOWN:
            plain |= KNOWN[kind]()
        elif "solver" in inspect.signature(kind).parameters:
            wrappers.append(kind)
        else:
            plain[kind.__name__] = kind()
    wrapped = {
        f"{wrapper.__name__.lower()}-{name}": wrapper(solver=solver)
        for wrapper in wrappers
        for name, solver in plain.items()
        if name not in NOT_WRAPPED
    }
    return plain | wrapped


def looks_at_position_only(solver: IkSolver) -> bool:
    """True where a solver was told that the orientation does not matter."""
    inner = getattr(solver, "solver", solver)
    return bool(getattr(inner, "position_only", False))


def keeps_limits(solver: IkSolver) -> bool:
    """False where a solver was told to ignore the joint limits."""
    inner = getattr(solver, "solver", solver)
    return bool(getattr(inner, "clip", True) and getattr(inner, "within_limits", True))
