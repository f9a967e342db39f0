"""Check that an optional package is installed."""

from importlib.util import find_spec

from robo47_qp.errors import MissingExtraError


def require(solver: str, module: str, package: str) -> None:
    """Check that the package of a solver is installed.

    Args:
        solver: Name of the solver.
        module: Module that it imports.
        package: Package with the module.

    Raises:
        MissingExtraError: It is not installed.
    """
    if find_spec(module) is None:
        raise MissingExtraError(solver, package, "peers")
