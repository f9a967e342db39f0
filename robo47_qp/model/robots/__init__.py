"""Robot descriptions, one module each: a `Robot`, or a function of the module's name for one."""

import pkgutil

from robo47_qp.errors import UnknownNameError
from robo47_qp.model.description import ENDINGS, described_robot
from robo47_qp.model.robot import Robot


def robot_names() -> tuple[str, ...]:
    """Return the names of the robots of the package."""
    return tuple(module.name for module in pkgutil.iter_modules(__path__))


def load_robot(name: str) -> Robot:
    """Return a robot of the package, or that of a file.

    Args:
        name: One of `robot_names`, or a path to an MJCF file with a TOML file beside it; see
            `described_robot`.

    Raises:
        UnknownNameError: No robot has this name.
        ModelError, InvalidValueError: See `described_robot`.
        MenagerieError, MissingExtraError: Its model cannot be loaded from MuJoCo Menagerie.
    """
    if name.endswith(ENDINGS):
        return described_robot(name)
    if name not in robot_names():
        raise UnknownNameError("robot", name, (*robot_names(), "path/to/arm.xml"))
    module = pkgutil.resolve_name(f"{__name__}.{name}")
    make = getattr(module, name, None)
    if make is None:
        return next(one for one in vars(module).values() if isinstance(one, Robot))
    robot: Robot = make()
    return robot
