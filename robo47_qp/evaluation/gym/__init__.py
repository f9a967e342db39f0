"""Tasks as environments of Gymnasium, registered as robo47/<task>-v0."""

from importlib.metadata import entry_points

from robo47_qp.constants import TASKS
from robo47_qp.errors import MissingExtraError

try:
    import gymnasium
except ImportError as error:
    raise MissingExtraError("A Gymnasium environment", "gymnasium", "gym") from error


def register() -> list[str]:
    """Make the tasks of all installed packages known to `gymnasium.make`, and return their names.

    Gymnasium 1.0 and later load no environments by entry points. `import robo47_qp` after
    `import gymnasium` calls this, and so does a name that begins with this module:
    `gymnasium.make("robo47_qp.evaluation.gym:robo47/pick_place-v0")`.
    """
    names = {f"robo47/{entry.name}-v0": entry.name for entry in entry_points(group=TASKS)}
    for name, task in names.items():
        if name not in gymnasium.registry:
            place = f"{__name__}.env:TaskEnv"
            gymnasium.register(name, entry_point=place, kwargs={"task": task})
    return sorted(names)


register()
