"""mink's frame tasks with a logarithm that is right at half a turn, and its exact slope."""

import abc
from typing import Any

import mink
import mujoco
import numpy as np
from mink import SE3
from mink.tasks import Objective

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.pose_log import PoseLog

_HALF, _NONE = 1e-9, 1.0 - 1.25e-7
"""|w| of the quaternion between frame and target: below the first it is half a turn, above the
second less than 1e-3 rad. Between them mink's logarithm and slope are right to 1e-9."""


class _ExactLog(mink.Task):
    """Error and Jacobian of a task whose error is the logarithm of a pose.

    mink 1.3 has two defects: `SO3.log` takes half a turn (w exactly 0) for none, and the slope
    of the logarithm, `SE3.jlog`, is the identity below 1e-5 rad, off by half the displacement.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        """Make the task; the arguments are those of mink's class."""
        super().__init__(*args, **options)
        self._log, self._e, self._to_frame = PoseLog(), np.zeros(6), np.zeros(4)

    @abc.abstractmethod
    def _poses(self, configuration: mink.Configuration) -> tuple[SE3, SE3]:
        """Return the poses of the frame and of the target."""

    @abc.abstractmethod
    def _error_and_slope(self, configuration: mink.Configuration) -> tuple[Vector, Matrix]:
        """Return the error (6,), which the next call overwrites, and its Jacobian (6, nv)."""

    def compute_error(self, configuration: mink.Configuration) -> Vector:
        """Return the error as mink's class defines it (6,) [m, rad]."""
        return self._error_and_slope(configuration)[0].copy()

    def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
        """Return the change of the error per joint (6, nv)."""
        return self._error_and_slope(configuration)[1]

    def compute_qp_objective(self, configuration: mink.Configuration) -> Objective:
        """Return the matrix H (nv, nv) and the vector c (nv,) of the QP's objective."""
        J, e, damping = self.compute_qp_residual(configuration)
        return Objective(J.T @ J + damping * np.eye(J.shape[1]), -e @ J)

    def compute_qp_residual(
        self, configuration: mink.Configuration
    ) -> tuple[Matrix, Vector, float]:
        """Return Jacobian and wanted change of the error, times the costs, and the damping."""
        frame, target = self._poses(configuration)
        if _HALF < abs(frame.wxyz_xyz[:4].dot(target.wxyz_xyz[:4])) < _NONE:
            return super().compute_qp_residual(configuration)
        error, J = self._error_and_slope(configuration)
        wanted = self.cost * (-self.gain * error)
        return self.cost[:, None] * J, wanted, self.lm_damping * float(wanted @ wanted)

    def _expanded(self, frame: SE3, target: SE3) -> tuple[Vector, Matrix]:
        """Return log(T_frame_target) and its fall per twist of the frame, in shared memory."""
        a, b, e = frame.wxyz_xyz, target.wxyz_xyz, self._e
        mujoco.mju_negQuat(self._to_frame, a[:4])
        mujoco.mju_rotVecQuat(e[:3], b[4:] - a[4:], self._to_frame)
        mujoco.mju_subQuat(e[3:], b[:4], a[:4])
        return self._log.expand(e)


class FrameTask(_ExactLog, mink.FrameTask):
    """`mink.FrameTask` with the right error at half a turn and the exact Jacobian everywhere.

    The error is log(T_frame_target), in the axes of the frame.
    """

    def _poses(self, configuration: mink.Configuration) -> tuple[SE3, SE3]:
        if self.transform_target_to_world is None:
            raise mink.TargetNotSet(type(self).__name__)
        frame = configuration.get_transform_frame_to_world(self.frame_name, self.frame_type)
        return frame, self.transform_target_to_world

    def _error_and_slope(self, configuration: mink.Configuration) -> tuple[Vector, Matrix]:
        way, slope = self._expanded(*self._poses(configuration))
        return way, -slope @ configuration.get_frame_jacobian(self.frame_name, self.frame_type)


class RelativeFrameTask(_ExactLog, mink.RelativeFrameTask):
    """`mink.RelativeFrameTask` with the right error at half a turn and the exact Jacobian.

    The error is log(T_target_frame), in the axes of the frame; both poses are in a root frame.
    """

    def _poses(self, configuration: mink.Configuration) -> tuple[SE3, SE3]:
        if self.transform_target_to_root is None:
            raise mink.TargetNotSet(type(self).__name__)
        frame = configuration.get_transform(
            self.frame_name, self.frame_type, self.root_name, self.root_type
        )
        return frame, self.transform_target_to_root

    def _error_and_slope(self, configuration: mink.Configuration) -> tuple[Vector, Matrix]:
        T_root_frame, target = self._poses(configuration)
        way, slope = self._expanded(T_root_frame, target)
        J = configuration.get_frame_jacobian(self.frame_name, self.frame_type)
        J_root = configuration.get_frame_jacobian(self.root_name, self.root_type)
        return -way, slope @ (J - T_root_frame.inverse().adjoint() @ J_root)
