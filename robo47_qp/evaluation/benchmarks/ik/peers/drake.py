"""Drake's nonlinear inverse kinematics, solved by SNOPT."""

from dataclasses import dataclass
from importlib import import_module
from time import process_time
from typing import Any

import numpy as np
from mink import SE3
from numpy.typing import ArrayLike

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.evaluation.benchmarks.ik.peers.kinematic_chain import TIP, kinematic_chain
from robo47_qp.evaluation.benchmarks.ik.peers.presence import require
from robo47_qp.ik.solver import IkResult, Tolerance, is_pose, judged, rejected
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target

_FEASIBLE = 1e-9
"""Feasibility tolerance; the constraint on the angle is on its cosine: 1e-9 is 4.5e-5 rad."""


@dataclass(frozen=True, kw_only=True)
class DrakeIk:
    """Drake's `InverseKinematics` with constraints on position and orientation."""

    max_iterations: int = 200
    """Major iterations of SNOPT."""
    tolerance: Tolerance = Tolerance(position=1e-6, orientation=1e-4)
    """Position and orientation tolerance; the angle cannot be tighter than `_FEASIBLE` allows."""

    def __post_init__(self) -> None:
        """Check that Drake is installed.

        Raises:
            MissingExtraError: Drake is not installed.
        """
        require("DrakeIk", "pydrake", "drake")

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        """See `IkSolver.solve`; `seconds` are Drake's, which tells no iterations."""
        q = arm.checked_q("q_seed", q_seed)
        if not is_pose(T_world_target):
            return rejected(arm, q)
        drake = arm.derived(_Drake, self.max_iterations)
        started = process_time()
        found = drake.solve(T_world_target, q)
        seconds = process_time() - started
        result = judged(arm, T_world_target, found, self.tolerance, 0)
        return result.with_effort(iterations=0, restarts=0, seconds=seconds)


class _Drake:
    """Drake's model of the arm, built once."""

    def __init__(self, arm: Arm, max_iterations: int) -> None:
        plant_module: Any = import_module("pydrake.multibody.plant")
        parsing: Any = import_module("pydrake.multibody.parsing")
        solvers: Any = import_module("pydrake.solvers")
        self._ik: Any = import_module("pydrake.multibody.inverse_kinematics")
        self._math: Any = import_module("pydrake.math")
        plant = plant_module.MultibodyPlant(0.0)
        parsing.Parser(plant).AddModelsFromString(kinematic_chain(arm).urdf(), "urdf")
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
        plant.Finalize()
        joints = [plant.get_joint(i) for i in plant.GetJointIndices()]
        moving = [joint for joint in joints if joint.num_positions()]
        order = [joint.position_start() for joint in moving]
        names = [joint.name() for joint in moving]
        self._from_arm = [order[names.index(f"joint{i + 1}")] for i in range(arm.n)]
        self._plant, self._context = plant, plant.CreateDefaultContext()
        self._tip = plant.GetFrameByName(TIP)
        self._snopt, self._options = solvers.SnoptSolver(), solvers.SolverOptions()
        name = self._snopt.solver_id()
        self._options.SetOption(name, "Major feasibility tolerance", _FEASIBLE)
        self._options.SetOption(name, "Major iterations limit", max_iterations)

    def pose(self, q: Vector) -> Matrix:
        """Return T_world_tcp (4, 4) by Drake."""
        self._plant.SetPositions(self._context, self._shuffled(q))
        T = self._tip.CalcPoseInWorld(self._context).GetAsMatrix4()
        return np.asarray(T, dtype=np.float64)

    def solve(self, T_world_target: SE3, q_seed: Vector) -> Vector:
        ik = self._ik.InverseKinematics(self._plant, with_joint_limits=True)
        world, p = self._plant.world_frame(), T_world_target.translation()
        R = self._math.RotationMatrix(T_world_target.rotation().as_matrix())
        ik.AddPositionConstraint(
            frameB=self._tip, p_BQ=np.zeros(3), frameA=world, p_AQ_lower=p, p_AQ_upper=p
        )
        identity = self._math.RotationMatrix()
        ik.AddOrientationConstraint(
            frameAbar=world, R_AbarA=R, frameBbar=self._tip, R_BbarB=identity, theta_bound=0.0
        )
        result = self._snopt.Solve(ik.prog(), self._shuffled(q_seed), self._options)
        found = np.asarray(result.GetSolution(ik.q()), dtype=np.float64)
        return found[self._from_arm]

    def _shuffled(self, q: ArrayLike) -> Vector:
        own = np.empty(len(self._from_arm))
        own[self._from_arm] = q
        return own


def tool_pose(arm: Arm, q: Vector) -> Matrix:
    """Return T_world_tcp (4, 4) by Drake, to check that the models agree."""
    return arm.derived(_Drake, 1).pose(q)
