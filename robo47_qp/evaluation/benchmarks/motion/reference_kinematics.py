"""Reference kinematics: poses and IK searches by MuJoCo and scipy alone.

It shares nothing with the solvers and planners that it checks: the robot's file is
compiled anew, the Jacobian is MuJoCo's, and the searches are scipy's bounded least squares.
"""

import mujoco
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.evaluation.benchmarks.ik.judge import joint_limits
from robo47_qp.model.mjcf import robot_spec
from robo47_qp.model.robot import Robot

_EXACT = 1e-12
"""Steps and errors at which a search ends."""
_EVALUATIONS = 80


class ReferenceKinematics:
    """Kinematics of a robot from its own file, without the package's `Arm`."""

    def __init__(self, robot: Robot) -> None:
        """Compile its file."""
        self._model = robot_spec(robot).compile()
        self._data = mujoco.MjData(self._model)
        joints = [self._model.joint(name) for name in robot.joints]
        self._q = [int(joint.qposadr[0]) for joint in joints]
        self._dofs = [int(joint.dofadr[0]) for joint in joints]
        self._site = int(self._model.site(robot.tcp).id)
        self.joints = robot.joints
        self.home: Vector = np.array(robot.home, dtype=np.float64)
        self.q_min, self.q_max = joint_limits(self._model, robot.joints)

    def position(self, q: Vector) -> Vector:
        """Of the tool in the world (3,) [m]."""
        self._at(q)
        position: Vector = self._data.site_xpos[self._site].copy()
        return position

    def pose(self, q: Vector) -> Vector:
        """Of the tool in the world: wxyz, xyz (7,)."""
        self._at(q)
        out = np.empty(7)
        mujoco.mju_mat2Quat(out[:4], self._data.site_xmat[self._site])
        out[4:] = self._data.site_xpos[self._site]
        return out

    def away(self, q: Vector, pose: Vector) -> Vector:
        """From a pose (wxyz, xyz) to the tool, in the world: way [m], turn [rad] (6,)."""
        self._at(q)
        R = Rotation.from_matrix(self._data.site_xmat[self._site].reshape(3, 3))
        turn = R * Rotation.from_quat(np.roll(pose[:4], -1)).inv()
        way = self._data.site_xpos[self._site] - pose[4:]
        return np.concatenate([way, turn.as_rotvec()])

    def jacobian(self, q: Vector) -> Matrix:
        """Twist of the tool in the world per joint (6, n), linear part first."""
        self._at(q)
        mujoco.mj_comPos(self._model, self._data)
        J = np.zeros((6, self._model.nv))
        mujoco.mj_jacSite(self._model, self._data, J[:3], J[3:], self._site)
        return J[:, self._dofs]

    def least_gain(self, q: Vector) -> float:
        """Smallest singular value of the Jacobian [m and rad]."""
        return float(np.linalg.svd(self.jacobian(q), compute_uv=False)[-1])

    def inside(self, q: Vector) -> bool:
        """True where no joint is outside its limits by more than rounding."""
        return bool((q >= self.q_min - 1e-9).all() and (q <= self.q_max + 1e-9).all())

    def nearest(self, pose: Vector, q: Vector, room: tuple[Vector, Vector]) -> tuple[Vector, float]:
        """A configuration that comes as close to a pose as a search finds, and how close.

        Args:
            pose: wxyz, xyz (7,).
            q: Where the search starts (n,) [rad].
            room: Least and largest configuration (n,) [rad].
        """
        return self._searched(pose, q, *room)

    def unlimited(self, pose: Vector, q: Vector) -> tuple[Vector, float]:
        """The same as `nearest` without joint limits."""
        free = np.full(len(q), np.inf)
        return self._searched(pose, q, -free, free)

    def reaches(
        self, pose: Vector, starts: int, rng: np.random.Generator, within: float
    ) -> Vector | None:
        """A configuration inside the limits at a pose, searched from many random ones."""
        room = self.q_min, self.q_max
        # A joint that turns without end is anywhere within a turn.
        low, high = (np.where(np.isinf(end), np.sign(end) * np.pi, end) for end in room)
        for _ in range(starts):
            q, off = self.nearest(pose, rng.uniform(low, high), room)
            if off <= within:
                return q
        return None

    def _searched(self, pose: Vector, q: Vector, low: Vector, high: Vector) -> tuple[Vector, float]:
        def slopes(x: Vector) -> Matrix:
            J = self.jacobian(x)
            J[3:] = _unturned(self.away(x, pose)[3:]) @ J[3:]
            return J

        found = least_squares(
            lambda x: self.away(x, pose),
            np.clip(q, low, high),
            jac=slopes,
            bounds=(low, high),
            method="dogbox",
            xtol=_EXACT,
            ftol=_EXACT,
            gtol=_EXACT,
            max_nfev=_EVALUATIONS,
        )
        return found.x, float(np.abs(found.fun).max())

    def _at(self, q: Vector) -> None:
        self._data.qpos[self._q] = q
        mujoco.mj_kinematics(self._model, self._data)


def _unturned(turn: Vector) -> Matrix:
    """Change of a rotation vector per small rotation in the world (3, 3).

    The inverse of the left Jacobian of SO(3) (Chirikjian, Stochastic Models, Information
    Theory, and Lie Groups, vol. 2, 2012, section 10.8).
    """
    angle = float(np.linalg.norm(turn))
    x, y, z = turn
    W = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-6:
        return np.eye(3) - 0.5 * W
    factor = 1.0 / angle**2 - (1.0 + np.cos(angle)) / (2.0 * angle * np.sin(angle))
    out: Matrix = np.eye(3) - 0.5 * W + factor * W @ W
    return out
