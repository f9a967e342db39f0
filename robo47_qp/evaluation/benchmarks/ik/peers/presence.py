"""Whether the package of a peer is there."""

from importlib.util import find_spec

from robo47_qp.errors import MissingExtraError


def require(solver: str, module: str, package: str) -> None:
    """Refuse a solver whose package is not installed.

    Args:
        solver: What is asked for.
        module: What it imports.
        package: What brings the module.

    Raises:
        MissingExtraError: The module is not there.
    """
    if find_spec(module) is None:
        raise MissingExtraError(solver, package, "peers")
