"""LearnedFriction: dry friction of the joints, learned from what a disturbance observer sees."""

from dataclasses import dataclass

import mujoco
import numpy as np

from robo47_qp._core.library import Structure, backend, functions
from robo47_qp._core.mujoco_functions import function, structure
from robo47_qp.arrays import Checked, NotNegative, Positive, Vector
from robo47_qp.model.arm import Arm
from robo47_qp.model.chain import MAX_JOINTS

PERIODS = 10
"""Control periods between two updates of the friction."""
_LEARNING = 5
"""Updates of the friction between two steps of learning."""
_SETTLING = 0.1
"""Time after a reversal in which nothing is learned: the observer has to follow first; after
which joints at rest have come to rest, and in which those that start do so [s]."""
_SLOW = 0.01
"""Speed of the reference below which a joint may stick: nothing is learned of it then [rad/s] or
[m/s]."""
_LOOSE = 3e-4
"""How far a joint may have been led since it turned or rested, and still stick [rad] or [m]. While
it does, less than all of its friction is seen."""
_CREEPS = 0.1
"""Share of that below which the observer has the time to find a reversal out, unless the friction
is told from the start [-]: with all of it, tools of `moderate` worlds left their lines by 0.33 mm
in place of 0.2."""


@dataclass(frozen=True, kw_only=True)
class FrictionLearning(Checked):
    """Learns the dry friction of every joint while it moves.

    The torque that the belief cannot explain is y = b + f z, with z the direction of motion: it
    goes from -1 to 1 over a displacement 2 δ of the reference and stays when that rests, as dry
    friction does (Dahl, AIAA J. 14(12), 1976, in the piecewise linear form). b is what does not
    turn with the motion, such as heavier links, and may wander. A Kalman filter per joint tells
    b and f apart: by the reversals, and because joints that bear no weight have little b.
    Torques are shares of the motors' torque, those of b of the largest gravity torque.

    At rest friction is what holds the joints where they came to rest, of any size up to f and
    against either direction, whatever they did before. Nothing is learned then, nor of a slow joint
    until it has been led so far that it sticks no more; z is estimated from y at rest, with b and f
    as they are: it is from there that the friction turns at the next start.

    At a reversal the observer's disturbance is changed by -M⁻¹ f Δz at once, so that it does not
    have to find out about it. Where a joint creeps, but for the start from rest while nothing is
    touched, it finds most out by itself: the joint may have stuck, and turned before its reference.
    """

    displacement: Positive = 1e-4
    """δ [rad]."""
    start: Positive = 1e-6
    """δ of joints that start from rest: until friction turns, they stick, and are left behind. Not
    in contact, where it is not told how friction held them [rad]."""
    most: NotNegative = 0.1
    """Largest f [-]."""
    expected: Positive = 0.01
    """Standard deviation of f before anything is learned [-]."""
    bias: Positive = 0.05
    """Standard deviation of b, as a share of gravity and Coriolis torques at the start and of their
    changes later [-]."""
    bias_rate: Positive = 0.002
    """Standard deviation by which b wanders besides in a second [-]."""
    friction_rate: Positive = 0.002
    """Standard deviation by which f wanders in a second [-]."""
    noise: Positive = 0.002
    """Standard deviation of y, measured every 50 periods [-]."""
    swing: NotNegative = 0.04
    """How far joints go and come back before a run's work, where there is time, so that they have
    reversed once [rad] or [m]; see `Loosening`."""


