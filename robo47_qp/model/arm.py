"""Arm: the controller's model of the robot, with exactly n joints."""

from collections.abc import Callable, Hashable, Sequence
from itertools import pairwise
from math import sqrt
from typing import Any, NamedTuple, TypeVar, TypeVarTuple

import mujoco
import numpy as np
from mink import SE3
from numpy.typing import ArrayLike, NDArray

from robo47_qp.arrays import Matrix, Range, Vector, checked_vector
from robo47_qp.model.mjcf import compile_arm
from robo47_qp.model.obstacle import Obstacle
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Robot

_Args = TypeVarTuple("_Args")
_T = TypeVar("_T")
JOINT_MARGIN = 1e-3
"""Part of a joint's range that planned positions keep from either limit, for tracking errors;
3 to 6 mrad for the Panda [-]."""
_POSITIONS_DONE = int(mujoco.mjtStage.mjSTAGE_POS)


class JointState(NamedTuple):
    """The joints' motion at one instant; for sliding joints read m for rad."""

    q: Vector
    """Position (n,) [rad]."""
    v: Vector
    """Velocity (n,) [rad/s]."""


class JointReference(NamedTuple):
    """The joints' desired motion at the instant of the state that it is compared with."""

    q: Vector
    """Position (n,) [rad]."""
    v: Vector
    """Velocity (n,) [rad/s]."""
    a: Vector
    """Acceleration (n,) [rad/s²]."""


