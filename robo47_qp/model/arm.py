"""Arm: the controller's model of the robot, with exactly n joints."""

from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache
from itertools import pairwise
from math import sqrt
from typing import Any, NamedTuple, TypeVar, TypeVarTuple

import mujoco
import numpy as np
from mink import SE3
from numpy.typing import ArrayLike, NDArray

from robo47_qp.arrays import Matrix, Range, Vector, checked_vector
from robo47_qp.model.mjcf import compile_arm
from robo47_qp.model.obstacle import Obstacle, checked_obstacles
from robo47_qp.model.payload import Load, loads
from robo47_qp.model.robot import Robot
from robo47_qp.model.tool_poses import Target, ToolPoses

_Args = TypeVarTuple("_Args")
_T = TypeVar("_T")
JOINT_MARGIN = 1e-3
"""Part of a joint's range that planned positions keep from either limit, for tracking errors;
3 to 6 mrad for the Panda [-]."""
_TURN = 2.0 * np.pi
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


class _ToolView:
    """Where one tool is in the scratch state of an arm."""

    def __init__(self, arm: "Arm", data: mujoco.MjData, tcp: str) -> None:
        m = arm.model
        self.site = int(m.site(tcp).id)
        # The arrays of MjData keep their place: each view is taken once.
        self.position = data.site_xpos[self.site]
        self.flat_rotation = data.site_xmat[self.site]
        self.rotation = self.flat_rotation.reshape(3, 3)
        self.quaternion = data.site_xquat[self.site]
        self.joints: NDArray[np.bool_] = np.zeros(arm.n, dtype=bool)
        body = int(m.site_bodyid[self.site])
        while body > 0:
            first = m.body_jntadr[body]
            self.joints[first : first + m.body_jntnum[body]] = True
            body = int(m.body_parentid[body])
        self.base, self.reach = self._shoulder_and_reach(arm)

    def _shoulder_and_reach(self, arm: "Arm") -> tuple[Vector, float]:
        d = arm.place_only(arm.home)
        chain = np.flatnonzero(self.joints).tolist()
        points, reach = [*d.xanchor[chain], d.site_xpos[self.site]], 0.0
        slides = arm.model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
        for i, (a, b) in zip(chain, pairwise(points), strict=True):
            # A link behind a slide is longest at one of its ends.
            ends = (arm.q_min, arm.q_max)
            travel = [q[i] - arm.home[i] if slides[i] else 0.0 for q in ends]
            reach += max(float(np.linalg.norm(b - a + t * d.xaxis[i])) for t in travel)
        return points[0].copy(), reach


