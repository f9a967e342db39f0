"""Classical manipulation for MuJoCo: QP inverse kinematics, Ruckig motion, impedance control.

The names below are the front door; each is imported from its module when it is first used.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mink import SE3

    from robo47_qp.evaluation.evaluation import evaluate_policy
    from robo47_qp.evaluation.perturbation import Perturbation
    from robo47_qp.ik.dls import DlsIk
    from robo47_qp.ik.many import fk_many, solve_many
    from robo47_qp.ik.mink import MinkIk
    from robo47_qp.ik.multistart import MultiStart
    from robo47_qp.ik.qp import QpIk
    from robo47_qp.ik.solver import IkResult
    from robo47_qp.ik.stream.stream import StreamIk
    from robo47_qp.model.arm import Arm
    from robo47_qp.model.loading import robot_from_mjcf
    from robo47_qp.model.obstacle import Obstacle
    from robo47_qp.model.robot import Robot
    from robo47_qp.model.robots import load_robot
    from robo47_qp.motion.planner import Planner
    from robo47_qp.motion.waypoint import Motion, Waypoint, tool_down
    from robo47_qp.report.audit.audit import audit
    from robo47_qp.report.metrics import metrics
    from robo47_qp.report.rerun.log import RerunLog
    from robo47_qp.report.rerun.reading import read_recording
    from robo47_qp.run.policy.policy import JointTarget, Observation
    from robo47_qp.run.registry import load_task
    from robo47_qp.run.runner import Runner
    from robo47_qp.sim.simulation import Simulation
    from robo47_qp.stack import ClassicalStack

__version__ = "0.1.0"
__all__ = [
    "SE3",
    "Arm",
    "ClassicalStack",
    "DlsIk",
    "IkResult",
    "JointTarget",
    "MinkIk",
    "Motion",
    "MultiStart",
    "Observation",
    "Obstacle",
    "Perturbation",
    "Planner",
    "QpIk",
    "RerunLog",
    "Robot",
    "Runner",
    "Simulation",
    "StreamIk",
    "Waypoint",
    "audit",
    "evaluate_policy",
    "fk_many",
    "load_robot",
    "load_task",
    "metrics",
    "read_recording",
    "robot_from_mjcf",
    "solve_many",
    "tool_down",
]
_HOMES = {
    "Arm": "robo47_qp.model.arm",
    "ClassicalStack": "robo47_qp.stack",
    "DlsIk": "robo47_qp.ik.dls",
    "IkResult": "robo47_qp.ik.solver",
    "JointTarget": "robo47_qp.run.policy.policy",
    "MinkIk": "robo47_qp.ik.mink",
    "Motion": "robo47_qp.motion.waypoint",
    "MultiStart": "robo47_qp.ik.multistart",
    "Observation": "robo47_qp.run.policy.policy",
    "Obstacle": "robo47_qp.model.obstacle",
    "Perturbation": "robo47_qp.evaluation.perturbation",
    "Planner": "robo47_qp.motion.planner",
    "QpIk": "robo47_qp.ik.qp",
    "RerunLog": "robo47_qp.report.rerun.log",
    "Robot": "robo47_qp.model.robot",
    "Runner": "robo47_qp.run.runner",
    "SE3": "mink",
    "Simulation": "robo47_qp.sim.simulation",
    "StreamIk": "robo47_qp.ik.stream.stream",
    "Waypoint": "robo47_qp.motion.waypoint",
    "audit": "robo47_qp.report.audit.audit",
    "evaluate_policy": "robo47_qp.evaluation.evaluation",
    "fk_many": "robo47_qp.ik.many",
    "load_robot": "robo47_qp.model.robots",
    "load_task": "robo47_qp.run.registry",
    "metrics": "robo47_qp.report.metrics",
    "read_recording": "robo47_qp.report.rerun.reading",
    "robot_from_mjcf": "robo47_qp.model.loading",
    "solve_many": "robo47_qp.ik.many",
    "tool_down": "robo47_qp.motion.waypoint",
}


def __getattr__(name: str) -> Any:
    """Import a name of the front door from its module."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_HOMES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if "gymnasium" in sys.modules:
    import_module("robo47_qp.evaluation.gym")
