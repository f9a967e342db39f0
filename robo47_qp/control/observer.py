"""DisturbanceObserver: the joints' state from noisy positions, and what the model does not know."""

from dataclasses import dataclass, replace
from typing import Annotated, Any, Self

import numpy as np

from robo47_qp.arrays import Checked, CountOrZero, NotNegative, Range, Vector
from robo47_qp.constants import MANY, TIMESTEP
from robo47_qp.control.bandwidth import Bandwidths
from robo47_qp.control.closed_chain import ClosedChain
from robo47_qp.control.controller import dry_friction_torque
from robo47_qp.control.friction import PERIODS, FrictionLearning, LearnedFriction
from robo47_qp.control.jitter import Jitter, left
from robo47_qp.control.joint_filter import gains, per_joint, prediction, update
from robo47_qp.model.arm import Arm, JointReference, JointState

_SETTLING, _STUCK = 0.1, 0.5
"""Time at rest until the observer follows as slowly as is good there, and the same where dry
friction may hold a joint beside its place [s]."""
_WITHIN, _BEYOND = 4.0, 10.0
"""Standard deviations of the noise within which joints are where they are to rest, and beyond
which they are not any more [-]."""
_SLOWER = 0.85
"""Least part of a bandwidth that is left at once when joints come to rest [-]."""


@dataclass(frozen=True, kw_only=True)
class DisturbanceObserver(Checked):
    """Estimates the joints' state and the acceleration that the belief cannot explain.

        q̇ = v,   v̇ = a + d,   ḋ = 0,   a = M⁻¹ (tau - c - g + tau_passive)

    with a the acceleration that the belief expects of the torque that was commanded, within the
    motors' limits. The estimate follows the measured positions alone; measured velocities are
    not used. Its three poles per joint lie at a bandwidth ω (an extended state observer: Han,
    IEEE Trans. Industrial Electronics 56(3), 2009; disturbance observers: Ohnishi, Shibata and
    Murakami, IEEE/ASME Trans. Mechatronics 1(1), 1996). Controllers get the estimated state, and
    a_ref - d as the reference's acceleration: their feed-forward then meets the disturbance, be
    it a payload, heavier links or dry friction, without an error of the springs.

    As the expected acceleration is that of the torque which the motors deliver, nothing winds
    up at their limits. `ObservedJoints.compensate` holds the compensation at what it was: in
    contact, it would otherwise press ever harder towards a reference that it cannot reach.

    ω is `bandwidth`, or less in joints where noise of `noise_q` would take the torque past a
    rate limit: at seven standard deviations, with the inertias of the present configuration.
    """

    bandwidth: Annotated[float, Range(above=0.0, at_most=1.0 / TIMESTEP)] = 140.0
    """Largest ω [rad/s]. A delay T that is not told leaves the arm stable up to about 0.7 / ω."""
    noise_q: NotNegative | None = None
    """Standard deviation of measured positions for which the torque rate is kept [rad]; None
    takes that of the sensors."""
    torque_share: Annotated[float, Range(at_least=0.0, at_most=1.0)] = 0.2
    """Largest compensation, as a share of the motors' torque: of that which accelerates a joint
    by d at home while the others are free [-]."""
    fade: NotNegative = 0.1
    """Time in which the compensation comes back after it was held [s]."""
    friction: FrictionLearning | None = FrictionLearning()
    """How dry friction is learned and compensated at reversals; None does not."""
    state_delay: CountOrZero | None = None
    """Control periods by which the state is late; None rounds what the cell's data sheet says."""
    command_delay: CountOrZero | None = None
    """Control periods from a command to the motors, likewise."""
    jitter: NotNegative | None = None
    """Standard deviation of the time by which the state is late, likewise [s]; see `Jitter`."""

    def in_cell(
        self, noise_q: float, state_delay: float, command_delay: float, jitter: float, dt: float
    ) -> Self:
        """Return the settings with what a cell's data sheet says, where they say nothing.

        Args:
            noise_q: Standard deviation of the measured positions [rad].
            state_delay: Mean time from a state to the controller [s].
            command_delay: Mean time from a command to the motors [s].
            jitter: Standard deviation of the time from a state to the controller [s].
            dt: Control period [s].
        """
        late, later = round(state_delay / dt), round(command_delay / dt)
        return replace(
            self,
            noise_q=noise_q if self.noise_q is None else self.noise_q,
            state_delay=late if self.state_delay is None else self.state_delay,
            command_delay=later if self.command_delay is None else self.command_delay,
            jitter=jitter if self.jitter is None else self.jitter,
        )

    def build(self, arm: Arm, dt: float) -> "ObservedJoints":
        """Return an observer of one run, for control periods dt [s]."""
        return ObservedJoints(self, arm, dt)

    def bandwidths(self, arm: Arm, dt: float) -> Bandwidths:
        """Return ω of every joint."""
        jitter = left(dt) * (self.jitter or 0.0)
        return Bandwidths(arm, self.bandwidth, self.noise_q or 0.0, dt, jitter=jitter)


