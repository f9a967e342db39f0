"""Inverse kinematics that tests compose: solvers, objectives, and what is left of a demand."""

from collections.abc import Callable
from typing import Any

import mink
import numpy as np
from mink import SE3
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Vector
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.tool_demand import POSITION, FreeAxis, ToolDemand
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA

ARM = Arm(PANDA)


def several(**composition: Any) -> MultiStart:
    return MultiStart(solver=MinkIk(max_iterations=30, stall=Stall(), **composition))


def somewhere(rng: np.random.Generator, inner: float = 0.1) -> Vector:
    span = ARM.q_max - ARM.q_min
    q: Vector = rng.uniform(ARM.q_min + inner * span, ARM.q_max - inner * span)
    return q


def left(demand: ToolDemand, q: Vector, target: SE3) -> tuple[float, float]:
    """What is left of a demand, by scipy's rotations: metres and radians."""
    now = ARM.pose(q)
    away = float(np.linalg.norm(target.translation() - now.translation()))
    R, R_target = (Rotation.from_matrix(pose.rotation().as_matrix()) for pose in (now, target))
    if isinstance(demand, FreeAxis):
        a, b = R.apply(demand.axis), R_target.apply(demand.axis)
        angle = float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
        return (away if demand.position else 0.0), angle
    return away, 0.0 if demand == POSITION else float((R.inv() * R_target).magnitude())


def elbow_at(q_wanted: Vector, **options: Any) -> mink.PostureTask:
    task = mink.PostureTask(ARM.model, cost=1.0)
    task.set_target(q_wanted)
    return task


def tasks() -> dict[str, Callable[[Arm], Any]]:
    """mink's own, each with a target that the arm can be at together with a pose."""

    def relative(arm: Arm) -> mink.RelativeFrameTask:
        task = mink.RelativeFrameTask("hand", "body", "link4", "body", 1.0, 0.0)
        task.set_target_from_configuration(mink.Configuration(arm.model, q=arm.home))
        return task

    def com(arm: Arm) -> mink.ComTask:
        task = mink.ComTask(cost=1.0)
        task.set_target_from_configuration(mink.Configuration(arm.model, q=arm.home))
        return task

    def looking(arm: Arm) -> mink.LookAtTask:
        task = mink.LookAtTask("link4", "body", axis=(1.0, 0.0, 0.0))
        task.set_target(np.array([1.0, 0.0, 0.5]))
        return task

    def upright(arm: Arm) -> mink.AxisAlignTask:
        task = mink.AxisAlignTask("link4", "body", axis=(0.0, 0.0, 1.0))
        task.set_target(np.array([0.0, 1.0, 0.0]))
        return task

    def posture(arm: Arm) -> mink.PostureTask:
        task = mink.PostureTask(arm.model, cost=1.0)
        task.set_target(arm.home)
        return task

    def energy(_: Arm) -> mink.KineticEnergyRegularizationTask:
        task = mink.KineticEnergyRegularizationTask(1.0)
        task.set_dt(1.0)
        return task

    return {
        "relative": relative,
        "com": com,
        "look at": looking,
        "axis": upright,
        "posture": posture,
        "damping": lambda arm: mink.DampingTask(arm.model, 1.0),
        "energy": energy,
    }