class Arm:
    """Kinematics and dynamics of the robot alone: fingers welded, no contacts, no limit forces.

    Obstacles are geoms of its model that exert no forces; a payload has no geometry.

    Arguments are not checked on the hot path: float64 arrays of shape (n,). Returned arrays are
    new. An arm is not safe to share between threads: its methods use one scratch state.
    """

    def __init__(
        self,
        robot: Robot,
        payload: Load = None,
        obstacles: Sequence[Obstacle] = (),
        margin: float = 0.0,
    ) -> None:
        """Compile the model.

        Args:
            robot: The description.
            payload: The body that the main tool is believed to hold, or what each of several
                tools holds, by their names.
            obstacles: Obstacles for solvers that avoid collisions.
            margin: Part of each joint's range by which either limit is moved inwards [-].

        Raises:
            UnknownNameError: See `robot_spec`; no tool has the name that a payload goes by.
            InvalidValueError: An obstacle is none, or has a taken name; margin outside [0, 0.5).
            ModelError: See `compile_arm`.
        """
        self.robot, self.obstacles = robot, checked_obstacles(obstacles)
        self._derived: dict[Hashable, Any] = {}
        self.payloads = loads(robot, payload)
        """What each tool is believed to hold, by its name."""
        self.payload = self.payloads.get(robot.tools[0].name)
        """What the main tool is believed to hold."""
        self.model = compile_arm(robot, self.payloads, self.obstacles)
        Range(at_least=0.0, below=0.5).check("margin", margin)
        self._margin = margin
        if margin:
            limits = self.model.jnt_range
            # Joints without limits have an empty range here.
            limits += margin * np.diff(limits, axis=1) * [1.0, -1.0]
        self._data = mujoco.MjData(self.model)
        self.n = len(robot.joints)
        self.free: NDArray[np.bool_] = ~self.model.jnt_limited.astype(bool)
        """Which joints turn without limits (n,)."""
        limits = np.where(self.free[:, None], [-np.inf, np.inf], self.model.jnt_range)
        self.q_min: Vector = limits[:, 0].copy()
        """Lower joint limits (n,) [rad]; infinite where a joint turns freely, as the upper ones."""
        self.q_max: Vector = limits[:, 1].copy()
        self.q_low = np.where(self.free, -np.pi, self.q_min)
        """Lower ends of the ranges that configurations are drawn from (n,) [rad]."""
        self.q_high = np.where(self.free, np.pi, self.q_max)
        self.hinges: NDArray[np.bool_] = self.model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
        self._winding = self.hinges & (self.q_max - self.q_min >= 2.0 * np.pi)
        self.winds = bool(self._winding.any())
        self._turns = bool(self.free.any())
        self.home = checked_vector("home", robot.home, self.n)
        self.dry_friction: Vector = self.model.dof_frictionloss.copy()
        self.has_dry_friction = bool(self.dry_friction.any())
        # The arrays of MjData keep their place: each view is taken once.
        d = self._data
        self._q, self._v, self._a, self._tau = d.qpos, d.qvel, d.qacc, d.qfrc_inverse
        self._tools = [_ToolView(self, d, tool.tcp) for tool in robot.tools]
        self._jacobian, self._turn = np.zeros((6, self.n)), np.zeros(3)
        # MuJoCo solves for rows of vectors.
        self._excess, self._more = np.zeros((1, self.n)), np.zeros((1, self.n))
        self.evaluated = False
        """Whether the inverse dynamics was evaluated; for a caller that resets it."""

    def with_payload(self, payload: Load) -> "Arm":
        """Return the same arm among the same obstacles with another payload."""
        return Arm(self.robot, payload, self.obstacles, self._margin)

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

    def pose(self, q: Vector, tool: int = 0) -> SE3:
        """Return T_world_tcp of a tool at q."""
        self.place_only(q)
        pose, at = np.empty(7), self._tools[tool]
        mujoco.mju_mat2Quat(pose[:4], at.flat_rotation)
        pose[4:] = at.position
        return SE3(pose)

    def pose_as(self, target: Target, q: Vector) -> Target:
        """Return where the tools of a target are at q: a pose, or `ToolPoses` of the same tools."""
        if isinstance(target, SE3):
            return self.pose(q)
        return ToolPoses({name: self.pose(q, self.robot.tool_index(name)) for name in target})

    def pose_error(self, target: Target, q: Vector) -> Vector:
        """Return displacement [m] and rotation vector [rad] to a pose (6,), in the tool frame.

        Of several tools one after the other (6 tools,).
        """
        if isinstance(target, SE3):
            return np.concatenate(self._pose_error(target, q))
        errors = [part for one in self._parts(target) for part in self._copied_error(*one, q)]
        return np.concatenate(errors)

    def pose_distance(self, target: Target, q: Vector) -> tuple[float, float]:
        """Return distance [m] and angle [rad] between the tool at q and a pose.

        Of several tools the largest of each.
        """
        if isinstance(target, SE3):
            p, w = self._pose_error(target, q)
            return sqrt(p.dot(p)), sqrt(w.dot(w))
        errors = [self._copied_error(*one, q) for one in self._parts(target)]
        p_max, w_max = (max(sqrt(e.dot(e)) for e in parts) for parts in zip(*errors, strict=True))
        return p_max, w_max

    def error_jacobian(self, target: Target, q: Vector) -> Matrix:
        """Return the Jacobians of the tools of a target, one above the other (6 tools, n)."""
        if isinstance(target, SE3):
            return self.jacobian(q)
        return np.vstack([self.jacobian(q, tool) for _, tool in self._parts(target)])

    def joints_of(self, target: Target) -> NDArray[np.bool_]:
        """Return which joints move a tool of a target (n,)."""
        if isinstance(target, SE3):
            return self.tool_joints(0)
        joints = [self._tools[tool].joints for _, tool in self._parts(target)]
        moved: NDArray[np.bool_] = np.logical_or.reduce(joints)
        return moved

    def tool_joints(self, tool: int) -> NDArray[np.bool_]:
        """Return which joints move a tool (n,)."""
        return self._tools[tool].joints.copy()

    def _parts(self, target: ToolPoses) -> list[tuple[SE3, int]]:
        """Return the poses with their tools.

        Raises:
            UnknownNameError: The robot has no tool of a name.
        """
        return [(pose, self.robot.tool_index(name)) for name, pose in target.items()]

    def _pose_error(self, T_world_target: SE3, q: Vector, tool: int = 0) -> tuple[Vector, Vector]:
        """Return the two parts of `pose_error`; the next call overwrites the second."""
        self.place_only(q)
        target, at = T_world_target.wxyz_xyz, self._tools[tool]
        p = (target[4:] - at.position).dot(at.rotation)
        # mink's logarithm is zero at half a turn; this one is not.
        mujoco.mju_subQuat(self._turn, target[:4], at.quaternion)
        return p, self._turn

    def _copied_error(self, T_world_target: SE3, tool: int, q: Vector) -> tuple[Vector, Vector]:
        p, w = self._pose_error(T_world_target, q, tool)
        return p, w.copy()

    def jacobian(self, q: Vector, tool: int = 0) -> Matrix:
        """Return J (6, n): twist of a tool in its own frame, linear part first."""
        d, at = self.place_only(q), self._tools[tool]
        mujoco.mj_comPos(self.model, d)
        J = self._jacobian
        mujoco.mj_jacSite(self.model, d, J[:3], J[3:], at.site)
        R_tcp_world = at.rotation.T
        out = np.empty((6, self.n))
        np.matmul(R_tcp_world, J[:3], out=out[:3])
        np.matmul(R_tcp_world, J[3:], out=out[3:])
        return out

    def mass_matrix(self, q: Vector) -> Matrix:
        """Return M(q) (n, n), with the rotor inertias and `implicit_inertia` [kg·m²]."""
        d = self.place_only(q)
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
        self.evaluated = True
        return self._tau.copy()

    def place(self, q: Vector) -> None:
        """Move to q: the first half of `inverse_dynamics`, with the mass matrix in `scratch`."""
        m, d = self.model, self.place_only(q)
        mujoco.mj_comPos(m, d)
        mujoco.mj_makeM(m, d)
        mujoco.mj_factorM(m, d)

    def inverse_dynamics_here(self, v: Vector, a: Vector) -> Vector:
        """Return the torques (n,) at the configuration of `place` [N·m]; see `inverse_dynamics`."""
        self._v[:] = v
        self._a[:] = a
        mujoco.mj_inverseSkip(self.model, self._data, _POSITIONS_DONE, 1)
        self.evaluated = True
        return self._tau.copy()

    def acceleration(self, tau: Vector) -> Vector:
        """Return the acceleration (n,) that torques give where inverse dynamics was last evaluated.

        a + M⁻¹ (tau - tau(a)), with a and tau(a) those of the last inverse dynamics. The next
        call may overwrite it.
        """
        if tau.tobytes() == self._tau.tobytes():
            return self._a
        np.subtract(tau, self._tau, out=self._excess[0])
        mujoco.mj_solveM(self.model, self._data, self._more, self._excess)
        more: Vector = self._more[0]
        more += self._a
        return more

    @property
    def tool_site(self) -> int:
        """Id of the main tool's frame in `model`."""
        return self._tools[0].site

    @property
    def tool_sites(self) -> tuple[int, ...]:
        """Ids of the tool frames in `model`, in the order of the robot's tools."""
        return tuple(tool.site for tool in self._tools)

    @property
    def scratch(self) -> mujoco.MjData:
        """MuJoCo's state of the last call, such as `place`; any call overwrites it."""
        return self._data

    def unwound(self, q: Vector, q_near: Vector) -> Vector:
        """Return q with hinges wound by whole turns, as close to q_near as their limits allow."""
        if not self.winds:
            return q
        turns = np.round((q_near - q) / _TURN) * self._winding
        # Inside the limits: back by as many turns as it takes, unless q is outside itself.
        over = np.ceil((q + _TURN * turns - self.q_max) / _TURN)
        under = np.ceil((self.q_min - q - _TURN * turns) / _TURN)
        turns -= np.minimum(np.maximum(over, 0.0), np.maximum(turns, 0.0))
        turns += np.minimum(np.maximum(under, 0.0), np.maximum(-turns, 0.0))
        unwound: Vector = q + _TURN * turns
        return unwound

    def nearest(self, q: Vector, q_near: Vector) -> Vector:
        """Return q with freely turning joints within half a turn of another configuration (n,)."""
        if not self._turns:
            return q
        nearest: Vector = q + _TURN * np.round((q_near - q) / _TURN) * self.free
        return nearest

    def way(self, q: Vector, q_goal: Vector) -> Vector:
        """Return the displacements to a configuration (n,), freely turning joints the short way."""
        return self.nearest(q_goal, q) - q

    def drawn(self, rng: np.random.Generator) -> Vector:
        """Return a configuration (n,) drawn uniformly inside the limits, or on the circle."""
        q: Vector = rng.uniform(self.q_low, self.q_high)
        return q

    def limit_margin(self, q: Vector) -> float:
        """Return the smallest distance of a joint to its limits; negative outside [rad or m]."""
        return float(min(np.minimum(q - self.q_min, self.q_max - q).tolist()))

    def beyond_reach(self, position: Vector, tool: int = 0) -> float:
        """Return a lower bound on the distance of a point from a tool's workspace [m].

        It is 0 for points closer to the first joint than the length of the stretched arm.
        """
        at = self._tools[tool]
        from_base = position - at.base
        return max(0.0, sqrt(from_base.dot(from_base)) - at.reach)

    def target_beyond_reach(self, target: Target) -> float:
        """Return `beyond_reach` of a target; of several tools the largest [m]."""
        if isinstance(target, SE3):
            return self.beyond_reach(target.wxyz_xyz[4:])
        parts = self._parts(target)
        return max(self.beyond_reach(pose.wxyz_xyz[4:], tool) for pose, tool in parts)

    def checked_q(self, name: str, q: ArrayLike) -> Vector:
        """Return a copy of q, checked to be a finite vector (n,)."""
        return checked_vector(name, q, self.n)

    def place_only(self, q: Vector) -> mujoco.MjData:
        """Compute the kinematics at q, and return `scratch`."""
        self._q[:] = q
        mujoco.mj_kinematics(self.model, self._data)
        return self._data


@lru_cache(maxsize=8)
def bare_arm(robot: Robot) -> Arm:
    """Return the arm of a robot with nothing in its hands: the same one, scratch state included."""
    return Arm(robot)
