"""Tasks and limits of mink with defects of mink 1.3 mended; for `mink.solve_ik` as they are."""

from robo47_qp.ik.mended.collision_limit import CollisionLimit
from robo47_qp.ik.mended.frame_tasks import FrameTask, RelativeFrameTask
from robo47_qp.ik.mended.joint_limit import JointLimit

__all__ = ["CollisionLimit", "FrameTask", "JointLimit", "RelativeFrameTask"]
