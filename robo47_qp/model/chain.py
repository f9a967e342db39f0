"""The kinematics of an arm as the compiled core takes them: a tree of hinges and slides."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp._core.library import Structure, functions, pointer
from robo47_qp.arrays import Matrix, Vector, contiguous
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm

MAX_JOINTS = 64
"""Most joints of an arm that the compiled core takes, `R47_MAX_N`."""


class Chain:
    """Frames of all joints of an arm, and of what is fixed to them, at its reference position.

    A frame is 12 numbers: its rotation matrix row by row, then its origin [m]. The z axis of a
    joint's frame is the joint's axis.
    """

    def __init__(self, arm: Arm) -> None:
        """Take the kinematics from the arm's model; build it by `arm.derived(Chain)`.

        Raises:
            InvalidValueError: The arm has more than 64 joints.
        """
        m, d = arm.model, mujoco.MjData(arm.model)
        if arm.n > MAX_JOINTS:
            expected = f"at most {MAX_JOINTS} for the compiled core, else ROBO47_BACKEND=numpy"
            raise InvalidValueError("number of joints", arm.n, expected)
        d.qpos[:] = m.qpos0
        mujoco.mj_kinematics(m, d)
        self.n = arm.n
        self._body_joint = _last_joints(m)
        parent = [_joint_before(m, self._body_joint, i) for i in range(arm.n)]
        self._at_zero = [_frame(_with_z(d.xaxis[i]), d.xanchor[i]) for i in range(arm.n)]
        offset = [
            self._relative(before, frame)
            for before, frame in zip(parent, self._at_zero, strict=True)
        ]
        sites = [
            (int(self._body_joint[m.site_bodyid[site]]), d.site_xmat[site], d.site_xpos[site])
            for site in arm.tool_sites
        ]
        geoms = [
            (int(self._body_joint[m.geom_bodyid[geom]]), d.geom_xmat[geom], d.geom_xpos[geom])
            for geom in range(m.ngeom)
        ]
        fixed = [*sites, *geoms]
        self.first_geom = len(sites)
        """Place of geom 0 of the model among the fixed frames; tools are the first."""
        self.joint: NDArray[np.int32] = np.array([joint for joint, _, _ in fixed], dtype=np.int32)
        """The joint that moves each fixed frame; -1 where none does."""
        self.structure = Structure(
            "r47_chain",
            n=arm.n,
            parent=np.array(parent, dtype=np.int32),
            slides=(~arm.hinges).astype(np.int32),
            q0=m.qpos0.astype(np.float64),
            offset=np.array(offset),
            frames=len(fixed),
            joint=self.joint,
            fixed=np.array([self._relative(j, _frame(R, p)) for j, R, p in fixed]),
        )
        """The C structure `r47_chain`."""
        self.links: Matrix = np.zeros((arm.n, 12))
        """Frames of the joints in the world after the last `move` (n, 12)."""
        self._links = pointer(self.links)

    def move(self, q: Vector) -> None:
        """Move to q (n,) [rad]; everything else is about the last configuration.

        Raises:
            InvalidValueError: The configuration is of another size.
        """
        own = pointer(contiguous("q", q, self.n))
        functions().r47_links(self.structure.pointer, own, self._links)

    def frame(self, place: int = 0) -> Vector:
        """Return a fixed frame in the world (12,), by default that of the main tool."""
        T = np.empty(12)
        functions().r47_frame(self.structure.pointer, self._links, place, pointer(T))
        return T

    def jacobian(self, joint: int, point: Vector) -> Matrix:
        """Return J (6, n) of a point [m] moved by a joint: linear part first, axes of the world."""
        J = np.empty((6, self.n))
        arguments = joint, pointer(point), pointer(J)
        functions().r47_jacobian(self.structure.pointer, self._links, *arguments)
        return J

    def _relative(self, joint: int, frame: Vector) -> Vector:
        """Return a frame of the world in that of a joint, both at the reference position."""
        if joint < 0:
            return frame
        before, R = self._at_zero[joint], self._at_zero[joint][:9].reshape(3, 3)
        return _frame(R.T @ frame[:9].reshape(3, 3), R.T @ (frame[9:] - before[9:]))


def _last_joints(m: mujoco.MjModel) -> NDArray[np.int32]:
    """Return for each body the last joint that moves it; -1 where none does."""
    last: NDArray[np.int32] = np.full(m.nbody, -1, dtype=np.int32)
    for body in range(1, m.nbody):
        count = m.body_jntnum[body]
        own = m.body_jntadr[body] + count - 1
        last[body] = own if count else last[m.body_parentid[body]]
    return last


def _joint_before(m: mujoco.MjModel, last: NDArray[np.int32], joint: int) -> int:
    body = m.jnt_bodyid[joint]
    return joint - 1 if joint > m.body_jntadr[body] else int(last[m.body_parentid[body]])


def _with_z(axis: Vector) -> Matrix:
    """Return a rotation matrix whose last column is a unit vector."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(axis))], axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def _frame(R: Matrix, p: Vector) -> Vector:
    return np.concatenate([np.ravel(R), p])