class ObservedJoints:
    """The estimate of one run; see `DisturbanceObserver`."""

    def __init__(self, settings: DisturbanceObserver, arm: Arm, dt: float) -> None:
        """Start anew; the first measured positions are taken as those of joints at rest."""
        self.settings, self._n, self._dt = settings, arm.n, dt
        self.noise_q = settings.noise_q or 0.0
        """Standard deviation of measured positions [rad]."""
        n, command_delay = arm.n, settings.command_delay or 0
        delay = (settings.state_delay or 0) + command_delay
        self._bandwidths = settings.bandwidths(arm, dt)
        self._omegas, self._rested = self._bandwidths.usual.copy(), 0
        self._quiet = np.zeros(n, bool)
        filters = [update(gains(omega, dt), dt) for omega in self._omegas]
        self._update = per_joint(filters)
        self._last, self._now = _Known(n), _Known(n)
        self._pending = np.zeros((delay, n))
        self._delayed, self._late = bool(delay), command_delay * dt
        to_next, to_command = prediction(1, dt), prediction(delay, dt)
        self._predict, self._next = per_joint([to_command] * n), per_joint([to_next] * n)
        lightest = 1.0 / np.diag(np.linalg.inv(arm.mass_matrix(arm.home)))
        self._high = settings.torque_share * arm.robot.tau_max / lightest
        self._least = float(self._high.min()) ** 2
        self._special = arm.has_dry_friction or self._delayed
        self._started, self._on, self._learns, self._free = False, True, True, True
        self._compensation, self._offset = np.zeros(n), np.zeros(n)
        self._left = self._fade = 0
        self._chain: ClosedChain | None = None
        # For the compiled core, whose arrays keep their place.
        self._filters = np.ascontiguousarray(np.moveaxis(np.array(filters), 0, 2))
        self._matrices = {"next": to_next.copy(), "predict": to_command.copy()}
        self._tracked = np.zeros(n)
        self._kept, self._held, self._turning = self._now, np.zeros(n), np.zeros(n)
        self._base, self._shares = np.zeros(n), np.zeros((n, n))
        self._jitter: Jitter | None = None
        if settings.jitter:
            self._jitter = Jitter(self.noise_q, settings.jitter, dt)
        self._friction, self._count = None, PERIODS
        self._turned: Vector | None = None
        if settings.friction is not None:
            self._friction = LearnedFriction(settings.friction, arm, dt)

    def tune(self, arm: Arm, reference: JointReference, periods: int) -> None:
        """Let bandwidths be those of the reference's state after some periods; see `Bandwidths`."""
        q, v, a = reference
        off = np.abs(self._now.state.q - q)
        pushed = off.max() > _BEYOND * self.noise_q
        self._rested = 0 if pushed or v.any() or a.any() else self._rested + periods
        there = off <= np.where(self._quiet, _BEYOND, _WITHIN) * self.noise_q
        rests = self._rested * self._dt >= (_SETTLING if there.all() else _STUCK)
        self._quiet = rests & there
        omegas = self._bandwidths.at(arm, q, v, rests=self._quiet)
        # At once, the noise that is in d would stay in it for long.
        omegas = np.where(self._quiet, np.maximum(omegas, _SLOWER * self._omegas), omegas)
        if (omegas == self._omegas).all():
            return
        for j in np.flatnonzero(omegas != self._omegas):
            changed = update(gains(float(omegas[j]), self._dt), self._dt)
            self._filters[:, :, j] = changed
            self._update.reshape(3, self._n, 5, self._n)[:, j, :, j] = changed
        self._omegas = omegas

    @property
    def disturbance(self) -> Vector:
        """d: the acceleration that the belief cannot explain (n,) [rad/s²]."""
        return self._now.d.copy()

    @property
    def compensation(self) -> Vector:
        """The part of d that was compensated in the last period (n,) [rad/s²]."""
        return self._compensation.copy()

    @property
    def friction(self) -> Vector:
        """The dry friction that was learned (n,) [N·m]."""
        return np.zeros(self._n) if self._friction is None else self._friction.friction

    @property
    def compensating(self) -> bool:
        """True while the compensation follows the estimate."""
        return self._on

    def compensate(self, on: bool, *, learn: bool = True, touching: bool = False) -> None:
        """Follow the estimate, or hold the compensation.

        Args:
            on: Whether to follow it.
            learn: Whether dry friction is learned meanwhile: not in contact, nor soon after one.
            touching: Whether it is followed in contact: friction is not what holds joints then.
        """
        self._learns, self._free, self._chain = learn, not touching, None
        if on is self._on:
            return
        if on:
            self._come_back()
        else:
            self._compensation = self._compensation.copy()
        self._on = on

    def close(self, chain: ClosedChain) -> None:
        """Follow the estimate, where it is held, as far as tools that hold one body may.

        Args:
            chain: How far, where the arm is now; to be told anew as it moves.
        """
        if self._chain is None:
            self._base[:] = self._compensation
            self._come_back()
        self._chain = chain
        self._shares[:] = chain.shares

    def estimate(self, reference: JointReference, q: Vector) -> tuple[JointReference, JointState]:
        """Return what the controller gets: its reference and the state, for the measured q (n,).

        The disturbance is taken from the reference's acceleration. With known delays, state and
        reference are those of the instant at which the motors get the next command. Later calls
        overwrite the arrays.
        """
        if not self._started:
            self._started, self._now.state.q[:] = True, q
        last, now = self._now, self._last
        self._last, self._now = last, now
        if self._jitter is not None:
            expected = JointState(*self._next.dot(last.whole[: 4 * self._n]).reshape(2, self._n))
            q = self._jitter.removed(q, *expected)
        last.measured[:] = q
        self._update.dot(last.whole, now.estimate)
        state, d = now.state, now.d
        if self._on:
            # Only where one joint may be beyond its bound, all are looked at.
            inside = not self._left and d.dot(d) < self._least
            self._compensation = d if inside else self._faded()
        elif self._chain is not None:
            self._compensation = self._base + self._shares @ (self._faded() - self._base)
        q_ref, v_ref, a_ref = reference
        if self._delayed:
            known = np.concatenate((now.estimate, self._pending.reshape(-1)))
            state = JointState(*self._predict.dot(known).reshape(2, self._n))
            t = self._late
            # As in `ActiveController.sampled`, v_ref is the mean of the period that has ended.
            q_ref = q_ref + t * (v_ref + 0.5 * (t + self._dt) * a_ref)
            v_ref = v_ref + t * a_ref
        return JointReference(q_ref, v_ref, a_ref - self._compensation), state

    def expect(self, arm: Arm, reference: JointReference, tau: Vector) -> None:
        """Take in the torque that is commanded now, after its inverse dynamics (n,) [N·m].

        Args:
            arm: The belief, with the inverse dynamics of this period in its scratch.
            reference: What the joints should do now.
            tau: The torque, within the limits of the motors.
        """
        if self._special:
            self._now.expected[:] = self._expected(arm, reference, tau)
        else:
            self._now.expected[:] = arm.acceleration(tau)
        if self._turned is not None:
            self._now.d += self._turned
            if not self._on:
                self._compensation += self._turned
                self._base += self._turned
        self._count -= 1
        if not self._count:
            self._count = PERIODS
            if self._friction is not None:
                self._turn(self._friction, arm, reference.q)

    def _expected(self, arm: Arm, reference: JointReference, tau: Vector) -> Vector:
        """Return the acceleration of the period that the next measurement shows (n,)."""
        if arm.has_dry_friction:
            # What friction takes does not accelerate.
            tau = tau - dry_friction_torque(arm, reference.v)
        a = arm.acceleration(tau)
        if self._delayed:
            waiting = np.vstack([self._pending, a])
            a, self._pending[:] = waiting[0], waiting[1:]
        return a

    @property
    def compiled(self) -> dict[str, Any] | None:
        """The arrays of this observer for the compiled core; None where that lacks something."""
        special: dict[str, Any] = {}
        if self._friction is not None:
            special = {"friction": self._friction.core, "periods": PERIODS}
            if self._friction.core is None:
                return None
        if self._jitter is not None:
            special |= self._jitter.compiled
        if self._delayed:
            special |= {"delay": len(self._pending), "pending": self._pending}
            special |= {"ahead": self._late, "period": self._dt}
        return {
            **special,
            **self._matrices,
            "tracked": self._tracked,
            "filter": self._filters,
            "estimate": self._kept.estimate,
            "expected": self._kept.expected,
            "least": self._least,
            "bound": self._high,
            "compensation": self._held,
            "offset": self._offset,
            "turned": self._turning,
            "base": self._base,
            "shares": self._shares,
        }

    def enter(self, c: Any, q: Vector) -> int:
        """Bring the state into `r47_control`, with the measured q (n,); return for how long."""
        if not self._started:
            self._started, self._now.state.q[:] = True, q
        if self._now is not self._kept:
            self._kept.whole[:] = self._now.whole
            self._last, self._now = self._now, self._kept
        if self._compensation is not self._held:
            self._held[:] = self._compensation
        c.on, c.observer_left, c.observer_fade = self._on, self._left, self._fade
        c.turning, c.closed = self._turned is not None, self._chain is not None
        if self._turned is not None:
            self._turning[:] = self._turned
        if self._friction is None:
            return MANY
        c.learns, c.free = self._on and self._learns, self._on and self._free
        c.until = self._count if self._chain is None else 0
        return MANY if c.until else self._count

    def leave(self, c: Any, arm: Arm, periods: int) -> None:
        """Take the state back after some periods."""
        self._left = c.observer_left
        self._compensation = self._now.d if self._on and c.follows else self._held
        if self._friction is not None and self._chain is None:
            self._count = c.until
            self._turned = self._turning.copy() if c.turning else None
            return
        self._count -= periods
        if not self._count:
            self._count = PERIODS
            if self._friction is not None:
                self._turn(self._friction, arm, self._tracked)

    def jump(self, q_ref: Vector) -> None:
        """Take in that the reference goes on from elsewhere (n,) [rad]."""
        if self._friction is not None:
            self._friction.jump(q_ref)

    def ahead(self, measured: JointState) -> JointState:
        """Return the state expected one period after the last estimate; before it, `measured`."""
        if not self._started:
            return measured
        known = self._now.whole[: 4 * self._n]
        return JointState(*self._next.dot(known).reshape(2, self._n))

    def _turn(self, friction: LearnedFriction, arm: Arm, q_ref: Vector) -> None:
        """Change the disturbance where joints reverse, and learn from it."""
        held = None
        if self._on and self._free:
            held = self._now.d
        elif self._chain is not None:
            held = self._along(self._chain, friction, arm)
        change = friction.change(arm, q_ref, held)
        # All at once, a torque that turns within a few periods would be a step.
        self._turned = None if change is None else change / PERIODS
        if self._on and self._learns:
            friction.learn(arm, self._now.d)
        elif self._chain is not None:
            friction.learn(arm, self._along(self._chain, friction, arm))

    def _along(self, chain: ClosedChain, friction: LearnedFriction, arm: Arm) -> Vector:
        """The disturbance (n,) without that by which tools press at each other."""
        expected = friction.expected(arm)
        along: Vector = expected + chain.along @ (self._now.d - expected)
        return along

    def _come_back(self) -> None:
        """Begin to follow the estimate, from what is compensated now."""
        self._left = self._fade = round(self.settings.fade / self._dt)
        self._offset[:] = self._compensation - self._bounded()

    def _faded(self) -> Vector:
        """Return what is compensated at bounds, or soon after it was held."""
        faded = self._bounded()
        if self._left:
            self._left -= 1
            x = self._left / self._fade
            faded += x * x * (3.0 - 2.0 * x) * self._offset
        return faded

    def _bounded(self) -> Vector:
        bounded: Vector = np.minimum(self._now.d, self._high)
        np.maximum(bounded, -self._high, out=bounded)
        return bounded


class _Known:
    """What is known of one period: q, v, d, the expected acceleration and the next measured q."""

    def __init__(self, n: int) -> None:
        self.whole = np.zeros(5 * n)
        self.estimate = self.whole[: 3 * n]
        q, v, self.d, self.expected, self.measured = self.whole.reshape(5, n)
        self.state = JointState(q, v)
