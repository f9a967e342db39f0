"""Classical manipulation for MuJoCo: QP inverse kinematics, Ruckig motion, impedance control.

The names below are the front door; each is imported from its module when it is first used.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mink import SE3

    from robo47_qp.evaluation.perturbation import Perturbation
    from robo47_qp.ik.dls import DlsIk
    from robo47_qp.ik.lm import LmIk
    from robo47_qp.ik.multistart import MultiStart
    from robo47_qp.ik.qp import QpIk
    from robo47_qp.ik.solver import IkResult, Tolerance
    from robo47_qp.ik.stream.stream import StreamIk
    from robo47_qp.model.arm import Arm
    from robo47_qp.model.loading import robot_from_menagerie, robot_from_mjcf
    from robo47_qp.model.obstacle import Obstacle
    from robo47_qp.model.robot import Robot
    from robo47_qp.model.robots import load_robot
    from robo47_qp.motion.planner import Planner
    from robo47_qp.motion.waypoint import Motion, Waypoint, tool_down
    from robo47_qp.run.policy.policy import JointTarget, Observation, ToolTarget, Torques
    from robo47_qp.run.registry import load_task
    from robo47_qp.run.runner import Runner
    from robo47_qp.sim.simulation import Simulation
    from robo47_qp.stack import ClassicalStack

__version__ = "0.1.0"
_HOMES = {
    "mink": ("SE3",),
    "robo47_qp.evaluation.perturbation": ("Perturbation",),
    "robo47_qp.ik.dls": ("DlsIk",),
    "robo47_qp.ik.lm": ("LmIk",),
    "robo47_qp.ik.multistart": ("MultiStart",),
    "robo47_qp.ik.qp": ("QpIk",),
    "robo47_qp.ik.solver": ("IkResult", "Tolerance"),
    "robo47_qp.ik.stream.stream": ("StreamIk",),
    "robo47_qp.model.arm": ("Arm",),
    "robo47_qp.model.loading": ("robot_from_menagerie", "robot_from_mjcf"),
    "robo47_qp.model.obstacle": ("Obstacle",),
    "robo47_qp.model.robot": ("Robot",),
    "robo47_qp.model.robots": ("load_robot",),
    "robo47_qp.motion.planner": ("Planner",),
    "robo47_qp.motion.waypoint": ("Motion", "Waypoint", "tool_down"),
    "robo47_qp.run.policy.policy": ("JointTarget", "Observation", "ToolTarget", "Torques"),
    "robo47_qp.run.registry": ("load_task",),
    "robo47_qp.run.runner": ("Runner",),
    "robo47_qp.sim.simulation": ("Simulation",),
    "robo47_qp.stack": ("ClassicalStack",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}
__all__ = [
    "SE3",
    "Arm",
    "ClassicalStack",
    "DlsIk",
    "IkResult",
    "JointTarget",
    "LmIk",
    "Motion",
    "MultiStart",
    "Observation",
    "Obstacle",
    "Perturbation",
    "Planner",
    "QpIk",
    "Robot",
    "Runner",
    "Simulation",
    "StreamIk",
    "Tolerance",
    "ToolTarget",
    "Torques",
    "Waypoint",
    "load_robot",
    "load_task",
    "robot_from_menagerie",
    "robot_from_mjcf",
    "tool_down",
]


def __getattr__(name: str) -> Any:
    """Import a name of the front door from its module."""
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_HOME_OF[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if "gymnasium" in sys.modules:
    import_module("robo47_qp.evaluation.gym")