class LearnedFriction:
    """The friction that one run has learned; see `FrictionLearning`."""

    def __init__(self, settings: FrictionLearning, arm: Arm, dt: float) -> None:
        """Start with what is expected of the robot's joints."""
        n, scale = arm.n, arm.robot.tau_max
        self._settings, self._per_update = settings, PERIODS * dt
        self._per_displacement, self._per_start = 1.0 / settings.displacement, 1.0 / settings.start
        self._slow = _SLOW * self._per_update
        told = arm.robot.dry_friction is not None
        self._creeps = self._slow if told else _CREEPS * self._slow
        self._q, self._started = np.zeros(n), False
        self._z, self._gone, self._since = np.zeros((3, n))
        self._rested, self._moving = np.zeros(1), np.zeros(1)
        self._b, self._f, self._most = np.zeros(n), np.zeros(n), settings.most * scale
        if arm.robot.dry_friction is not None:
            self._f[:] = np.minimum(arm.robot.dry_friction, self._most)
        self._P_bb, self._P_bf = np.zeros(n), np.zeros(n)
        self._borne, self._bears = np.zeros(n), np.zeros(n)
        self._P_ff = (settings.expected * scale) ** 2
        step = _LEARNING * self._per_update
        self._Q_bb = step * (settings.bias_rate * scale) ** 2
        self._Q_ff = step * (settings.friction_rate * scale) ** 2
        self._R = (settings.noise * scale) ** 2
        self._rows = np.zeros((2, 1, n))
        self._count = 0
        self.core: Structure | None = None
        """The same in the compiled core, on the arrays of this object."""
        if backend() == "compiled" and n <= MAX_JOINTS:
            self._build_core(n)

    @property
    def friction(self) -> Vector:
        """What was learned of f (n,) [N·m]."""
        return self._f.copy()

    def change(self, arm: Arm, q_ref: Vector, disturbance: Vector | None = None) -> Vector | None:
        """Return the change of the joints' acceleration since the last call (n,); None for none.

        Args:
            arm: With the mass matrix of the last inverse dynamics in its scratch.
            q_ref: The reference now (n,) [rad].
            disturbance: By it, friction is told that holds joints at rest (n,) [rad/s²]; None
                where a contact may be what does.
        """
        if self.core is not None:
            self._give(self.core, arm, q_ref)
            self.core.pointer.free = disturbance is not None
            if disturbance is not None:
                self._held[:] = disturbance
            turns = functions().r47_friction_change(self.core.pointer)
            return self._change if turns else None
        if not self._started:
            self._q[:], self._started = q_ref, True
            return None
        self._since += self._per_update
        self._rested += self._per_update
        if disturbance is not None and self._rested[0] > _SETTLING:
            self._hold(arm, disturbance)
        if q_ref.tobytes() == self._q.tobytes():
            self._moving[0] = 0.0
            self._gone[:] = 0.0
            return None
        starts = disturbance is not None and self._moving[0] < _SETTLING
        self._moving += self._per_update
        self._rested[0] = 0.0
        step = q_ref - self._q
        z = step * (self._per_start if starts else self._per_displacement)
        z += self._z
        np.minimum(z, 1.0, out=z)
        np.maximum(z, -1.0, out=z)
        self._q[:] = q_ref
        turned = z - self._z
        self._gone += np.abs(step)
        self._gone[turned != 0.0] = 0.0
        slow = (np.abs(step) < self._slow) & (self._gone < _LOOSE)
        self._since[(turned != 0.0) | slow] = 0.0
        if not turned.any():
            return None
        self._z[:] = z
        change, torque = self._rows
        share = 1.0 if starts else np.minimum(np.abs(step) / self._creeps, 1.0)
        np.multiply(self._f, -turned * share, out=torque[0])
        mujoco.mj_solveM(arm.model, arm.scratch, change, torque)
        changed: Vector = change[0]
        return changed

    def expected(self, arm: Arm) -> Vector:
        """Return the disturbance that is expected by what was learned (n,) [rad/s²]."""
        change, torque = self._rows
        torque[0] = -self._b - self._f * self._z
        mujoco.mj_solveM(arm.model, arm.scratch, change, torque)
        expected: Vector = change[0].copy()
        return expected

    def learn(self, arm: Arm, disturbance: Vector) -> None:
        """Learn from the disturbance (n,) [rad/s²]; see `change`. Called after every `change`."""
        self._bears[:] = arm.scratch.qfrc_bias
        if self.core is not None:
            self._give(self.core, arm, disturbance)
            functions().r47_friction_learn(self.core.pointer)
            return
        self._count += 1
        if self._count % _LEARNING:
            return
        z = self._z
        change = np.abs(self._bears - self._borne)
        self._borne[:] = self._bears
        self._P_bb[:] = (np.sqrt(self._P_bb) + self._settings.bias * change) ** 2 + self._Q_bb
        self._P_ff += self._Q_ff
        if self._rested[0] > 0.0:
            return
        # What is not to be learned from is infinitely noisy.
        R = np.where(self._since < _SETTLING, np.inf, self._R)
        c_b, c_f = self._P_bb + z * self._P_bf, self._P_bf + z * self._P_ff
        S = c_b + z * c_f + R
        k_b, k_f = c_b / S, c_f / S
        error = self._unexplained(arm, disturbance) - self._b - self._f * z
        self._b += k_b * error
        np.clip(self._f + k_f * error, 0.0, self._most, out=self._f)
        self._P_bb -= k_b * c_b
        self._P_bf -= k_b * c_f
        self._P_ff -= k_f * c_f

    def jump(self, q_ref: Vector) -> None:
        """Take in that the reference goes on from elsewhere (n,) [rad], and joints do not turn."""
        self._q[:] = q_ref

    def _hold(self, arm: Arm, disturbance: Vector) -> None:
        """Find out how friction holds joints at rest: that tells z."""
        z, f = self._z, self._f
        z += f / (f * f + self._R) * (self._unexplained(arm, disturbance) - self._b - f * z)
        np.clip(z, -1.0, 1.0, out=z)

    def _unexplained(self, arm: Arm, disturbance: Vector) -> Vector:
        """Y of a disturbance (n,) [N·m]."""
        product, d = self._rows[:, 0]
        d[:] = disturbance
        mujoco.mj_mulM(arm.model, arm.scratch, product, d)
        y: Vector = -product
        return y

    def _build_core(self, n: int) -> None:
        """Let the compiled core work on the arrays of this object, which keep their place."""
        self._given, self._held, self._change = np.zeros((3, n))
        self.core = Structure(
            "r47_friction",
            n=n,
            solve=function("mj_solveM"),
            mass=function("mj_mulM"),
            per_update=self._per_update,
            per_displacement=self._per_displacement,
            per_start=self._per_start,
            slow=self._slow,
            loose=_LOOSE,
            creeps=self._creeps,
            settling=_SETTLING,
            learning=_LEARNING,
            q=self._q,
            z=self._z,
            gone=self._gone,
            since=self._since,
            rested=self._rested,
            moving=self._moving,
            b=self._b,
            f=self._f,
            most=self._most,
            bias=self._settings.bias,
            bears=self._bears,
            borne=self._borne,
            P_bb=self._P_bb,
            P_bf=self._P_bf,
            P_ff=self._P_ff,
            Q_bb=self._Q_bb,
            Q_ff=self._Q_ff,
            R=self._R,
            given=self._given,
            held=self._held,
            change=self._change,
        )

    def _give(self, core: Structure, arm: Arm, numbers: Vector) -> None:
        core.pointer.model, core.pointer.data = structure(arm.model), structure(arm.scratch)
        self._given[:] = numbers
