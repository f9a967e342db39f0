"""The names under which evaluations are kept, told by what was evaluated."""

from collections.abc import Callable, Mapping
from typing import Any

from robo47_qp.evaluation.perturbation import PRESETS
from robo47_qp.evaluation.policies import policy_settings
from robo47_qp.files import plain
from robo47_qp.stack import ClassicalStack


def _success_name(result: Mapping[str, Any]) -> str:
    """Return the name of an evaluation with the defaults in one of the levels."""
    level = _level(result)
    return "none of those" if level is None else f"success_{level}_{result['task']}"


def _robots_name(result: Mapping[str, Any]) -> str:
    """Return the name of an evaluation of a robot without perturbations."""
    robot = result["settings"]["robot"]
    return f"robots_{robot}_{result['task']}" if _level(result) == "none" else "none of those"


def _level(result: Mapping[str, Any]) -> str | None:
    """Return the level of an evaluation of the default stack; None for any other."""
    settings = result["settings"]
    if settings["policy"] != policy_settings(ClassicalStack(), None):
        return None
    found = settings["perturbation"]
    return next((name for name, level in PRESETS.items() if plain(level) == found), None)


OWN_NAMES: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "success": _success_name,
    "robots": _robots_name,
}
"""What the kept evaluations of the tables `success` and `robots` are called, by their beginning."""
