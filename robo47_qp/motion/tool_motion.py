"""Tool motion: velocity, acceleration and jerk of the tool, exactly, from those of the joints."""

from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robo47_qp._core.library import Structure, backend, functions, pointer
from robo47_qp._core.mujoco_functions import dynamics
from robo47_qp.arrays import Matrix, Vector, contiguous
from robo47_qp.model.arm import Arm


class ToolRates(NamedTuple):
    """Norms of the first three derivatives, linear and angular; each (N, 2).

    They are means over one, two and three steps, so the bounds of the derivatives hold for them.
    """

    v: Matrix
    a: Matrix
    j: Matrix


def tool_rates(arm: Arm, q: Matrix, dt: float) -> ToolRates:
    """Return the rates for configurations (N, n) every dt, at rest before and after them.

    Of several tools the largest of each.
    """
    rates = [rates_of(arm, q, dt, tool) for tool in range(len(arm.robot.tools))]
    if len(rates) == 1:
        return rates[0]
    return ToolRates(*(np.maximum.reduce(order) for order in zip(*rates, strict=True)))


def rates_of(arm: Arm, q: Matrix, dt: float, tool: int) -> ToolRates:
    """Return the same of one tool."""
    steps = tool_steps(arm, q, tool)
    still = np.zeros((2, 2, 3))
    v = np.concatenate([still, steps, still]) / dt
    a = np.diff(v, axis=0) / dt
    return ToolRates(*(_sizes(x) for x in (v[2:-2], a, np.diff(a, axis=0) / dt)))


def tool_steps(arm: Arm, q: Matrix, tool: int = 0) -> Matrix:
    """Return the displacements [m] and turns [rad] between configurations (N - 1, 2, 3)."""
    positions, quats = tool_places(arm, q, tool)
    rotations = Rotation.from_quat(quats, scalar_first=True)
    turns = rotations[:-1].apply((rotations[:-1].inv() * rotations[1:]).as_rotvec())
    return np.stack([np.diff(positions, axis=0), turns], axis=1)


def tool_places(arm: Arm, q: Matrix, tool: int = 0) -> tuple[Matrix, Matrix]:
    """Return tool positions (N, 3) [m] and quaternions wxyz (N, 4) at configurations (N, n).

    Raises:
        InvalidValueError: The configurations are of another size.
    """
    q = contiguous("q", q, None, arm.n)
    positions, quats = np.empty((len(q), 3)), np.empty((len(q), 4))
    m, d = arm.model, arm.scratch
    site = arm.tool_sites[tool]
    joints, position, quat = d.qpos, d.site_xpos[site], d.site_xquat[site]
    if backend() == "compiled":
        arrays = (q, positions, quats)
        places = map(pointer, (position, quat))
        core = arm.derived(_in_core).pointer
        functions().r47_tool_places(core, *places, len(q), *map(pointer, arrays))
        return positions, quats
    for k, row in enumerate(q):
        joints[:] = row
        mujoco.mj_kinematics(m, d)
        positions[k], quats[k] = position, quat
    return positions, quats


def _in_core(arm: Arm) -> Structure:
    return dynamics(arm.model, arm.scratch)


def _sizes(values: Matrix) -> Matrix:
    sizes: Vector = np.linalg.norm(values, axis=2)
    return sizes


class ToolMotion(NamedTuple):
    """Derivatives of the tool's pose at N instants, in the world; each (N, 3)."""

    v: Matrix
    """Velocity of the tool point [m/s]."""
    a: Matrix
    """Its acceleration [m/s²]."""
    j: Matrix
    """Its jerk [m/s³]."""
    turn_v: Matrix
    """Angular velocity [rad/s]."""
    turn_a: Matrix
    """Angular acceleration [rad/s²]."""
    turn_j: Matrix
    """Angular jerk [rad/s³]."""