class Arm:
    """Kinematics and dynamics of the robot alone: fingers welded, no contacts, no limit forces.

    Obstacles are geoms of its model that exert no forces; a payload has no geometry.

    Arguments are not checked on the hot path: float64 arrays of shape (n,). Returned arrays are
    new. An arm is not safe to share between threads: its methods use one scratch state.
    """

    def __init__(
        self,
        robot: Robot,
        payload: Payload | None = None,
        obstacles: Sequence[Obstacle] = (),
        margin: float = 0.0,
    ) -> None:
        """Compile the model.

        Args:
            robot: The description.
            payload: The body that the tool is believed to hold.
            obstacles: Obstacles for solvers that avoid collisions.
            margin: Part of each joint's range by which either limit is moved inwards [-].

        Raises:
            UnknownNameError: See `robot_spec`.
            InvalidValueError: The name of an obstacle is taken; the margin is outside [0, 0.5).
            ModelError: See `compile_arm`.
        """
        self.robot, self.payload, self.obstacles = robot, payload, tuple(obstacles)
        self._derived: dict[Hashable, Any] = {}
        self.model = compile_arm(robot, payload, self.obstacles)
        Range(at_least=0.0, below=0.5).check("margin", margin)
        if margin:
            limits = self.model.jnt_range
            limits += margin * np.diff(limits, axis=1) * [1.0, -1.0]
        self._data = mujoco.MjData(self.model)
        self.n = len(robot.joints)
        self.q_min: Vector = self.model.jnt_range[:, 0].copy()
        self.q_max: Vector = self.model.jnt_range[:, 1].copy()
        self.hinges: NDArray[np.bool_] = self.model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
        self.home = checked_vector("home", robot.home, self.n)
        self.dry_friction: Vector = self.model.dof_frictionloss.copy()
        self.has_dry_friction = bool(self.dry_friction.any())
        self._tcp = self.model.site(robot.tcp).id
        # The arrays of MjData keep their place: each view is taken once.
        d = self._data
        self._q, self._v, self._a, self._tau = d.qpos, d.qvel, d.qacc, d.qfrc_inverse
        self._position = d.site_xpos[self._tcp]
        self._flat_rotation = d.site_xmat[self._tcp]
        self._rotation = self._flat_rotation.reshape(3, 3)
        self._quaternion = d.site_xquat[self._tcp]
        self._jacobian, self._turn = np.zeros((6, self.n)), np.zeros(3)
        self._base, self._reach = self._shoulder_and_reach()

    def with_payload(self, payload: Payload | None) -> "Arm":
        """Return the same arm among the same obstacles with another payload."""
        return Arm(self.robot, payload, self.obstacles)

    def derived(self, build: Callable[["Arm", *_Args], _T], *args: *_Args) -> _T:
        """Return `build(arm, *args)`, built at the first call and kept as long as the arm.

        For what takes long to derive from an arm, and for scratch memory. All callers share it:
        like the arm itself, it is not safe to share between threads.

        Args:
            build: A function or class whose result depends on its arguments only.
            args: Its further arguments, hashable.
        """
        key = (build, args)
        if key not in self._derived:
            self._derived[key] = build(self, *args)
        made: _T = self._derived[key]
        return made

    def pose(self, q: Vector) -> SE3:
        """Return T_world_tcp at q."""
        self._at(q)
        pose = np.empty(7)
        mujoco.mju_mat2Quat(pose[:4], self._flat_rotation)
        pose[4:] = self._position
        return SE3(pose)

    def pose_error(self, T_world_target: SE3, q: Vector) -> Vector:
        """Return displacement [m] and rotation vector [rad] to a pose (6,), in the tool frame."""
        return np.concatenate(self._pose_error(T_world_target, q))

    def pose_distance(self, T_world_target: SE3, q: Vector) -> tuple[float, float]:
        """Return distance [m] and angle [rad] between the tool at q and a pose."""
        p, w = self._pose_error(T_world_target, q)
        return sqrt(p.dot(p)), sqrt(w.dot(w))

    def _pose_error(self, T_world_target: SE3, q: Vector) -> tuple[Vector, Vector]:
        """Return the two parts of `pose_error`; the next call overwrites the second."""
        self._at(q)
        target = T_world_target.wxyz_xyz
        p = (target[4:] - self._position).dot(self._rotation)
        # mink's logarithm is zero at half a turn; this one is not.
        mujoco.mju_subQuat(self._turn, target[:4], self._quaternion)
        return p, self._turn

    def jacobian(self, q: Vector) -> Matrix:
        """Return J (6, n): twist of the tool in the tool frame, linear part first."""
        d = self._at(q)
        mujoco.mj_comPos(self.model, d)
        J = self._jacobian
        mujoco.mj_jacSite(self.model, d, J[:3], J[3:], self._tcp)
        R_tcp_world = self._rotation.T
        out = np.empty((6, self.n))
        np.matmul(R_tcp_world, J[:3], out=out[:3])
        np.matmul(R_tcp_world, J[3:], out=out[3:])
        return out

    def mass_matrix(self, q: Vector) -> Matrix:
        """Return M(q) (n, n), with the rotor inertias [kg·m²]."""
        d = self._at(q)
        mujoco.mj_comPos(self.model, d)
        mujoco.mj_makeM(self.model, d)
        M = np.empty((self.n, self.n))
        mujoco.mj_fullM(self.model, d, M)
        return M

    def inverse_dynamics(self, q: Vector, v: Vector, a: Vector) -> Vector:
        """Return the torques (n,) that give acceleration a at (q, v) [N·m].

        tau = M(q) a + c(q, v) + g(q) - tau_passive(q, v), with c the Coriolis and centrifugal
        terms, g gravity and tau_passive joint damping and springs, by MuJoCo's recursive
        Newton-Euler algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 5).
        """
        self._q[:] = q
        self._v[:] = v
        self._a[:] = a
        mujoco.mj_inverse(self.model, self._data)
        return self._tau.copy()

    def place(self, q: Vector) -> None:
        """Move to q: the first half of `inverse_dynamics`, with the mass matrix in `scratch`."""
        m, d = self.model, self._at(q)
        mujoco.mj_comPos(m, d)
        mujoco.mj_makeM(m, d)
        mujoco.mj_factorM(m, d)

    def inverse_dynamics_here(self, v: Vector, a: Vector) -> Vector:
        """Return the torques (n,) at the configuration of `place` [N·m]; see `inverse_dynamics`."""
        self._v[:] = v
        self._a[:] = a
        mujoco.mj_inverseSkip(self.model, self._data, _POSITIONS_DONE, 1)
        return self._tau.copy()

    @property
    def tool_site(self) -> int:
        """Id of the tool frame in `model`."""
        return int(self._tcp)

    @property
    def scratch(self) -> mujoco.MjData:
        """MuJoCo's state of the last call, such as `place`; any call overwrites it."""
        return self._data

    def limit_margin(self, q: Vector) -> float:
        """Return the smallest distance of a joint to its limits; negative outside [rad or m]."""
        return float(min(np.minimum(q - self.q_min, self.q_max - q).tolist()))

    def beyond_reach(self, position: Vector) -> float:
        """Return a lower bound on the distance of a point from the tool's workspace [m].

        It is 0 for points closer to the first joint than the length of the stretched arm.
        """
        from_base = position - self._base
        return max(0.0, sqrt(from_base.dot(from_base)) - self._reach)

    def checked_q(self, name: str, q: ArrayLike) -> Vector:
        """Return a copy of q, checked to be a finite vector (n,)."""
        return checked_vector(name, q, self.n)

    def _shoulder_and_reach(self) -> tuple[Vector, float]:
        m, d = self.model, self._at(self.home)
        points, reach = [*d.xanchor, d.site_xpos[self._tcp]], 0.0
        slides = m.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
        for i, (a, b) in enumerate(pairwise(points)):
            # A link behind a slide is longest at one of its ends.
            travel = [q[i] - self.home[i] if slides[i] else 0.0 for q in (self.q_min, self.q_max)]
            reach += max(float(np.linalg.norm(b - a + t * d.xaxis[i])) for t in travel)
        return points[0].copy(), reach

    def _at(self, q: Vector) -> mujoco.MjData:
        self._q[:] = q
        mujoco.mj_kinematics(self.model, self._data)
        return self._data
