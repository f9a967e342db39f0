"""Grasps about the vertical: how many tabletop targets a free axis adds to a fixed one."""

import sys
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from mink import SE3, SO3
from rich.console import Console

from robo47_qp.arrays import Checked, Count, CountOrZero
from robo47_qp.cli import OK, main
from robo47_qp.evaluation.benchmarks.ik.targets import tabletop
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import Tolerance
from robo47_qp.ik.tool_demand import FULL, FreeAxis
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots import load_robot
from robo47_qp.motion.waypoint import tool_down

_YAWS = 24
"""Angles about the vertical that are tried one by one where the free axis fails."""
_TIGHT = 1.001e-6
"""Error of a tight answer [m] and [rad]."""


@dataclass(frozen=True, kw_only=True)
class FreeAxisOptions(Checked):
    """Options of the comparison."""

    robot: str = "panda"
    """Robot whose inverse kinematics is solved."""
    n: Count = 1000
    """Targets: positions over a table, the tool straight down, turned by any angle."""
    seed: CountOrZero = 0
    """Seed of the targets."""
    ik: Literal["mink", "lm"] = "mink"
    """Solver, restarted up to 100 times."""

    def _label(self, field: str) -> str:
        return f"--{field}"


def run(options: FreeAxisOptions, console: Console) -> int:
    """Compare both demands, and return the exit code."""
    arm = Arm(load_robot(options.robot))
    kind = MinkIk if options.ik == "mink" else LmIk
    fixed, free = (
        MultiStart(
            solver=kind(max_iterations=30, stall=Stall(), tolerance=Tolerance(demand=demand))
        )
        for demand in (FULL, FreeAxis())
    )
    rng = np.random.default_rng(options.seed)
    reached = {"fixed axis": 0, "free axis": 0}
    tight, missed, worst = 0, 0, 0.0
    for pose in tabletop(arm, options.n, rng).targets:
        yaw = float(rng.uniform(-np.pi, np.pi))
        target = tool_down(pose.translation(), yaw)
        reached["fixed axis"] += fixed.solve(arm, target, arm.home).converged
        found = free.solve(arm, target, arm.home)
        reached["free axis"] += found.converged
        if found.converged:
            error = _error(arm, target, found.q)
            worst, tight = max(worst, error), tight + (error <= _TIGHT)
        else:
            missed += _any_yaw(fixed, arm, target)
    for name, count in reached.items():
        console.print(f"{name}: {count} of {options.n} ({100 * count / options.n:.2f} %)")
    whole = reached["free axis"] + missed
    console.print(
        f"tight: {tight} of {whole} that are known to be reachable "
        f"(worst error {worst:.2g} m or rad; {missed} only by trying {_YAWS} angles)"
    )
    return OK if tight == whole else 1


def _error(arm: Arm, target: SE3, q: np.ndarray) -> float:
    """Return the larger error of position [m] and of the direction of the tool [rad]."""
    pose = arm.pose(q)
    away = np.linalg.norm(pose.translation() - target.translation())
    axis = pose.rotation().as_matrix()[:, 2]
    return float(max(away, np.arcsin(np.linalg.norm(np.cross(axis, [0.0, 0.0, -1.0])))))


def _any_yaw(ik: MultiStart, arm: Arm, target: SE3) -> bool:
    """Return whether the pose is reached with any of many angles about the vertical."""
    if arm.target_beyond_reach(target) > 0.0:
        return False
    turns = np.linspace(0.0, 2.0 * np.pi, _YAWS, endpoint=False)
    few = replace(ik, max_restarts=10)
    poses = (target @ SE3.from_rotation(SO3.from_z_radians(float(turn))) for turn in turns)
    return any(few.solve(arm, pose, arm.home).converged for pose in poses)


if __name__ == "__main__":
    sys.exit(main(FreeAxisOptions, run, __doc__ or ""))
