"""PTP: all joints from one configuration to another, as fast as their limits allow."""

from robo47_qp.arrays import Vector
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.timing.rest_to_rest import rest_to_rest
from robo47_qp.motion.timing.time_law import S_CURVE, TimeLaw
from robo47_qp.motion.trajectory import Trajectory


def plan_ptp(
    q_start: Vector, q_goal: Vector, profile: MotionProfile, dt: float, law: TimeLaw = S_CURVE
) -> Trajectory:
    """Straight line in joint space from rest to rest.

    Between two configurations inside the joint limits every sample is inside them. The tool
    does not follow a line.

    Args:
        q_start: (n,) [rad].
        q_goal: (n,) [rad].
        profile: Bounds of the joints.
        dt: Time between samples [s].
        law: How the way is run.

    Raises:
        InvalidValueError: A configuration is not finite.
    """
    bounds = (profile.v_max, profile.a_max, profile.j_max)
    samples = rest_to_rest(q_start, q_goal, *bounds, dt, law.run)
    return Trajectory(dt=dt, q=samples.x, v=samples.v, a=samples.a)
