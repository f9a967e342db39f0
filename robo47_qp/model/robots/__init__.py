"""Robot descriptions, one module each: a `Robot`, or a function of the module's name for one."""

import pkgutil

from robo47_qp.errors import UnknownNameError
from robo47_qp.model.robot import Robot


def robot_names() -> tuple[str, ...]:
    """Return the names of the robots of the package."""
    return tuple(module.name for module in pkgutil.iter_modules(__path__))


def load_robot(name: str) -> Robot:
    """Return a robot of the package.

    Args:
        name: One of `robot_names`.

    Raises:
        UnknownNameError: No robot has this name.
        MenagerieError, MissingExtraError: Its model cannot be loaded from MuJoCo Menagerie.
    """
    if name not in robot_names():
        raise UnknownNameError("robot", name, robot_names())
    module = pkgutil.resolve_name(f"{__name__}.{name}")
    make = getattr(module, name, None)
    if make is None:
        return next(one for one in vars(module).values() if isinstance(one, Robot))
    robot: Robot = make()
    return robot
