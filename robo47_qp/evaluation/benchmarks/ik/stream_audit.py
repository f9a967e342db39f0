"""Audit of streamed commands: limits by finite differences, clearances by MuJoCo's contacts."""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from scipy.optimize import lsq_linear

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import Obstacle, add_obstacle
from robo47_qp.model.robot import MotionProfile, Robot


def audit(
    arm: Arm, profile: MotionProfile, dt: float, q0: Vector, q: Matrix, v: Matrix, a: Matrix
) -> dict[str, Any]:
    """Count the ticks that exceed a limit, by the reported values and by finite differences."""
    v_max, a_max = profile.v_max, profile.a_max
    path = np.vstack([q0, q])
    speeds = np.diff(path, axis=0) / dt
    rates = np.diff(np.vstack([np.zeros(arm.n), v]), axis=0) / dt
    bends = np.diff(np.vstack([q0, path]), n=2, axis=0) / dt**2
    beyond_v = np.maximum(np.abs(v), np.abs(speeds)) > v_max
    beyond_a = np.maximum.reduce([np.abs(a), np.abs(rates), np.abs(bends)]) > a_max
    return {
        "q_violations": int(((q < arm.q_min) | (q > arm.q_max)).any(axis=1).sum()),
        "v_violations": int(beyond_v.any(axis=1).sum()),
        "a_violations": int(beyond_a.any(axis=1).sum()),
        "largest_v_part": float(np.abs(v / v_max).max()),
        "largest_a_part": float(np.abs(a / a_max).max()),
    }


def clearance_audit(
    robot: Robot, obstacles: Sequence[Obstacle], q: Matrix, least: float
) -> dict[str, Any]:
    """Compare the distance at every tick with the clearance, by the contacts of a separate model.

    MuJoCo reports no contacts between neighbouring links. For two separate boxes its contact
    distance is measured along one axis and can be less than their distance.
    """
    spec = _robots(robot)
    for obstacle in obstacles:
        add_obstacle(spec, obstacle)
    for geom in spec.geoms:
        geom.margin = 0.5 * least  # those of two geoms are added
    m = spec.compile()
    d = mujoco.MjData(m)
    addresses = [int(m.joint(name).qposadr[0]) for name in robot.joints]
    smallest = np.full(len(q), least)
    for k, now in enumerate(q):
        d.qpos[addresses] = now
        mujoco.mj_kinematics(m, d)
        mujoco.mj_collision(m, d)
        for contact in np.flatnonzero(d.contact.dist < least):
            a, b = d.contact.geom[contact]
            distance = float(d.contact.dist[contact])
            if m.geom_type[a] == m.geom_type[b] == mujoco.mjtGeom.mjGEOM_BOX and distance > 0.0:
                distance = between_boxes(m, d, a, b)
            smallest[k] = min(smallest[k], distance)
    return {
        "clearance_violations": int((smallest < least).sum()),
        "clearance_lacking_mm": 1e3 * float(least - smallest.min()),
    }


def _robots(robot: Robot) -> mujoco.MjSpec:
    """Return the robot's file, or a copy of it at every mount."""
    if not robot.mounts:
        return mujoco.MjSpec.from_file(str(robot.mjcf))
    spec = mujoco.MjSpec()
    for mount in robot.mounts:
        T = mount.T_world_base
        frame = spec.worldbody.add_frame(pos=T.translation(), quat=T.rotation().wxyz)
        part = mujoco.MjSpec.from_file(str(robot.mjcf))
        for key in list(part.keys):
            part.delete(key)
        spec.attach(part, prefix=mount.prefix, frame=frame)
    return spec


def between_boxes(m: mujoco.MjModel, d: mujoco.MjData, a: int, b: int) -> float:
    """Return the distance of two separate boxes by least squares over their points [m]."""
    axes = np.hstack([d.geom_xmat[a].reshape(3, 3), -d.geom_xmat[b].reshape(3, 3)])
    size = np.concatenate([m.geom_size[a], m.geom_size[b]])
    nearest = lsq_linear(axes, d.geom_xpos[b] - d.geom_xpos[a], (-size, size), tol=1e-14)
    return float(np.linalg.norm(nearest.fun))
