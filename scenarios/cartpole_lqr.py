"""Mean settling time of a cart-pole that LQR balances, over random starts.

The pole is linearised about its upright equilibrium by MuJoCo (`mjd_transitionFD`, one step),
the gain comes from the discrete Riccati equation. Cart and pole start at rest, drawn evenly from
±`cart` and ±`pole`, and are balanced in the full nonlinear simulation, the force limited. The
error is √((x/x_tol)² + (θ/θ_tol)²), cart position and pole angle measured by what the cost calls
tolerable, sampled at every step of 5 ms; the band is 2 % of the error at the start, the
settling time the last time at which the error is outside the band.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from robo47_qp.report.importing import importing

with importing():
    import mujoco
    import numpy as np
    from rich.console import Console
    from scipy.linalg import solve_discrete_are

    from robo47_qp.arrays import Matrix, Vector
    from robo47_qp.cli import FAILED, LOGS, OK, main
    from robo47_qp.errors import InvalidValueError
    from robo47_qp.evaluation.benchmarks.settling.settling import settling_time
    from robo47_qp.evaluation.benchmarks.settling.study import StudyOptions, conclude
    from robo47_qp.files import check_writable
    from robo47_qp.report.provenance import provenance

MJCF = """
<mujoco model="cart-pole">
  <option timestep="0.005" integrator="implicitfast"/>
  <worldbody>
    <light pos="0 -2 3" dir="0 0.6 -1"/>
    <geom name="rail" type="capsule" fromto="-3 0 0 3 0 0" size="0.01" contype="0" conaffinity="0"/>
    <body name="cart">
      <joint name="x" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="1.0" diaginertia="0.004 0.005 0.006"/>
      <geom name="cart" type="box" size="0.12 0.08 0.05" contype="0" conaffinity="0"/>
      <body name="pole">
        <joint name="theta" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 0.5" mass="0.1" diaginertia="0.0083333 0.0083333 0.00001"/>
        <geom name="pole" type="capsule" fromto="0 0 0 0 0 1" size="0.015" contype="0"
              conaffinity="0" rgba="0.85 0.22 0.18 1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="force" joint="x" ctrllimited="true" ctrlrange="-20 20"/>
  </actuator>
</mujoco>
"""
"""No friction, as in the textbooks: cart of 1 kg; pole of 1 m and 0.1 kg, upright at 0."""

TOLERABLE = np.array([0.5, 0.2, 1.0, 1.0])
"""x [m], θ [rad] and their rates at which each costs 1 (Bryson's rule: Bryson and Ho, Applied
Optimal Control, 1975, sec. 5.2)."""
TOLERABLE_FORCE = 10.0
"""Force that costs 1 [N]."""


@dataclass(frozen=True, kw_only=True)
class CartPoleOptions(StudyOptions):
    """Options of this scenario."""

    report: Path = LOGS / "cartpole_lqr.json"
    """File for the figures (JSON)."""
    seconds: float = 10.0
    """How long each start is watched [s]."""
    cart: float = 0.5
    """Largest start of the cart from the middle [m]."""
    pole: float = 0.2
    """Largest start of the pole from upright [rad]."""

    def __post_init__(self) -> None:
        """Check what no type can.

        Raises:
            InvalidValueError: A number is out of range.
        """
        super().__post_init__()
        for name, most in (("cart", 2.0), ("pole", 1.5)):
            if not 0.0 < getattr(self, name) <= most:
                expected = f"above 0 and at most {most}"
                raise InvalidValueError(f"--{name}", getattr(self, name), expected)


def linearised(model: mujoco.MjModel) -> tuple[Matrix, Matrix]:
    """A (2n, 2n) and B (2n, m) of one step about the model's own zero: x' = A x + B u.

    The state is x = (q, v); differences are centred.
    """
    n = 2 * model.nv
    A, B = np.zeros((n, n)), np.zeros((n, model.nu))
    mujoco.mjd_transitionFD(model, mujoco.MjData(model), 1e-6, True, A, B, None, None)
    return A, B


def lqr_gain(A: Matrix, B: Matrix, Q: Matrix, R: Matrix) -> Matrix:
    """K (m, n) for which u = -K x costs least: the sum over all steps of xᵀ Q x + uᵀ R u.

    K = (R + Bᵀ P B)⁻¹ Bᵀ P A, with P from the discrete algebraic Riccati equation (Anderson
    and Moore, Optimal Control: Linear Quadratic Methods, 1990, ch. 2).
    """
    P = solve_discrete_are(A, B, Q, R)
    gain: Matrix = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    return gain


def balanced(model: mujoco.MjModel, K: Matrix, q: Vector, seconds: float) -> tuple[Matrix, Vector]:
    """Start at rest from q = (x [m], θ [rad]) and balance.

    Returns:
        States (x, θ, ẋ, θ̇) at every step (N + 1, 4) and the force at each but the last
        (N,) [N], within the motor's limits.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = q
    steps = round(seconds / model.opt.timestep)
    states, force = np.empty((steps + 1, 4)), np.empty(steps)
    low, high = model.actuator_ctrlrange[0]
    for k in range(steps):
        states[k, :2], states[k, 2:] = data.qpos, data.qvel
        force[k] = np.clip(-(K @ states[k])[0], low, high)
        data.ctrl[0] = force[k]
        mujoco.mj_step(model, data)
    states[-1, :2], states[-1, 2:] = data.qpos, data.qvel
    return states, force


def error(states: Matrix) -> Vector:
    """√((x/x_tol)² + (θ/θ_tol)²) of states (N, 4) [-]."""
    size: Vector = np.linalg.norm(states[:, :2] / TOLERABLE[:2], axis=1)
    return size


def run(options: CartPoleOptions, console: Console) -> int:
    """Measure, print, write; returns the exit code."""
    check_writable(options.report)
    made, model = provenance(), mujoco.MjModel.from_xml_string(MJCF)
    A, B = linearised(model)
    K = lqr_gain(A, B, np.diag(TOLERABLE**-2.0), np.array([[TOLERABLE_FORCE**-2.0]]))
    rng = np.random.default_rng(options.seed)
    reach = np.array([options.cart, options.pole])
    starts = rng.uniform(-reach, reach, (options.starts, 2))
    runs = [balanced(model, K, start, options.seconds) for start in starts]
    times = np.array([settling_time(error(x), model.opt.timestep) for x, _ in runs])
    columns = {
        "cart m": [f"{x:.3f}" for x, _ in starts],
        "pole rad": [f"{theta:.3f}" for _, theta in starts],
        "largest force N": [f"{np.abs(force).max():.2f}" for _, force in runs],
    }
    poles = np.abs(np.linalg.eigvals(A - B @ K)).tolist()
    others = {"gain": K[0].tolist(), "closed_loop": poles, **made}
    return OK if conclude(options, times, columns, others, console) else FAILED


if __name__ == "__main__":
    sys.exit(main(CartPoleOptions, run, __doc__))
