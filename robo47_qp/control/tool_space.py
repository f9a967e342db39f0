"""Tool space: the dynamics of an arm in the coordinates of its tool."""

from math import inf
from operator import mul

import mujoco
import numpy as np
from scipy.linalg import lapack

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.arm import Arm

_POSITIONS_DONE = int(mujoco.mjtStage.mjSTAGE_POS)

MASS_MAX = 200.0
"""Inertia of the tool above which a direction counts as close to singular [kg]."""
_UNIT = np.eye(6).tobytes()
_solve = lapack.dposv
_LENGTH = 0.3
"""Length that makes a moment of inertia comparable with a mass [m]."""
LIGHTEST: Vector = 1.0 / (MASS_MAX * np.array([1.0] * 3 + [_LENGTH**2] * 3))
"""Inverse of the inertia along each axis above which it counts as close to singular (6,)."""


class ToolSpace:
    """Computes Jacobian, inertia and null space of an arm at its last `Arm.place`.

    Λ = (J M⁻¹ Jᵀ + ε I)⁻¹ is the inertia at the tool (Khatib, A unified approach for motion and
    force control of robot manipulators: the operational space formulation, IEEE J. Robotics and
    Automation 3(1), 1987). It is exact, ε = 0, while no axis exceeds `MASS_MAX`. Closer to a
    singularity ε grows smoothly (after Nakamura and Hanafusa, J. Dynamic Systems, Measurement
    and Control 108(3), 1986), so that Λ stays below 1.4 `MASS_MAX`, and joints that no longer
    move the tool join the null space.

    All is expressed in a frame that the caller chooses, linear part first. There is one instance
    per arm (see `Arm.derived`); the next call overwrites the arrays.
    """

    def __init__(self, arm: Arm) -> None:
        """Allocate the arrays."""
        n = arm.n
        self._arm = arm
        self._model, self._data, self._tcp = arm.model, arm.scratch, arm.tool_site
        self._reference = mujoco.MjData(arm.model)
        # Spares the kinematics of a reference at rest.
        self._reference_bytes = b""
        d, ref, tcp = self._data, self._reference, self._tcp
        # The arrays of MjData keep their place: each view is taken once.
        self._v, self._a, self._tau = d.qvel, d.qacc, d.qfrc_inverse
        # As bytes, because numpy takes twice the time to fill so few numbers.
        self._q_ref = ref.qpos.data.cast("B")
        self.position, self.quaternion = d.site_xpos[tcp], d.site_xquat[tcp]
        self.position_ref, self.quaternion_ref = ref.site_xpos[tcp], ref.site_xquat[tcp]
        self.rotation_ref: Matrix = ref.site_xmat[tcp].reshape(3, 3)
        self._body = int(arm.model.site_bodyid[tcp])
        self._world, self._turned, self._J_dot = _Rows(n), _Rows(n), _Rows(n)
        self.J, self.J_T = self._world.whole, self._world.whole.T
        """Twist of the tool per joint velocity (6, n), and its transpose."""
        # One product with J: of M⁻¹Jᵀ, and of two motions of the joints.
        self._motions, self._products = np.zeros((8, n)), np.zeros((8, 6))
        self._J_over_M, self._inverse = self._motions[:6], self._products[:6]
        self.motions: Matrix = self._motions[6:]
        """Two joint velocities or accelerations (2, n), set before `update`."""
        self._twists, self._forces = self._products[6:], np.zeros((2, 6))
        self.twists: tuple[Vector, ...] = tuple(self._twists)
        """J times each of `motions`, found by `update`: two of (6,)."""
        self._null = np.zeros((2, n))
        self._null_rows: tuple[Vector, ...] = tuple(self._null)
        self._pivots = self._inverse.reshape(-1)[::7]
        self.inertia: Matrix = np.zeros((6, 6), order="F")
        """Λ (6, 6) [kg, kg·m, kg·m²]."""
        self._diagonal: Vector = self.inertia.reshape(-1, order="A")[::7]
        self.inertias: list[float] = []
        """The diagonal of `inertia`, 6 numbers."""
        self.errors: Matrix = np.zeros((2, n))
        """The joints' errors of position and velocity (2, n), set by the caller."""
        self.error_q, self.error_v = self.errors
        self._force, self._rate = np.zeros(6), np.zeros(6)
        self._columns = self._inverse.T
        self._room = self.inertia.reshape(-1, order="A").data.cast("B")
        self._use: list[float] = LIGHTEST.tolist()

    def set_reference(self, q_ref: Vector) -> None:
        """Compute the tool's pose at the reference: `position_ref` and so on."""
        q_bytes = q_ref.tobytes()
        if q_bytes != self._reference_bytes:
            self._reference_bytes = q_bytes
            self._q_ref[:] = q_bytes
            mujoco.mj_kinematics(self._model, self._reference)

    def update(self, *, in_tool: bool) -> None:
        """Compute J and Λ at the configuration of the last `Arm.place`.

        Args:
            in_tool: Use the axes of the tool at its reference, else those of the world.
        """
        m, d, rows = self._model, self._data, self._world
        mujoco.mj_jacSite(m, d, rows.linear, rows.angular, self._tcp)
        if in_tool:
            np.matmul(self.rotation_ref.T, rows.blocks, out=self._turned.blocks)
            rows = self._turned
        self.J, self.J_T = rows.whole, rows.transposed
        mujoco.mj_solveM(m, d, self._J_over_M, self.J)
        regular = self._invert(0.0)
        if regular and max(self.inertias) < MASS_MAX * _LENGTH**2:
            return
        heaviest = max(map(mul, self.inertias, self._use)) if regular else inf
        if heaviest > 1.0:
            self._invert((1.0 - 1.0 / heaviest) ** 2)

    def position_error(self, *, in_tool: bool) -> list[float]:
        """Return the displacement from the tool to its reference, 3 numbers [m]."""
        if in_tool:
            p: list[float] = (self.position_ref - self.position).dot(self.rotation_ref).tolist()
            return p
        (a, b, c), (x, y, z) = self.position_ref.tolist(), self.position.tolist()
        return [a - x, b - y, c - z]

    def orientation_error(self, *, in_tool: bool) -> tuple[float, float, float, float]:
        """Return the unit quaternion wxyz, w >= 0, that rotates the tool into its reference."""
        # Scalars, because numpy and MuJoCo take twice the time for so few numbers.
        w, x, y, z = self.quaternion.tolist()
        a, b, c, d = self.quaternion_ref.tolist()
        # Reference times conjugate; in the tool's axes order and cross product are reversed.
        s = -1.0 if in_tool else 1.0
        eta = a * w + b * x + c * y + d * z
        e1 = b * w - a * x - s * (c * z - d * y)
        e2 = c * w - a * y - s * (d * x - b * z)
        e3 = d * w - a * z - s * (b * y - c * x)
        return (eta, e1, e2, e3) if eta >= 0.0 else (-eta, -e1, -e2, -e3)

    def null_space_motions(self) -> tuple[Vector, ...]:
        """Return the parts of both `motions` that do not move the tool: v - M⁻¹ Jᵀ Λ J v.

        Returns:
            Two of (n,), overwritten by the next call.
        """
        self._twists.dot(self.inertia, self._forces).dot(self._J_over_M, self._null)
        np.subtract(self.motions, self._null, self._null)
        return self._null_rows

    def inverse_dynamics(self, v: tuple[Vector, Vector], a: tuple[Vector, Vector]) -> Vector:
        """Return `Arm.inverse_dynamics_here` of v[0] - v[1] and a[0] + a[1], without copies.

        Returns:
            (n,) [N·m], overwritten by the next call.
        """
        np.subtract(v[0], v[1], self._v)
        np.add(a[0], a[1], self._a)
        mujoco.mj_inverseSkip(self._model, self._data, _POSITIONS_DONE, 1)
        self._arm.evaluated = True
        return self._tau

    def inertia_times(self, a: Vector) -> Vector:
        """Return Λ a (6,), overwritten by the next call."""
        force: Vector = self.inertia.dot(a, self._force)
        return force

    def jacobian_rate_times(self, v: Vector, *, in_tool: bool = False) -> Vector:
        """Return J̇ v, with J̇ at the velocity of the last inverse dynamics and fixed axes.

        Returns:
            (6,), overwritten by the next call.
        """
        rows = self._J_dot
        mujoco.mj_jacDot(
            self._model, self._data, rows.linear, rows.angular, self.position, self._body
        )
        product: Vector = rows.whole.dot(v, self._rate)
        if in_tool:
            product = product.reshape(2, 3).dot(self.rotation_ref).reshape(6)
        return product

    def _invert(self, damping: float) -> bool:
        """Compute Λ = (J M⁻¹ Jᵀ + ε I)⁻¹; return False where it does not exist."""
        self._motions.dot(self.J_T, self._products)
        if damping:
            self._pivots += damping * LIGHTEST
        self._room[:] = _UNIT
        # In place, so that the views of both matrices stay valid: upper triangle, overwrite the
        # matrix, overwrite the right side. Without keywords, because they take time.
        failed = _solve(self._columns, self.inertia, 0, 1, 1)[2]
        self.inertias = self._diagonal.tolist()
        return not failed


class _Rows:
    """A (6, n) matrix and the views of it that every period needs."""

    def __init__(self, n: int) -> None:
        self.whole: Matrix = np.zeros((6, n))
        self.transposed = self.whole.T
        self.linear, self.angular = self.whole[:3], self.whole[3:]
        self.blocks = self.whole.reshape(2, 3, n)