def tool_motion(arm: Arm, q: Matrix, v: Matrix, a: Matrix, j: Matrix, tool: int = 0) -> ToolMotion:
    """Return the motion of a tool for joints with q, v, a and jerk j; each (N, n).

    All instants at once, joint after joint from the base on, in spatial vectors (w, u) at the
    world's origin: with S_i the axis of joint i, which the joints before it carry along, and
    V, A, J the derivatives up to joint i - 1,

    S_i' = V × S_i,  S_i'' = A × S_i + V × S_i',
    V += S_i v_i,  A += S_i a_i + S_i' v_i,  J += S_i j_i + 2 S_i' a_i + S_i'' v_i

    (Featherstone, Rigid Body Dynamics Algorithms, 2008, sec. 2.9 and 5.3, one order further).

    Raises:
        InvalidValueError: The arrays are of another size.
    """
    q, v, a, j = (contiguous("a motion", x, len(q), arm.n) for x in (q, v, a, j))
    if backend() == "compiled":
        core, motion = arm.derived(_screws, tool).pointer, np.empty((len(q), 18))
        joints = map(pointer, (q, v, a, j))
        functions().r47_tool_motion(core, len(q), *joints, pointer(motion))
        return ToolMotion(*(motion[:, k : k + 3] for k in range(0, 18, 3)))
    screws, point = arm.derived(_at_rest, tool)
    count, own = len(q), arm.tool_joints(tool)
    R, p = np.tile(np.eye(3)[:, :, None], count), np.zeros((3, count))
    w, u, dw, du, ddw, ddu = np.zeros((6, 3, count))
    for (axis, moment, turns, zero), q_i, v_i, a_i, j_i in zip(
        screws, q.T[own], v.T[own], a.T[own], j.T[own], strict=True
    ):
        # The axis where the joints before it have brought it.
        s = np.einsum("ijk,j->ik", R, axis)
        m = np.einsum("ijk,j->ik", R, moment) + _cross(p, s)
        if not turns:
            s, m = np.zeros_like(s), s
        ds, dm = _cross(w, s), _cross(u, s) + _cross(w, m)
        dds = _cross(dw, s) + _cross(w, ds)
        ddm = _cross(du, s) + _cross(dw, m) + _cross(u, ds) + _cross(w, dm)
        w, u, dw, du, ddw, ddu = (
            w + s * v_i,
            u + m * v_i,
            dw + s * a_i + ds * v_i,
            du + m * a_i + dm * v_i,
            ddw + s * j_i + 2.0 * ds * a_i + dds * v_i,
            ddu + m * j_i + 2.0 * dm * a_i + ddm * v_i,
        )
        R, p = _moved(R, p, axis, moment, turns, q_i - zero)
    x = np.einsum("ijk,j->ik", R, point) + p
    dx = u + _cross(w, x)
    ddx = du + _cross(dw, x) + _cross(w, dx)
    dddx = ddu + _cross(ddw, x) + 2.0 * _cross(dw, dx) + _cross(w, ddx)
    return ToolMotion(*(part.T for part in (dx, ddx, dddx, w, dw, ddw)))


class _Screw(NamedTuple):
    axis: Vector
    """Direction in the world (3,)."""
    moment: Vector
    """Anchor × direction (3,) [m]; 0 where the joint slides."""
    turns: bool
    zero: float
    """Joint position at which axis and moment are these."""


def _at_rest(arm: Arm, tool: int) -> tuple[list[_Screw], Vector]:
    """Return the axes of the joints that move a tool, and its point, with all joints at zero."""
    m = arm.model
    d = arm.place_only(m.qpos0)
    screws = []
    for i in np.flatnonzero(arm.tool_joints(tool)).tolist():
        zero = float(m.qpos0[i])
        axis, turns = d.xaxis[i].copy(), bool(arm.hinges[i])
        moment = np.cross(d.xanchor[i], axis) if turns else np.zeros(3)
        screws.append(_Screw(axis, moment, turns, zero))
    return screws, d.site_xpos[arm.tool_sites[tool]].copy()


def _screws(arm: Arm, tool: int) -> Structure:
    """Return the structure `r47_screws` of a tool."""
    screws, point = _at_rest(arm, tool)
    return Structure(
        "r47_screws",
        n=arm.n,
        count=len(screws),
        joint=np.flatnonzero(arm.tool_joints(tool)).astype(np.int32),
        turns=np.array([screw.turns for screw in screws], dtype=np.int32),
        axis=np.array([screw.axis for screw in screws]),
        moment=np.array([screw.moment for screw in screws]),
        zero=np.array([screw.zero for screw in screws]),
        point=point,
    )


def _moved(
    R: Matrix, p: Matrix, axis: Vector, moment: Vector, turns: bool, by: Vector
) -> tuple[Matrix, Matrix]:
    """Return displacements R (3, 3, N) and p (3, N) with a screw motion applied first."""
    if not turns:
        return R, p + np.einsum("ijk,j->ik", R, axis) * by
    # Rodrigues' formula; the anchor nearest to the origin stays where it is.
    K = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    turn = (
        np.eye(3)[:, :, None] + np.sin(by) * K[:, :, None] + (1 - np.cos(by)) * (K @ K)[..., None]
    )
    anchor = np.cross(axis, moment)
    shift = anchor[:, None] - np.einsum("ijk,j->ik", turn, anchor)
    return np.einsum("ilk,ljk->ijk", R, turn), p + np.einsum("ilk,lk->ik", R, shift)


def _cross(a: Matrix, b: Matrix) -> Matrix:
    """Return cross products of columns (3, N), several times as fast as numpy."""
    out = np.empty_like(a)
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out
