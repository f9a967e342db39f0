"""The names under which evaluations are kept, told by what was evaluated."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from robo47_qp.evaluation.perturbation import PRESETS, Perturbation
from robo47_qp.evaluation.policies import policy_settings
from robo47_qp.files import plain
from robo47_qp.run.registry import load_task, task_names
from robo47_qp.stack import ClassicalStack


def _success_name(result: Mapping[str, Any]) -> str:
    """Return the name of an evaluation with the defaults in one of the levels."""
    level = _level(result) if _on_its_robot(result) else None
    return "none of those" if level is None else f"success_{level}_{result['task']}"


def _robots_name(result: Mapping[str, Any]) -> str:
    """Return the name of an evaluation of a robot without perturbations."""
    robot = _settings(result).get("robot")
    return f"robots_{robot}_{result['task']}" if _level(result) == "none" else "none of those"


@dataclass(frozen=True)
class Alone:
    """A world that is wrong in one way."""

    words: str
    """What is wrong, for a table."""
    wrong: Perturbation


ALONE = {
    "heavy_rubbing": Alone(
        "links 5 % heavier, joints rub with 0.5 and 0.3 N·m",
        Perturbation(link_mass=0.05, joint_friction=0.5),
    ),
    "noise": Alone("joint positions with noise of 1e-4 rad", Perturbation(noise_q=1e-4)),
    "delay": Alone(
        "5 ms of delay: 3 of the state, 2 of the torque",
        Perturbation(state_delay=3e-3, torque_delay=2e-3),
    ),
}
"""Worlds that are wrong in one way, by the names of their results."""


def _alone_name(result: Mapping[str, Any]) -> str:
    """Return the name of an evaluation with the defaults in a world that is wrong in one way."""
    kinds = (name for name, one in ALONE.items() if _is_wrong_by(result, one.wrong))
    kind = next(kinds, None) if _by_default(result) and _on_its_robot(result) else None
    return "none of those" if kind is None else f"alone_{kind}_{result['task']}"


def _by_default(result: Mapping[str, Any]) -> bool:
    """Return whether the default stack was evaluated."""
    return bool(_settings(result).get("policy") == policy_settings(ClassicalStack(), None))


def _on_its_robot(result: Mapping[str, Any]) -> bool:
    """Return whether a task was done by the robot that it is made for."""
    task = result.get("task")
    return task in task_names() and _settings(result).get("robot") == load_task(task).default_robot


def _settings(result: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the settings of an evaluation; none of a report of something else."""
    found = result.get("settings")
    return found if isinstance(found, Mapping) else {}


def _level(result: Mapping[str, Any]) -> str | None:
    """Return the level of an evaluation of the default stack; None for any other."""
    if not _by_default(result):
        return None
    return next((name for name, level in PRESETS.items() if _is_wrong_by(result, level)), None)


def _is_wrong_by(result: Mapping[str, Any], wrong: Perturbation) -> bool:
    """Return whether a perturbation was evaluated: without pushes, their times say nothing."""
    found, told = _settings(result).get("perturbation"), plain(wrong)
    if isinstance(found, Mapping) and not found.get("pushes"):
        found = {**found, "push_time": told["push_time"]}
    return bool(found == told)


OWN_NAMES: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "success": _success_name,
    "robots": _robots_name,
    "alone": _alone_name,
}
"""What the kept evaluations of the tables of these names are called, by their beginning."""
