"""Errors of the sensors and of the lines to the robot, and the sensors that make them."""

from dataclasses import dataclass, fields
from math import exp, inf, pi, sqrt
from typing import Annotated, Any, TypeAlias

import numpy as np

from robo47_qp._core.library import Structure
from robo47_qp.arrays import Checked, Ends, Matrix, NotNegative, Range, Span, Vector, ends
from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import JointState
from robo47_qp.sim.delay import Delay, Draws

VELOCITY_CUTOFF = 50.0
"""Cut-off of the velocities that are estimated from noisy positions, if none is chosen [1/s]."""

MASS_TOLERANCE, SIZE_TOLERANCE = "mass_tolerance", "size_tolerance"
"""Figures of data sheets: by what part of nominal mass and lengths objects may be off [-]."""

Share: TypeAlias = Annotated[float, Range(at_least=0.0, below=1.0)]


@dataclass(frozen=True, kw_only=True)
class Growth:
    """How an error grows level by level where it is alone, in the unit of its option."""

    first: float
    factor: float = 2.0
    """From one level to the next; below 1 where less is worse."""
    most: float = inf
    """Where it ends."""
    beside: tuple[tuple[str, float], ...] = ()
    """Fields that it needs to be felt, and their values."""

    def levels(self, count: int) -> list[float]:
        """Return the values of the first levels, at most `count`."""
        values = [self.first * self.factor**k for k in range(count)]
        return [value for value in values if value <= self.most]


@dataclass(frozen=True)
class About:
    """Meaning of an error of the world, and its option on the command line."""

    text: str
    unit: str
    """Unit of the option."""
    option: str | None = None
    """By default the name of the field."""
    scale: float = 1
    """Value of the field if the option is 1."""
    growth: Growth | None = None
    """None where it does not say how much is wrong."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorErrors(Checked):
    """Errors of sensors and lines, the same in every episode but for what chance draws of them.

    Each field states its meaning; units of the fields are SI, those of the options are given.
    """

    noise_q: Annotated[
        NotNegative,
        About(
            "Standard deviation of measured joint positions; with it, joint velocities are "
            "differences of the measured positions behind a first-order filter, else exact",
            "rad",
            growth=Growth(first=5e-5),
        ),
    ] = 0.0
    velocity_cutoff: (
        Annotated[
            NotNegative,
            About(
                "Cut-off of that filter; where it is given, velocities are estimated without "
                "noise, too, and at 0 only positions are measured (the velocity is NaN)",
                "Hz",
            ),
        ]
        | None
    ) = None
    state_delay: Annotated[
        Span,
        Ends(at_least=0.0),
        About(
            "Time from a joint state to the controller; a range is drawn from in every "
            "control period",
            "ms",
            scale=1e-3,
            growth=Growth(first=1.0),
        ),
    ] = 0.0
    torque_delay: Annotated[
        Span,
        Ends(at_least=0.0),
        About(
            "Time from a torque command to the motors, likewise",
            "ms",
            scale=1e-3,
            growth=Growth(first=1.0),
        ),
    ] = 0.0
    noise_force: Annotated[
        NotNegative,
        About(
            "Standard deviation of the measured force at the wrist, per axis and period",
            "N",
            growth=Growth(first=0.3),
        ),
    ] = 0.0
    force_drift: Annotated[
        NotNegative,
        About(
            "Standard deviation of the drift of the measured force, per axis, which changes slowly",
            "N",
            growth=Growth(first=0.5),
        ),
    ] = 0.0
    pose_bias: Annotated[
        NotNegative,
        About(
            "Standard deviation of the camera's calibration, per axis, the same for all things "
            "and constant in an episode",
            "m",
            growth=Growth(first=1e-3),
        ),
    ] = 0.0
    rotation_bias: Annotated[
        NotNegative,
        About(
            "Standard deviation of the camera's turn about each axis through the middle of the "
            "table, likewise",
            "rad",
            growth=Growth(first=5e-3),
        ),
    ] = 0.0
    pose_noise: Annotated[
        NotNegative,
        About(
            "Standard deviation of the noise of seen coordinates", "m", growth=Growth(first=1e-3)
        ),
    ] = 0.0
    heading_noise: Annotated[
        NotNegative,
        About("Standard deviation of the noise of seen headings", "rad", growth=Growth(first=0.02)),
    ] = 0.0
    pose_noise_time: Annotated[
        NotNegative,
        About("Time constant of the noise of poses; at 0, each frame has noise of its own", "s"),
    ] = 0.0
    camera_rate: Annotated[
        float,
        Range(at_least=1e-3),
        About(
            "Frames of the camera per second; other than 30, poses are those of its last frame "
            "also where nothing else of the camera errs",
            "1/s",
        ),
    ] = 30.0
    camera_latency: Annotated[
        NotNegative,
        About("Time from a frame to its poses", "ms", scale=1e-3, growth=Growth(first=50.0)),
    ] = 0.0
    dropped_frames: Annotated[
        Share,
        About("Share of the frames that get lost", "-", growth=Growth(first=0.12, most=0.99)),
    ] = 0.0
    outliers: Annotated[
        Share,
        About(
            "Share of the measured poses that are wrong altogether",
            "-",
            growth=Growth(first=0.03, most=0.99),
        ),
    ] = 0.0
    outlier_size: Annotated[
        NotNegative, About("How far such a pose is off, in any direction", "m")
    ] = 0.03
    occlusion: Annotated[
        int,
        Range(at_least=0, at_most=1, whole=True),
        About("1: what a finger touches is hidden from the camera", "0 or 1"),
    ] = 0

    @property
    def noisy(self) -> bool:
        """True where chance decides about a measurement or a delay."""
        low, high = zip(ends(self.state_delay), ends(self.torque_delay), strict=True)
        joints_and_force = self.noise_q or self.noise_force or self.force_drift or low != high
        bias, noise = self.pose_bias or self.rotation_bias, self.pose_noise or self.heading_noise
        return bool(joints_and_force or bias or noise or self.dropped_frames or self.outliers)

    @property
    def camera_errs(self) -> bool:
        """True where a seen pose may differ from the true one."""
        bias, noise = self.pose_bias or self.rotation_bias, self.pose_noise or self.heading_noise
        late = self.camera_latency or self.dropped_frames or self.occlusion
        slow = self.camera_rate != SensorErrors.camera_rate
        return bool(bias or noise or late or slow or self.outliers)


def figures(errors: SensorErrors) -> dict[str, Any]:
    """Return the figures of sensors and lines alone, by the names of their fields."""
    return {field.name: getattr(errors, field.name) for field in fields(SensorErrors)}


class GaussMarkov:
    """A stationary Gaussian process whose correlation falls by e in a time constant.

    x' = φ x + sqrt(1 - φ²) σ w with w normal and φ = exp(-T / τ): σ is the standard deviation at
    any time (Gelb, Applied Optimal Estimation, 1974, sec. 3.8). With τ = 0 it is white noise.
    """

    def __init__(self, sigma: float, period: float, time_constant: float) -> None:
        """Set the process up.

        Args:
            sigma: Standard deviation σ.
            period: Time between two values T [s].
            time_constant: τ [s].
        """
        self._sigma = sigma
        self.keep = exp(-period / time_constant) if time_constant else 0.0
        self.new = sigma * sqrt(1.0 - self.keep**2)

    def start(self, drawn: Vector) -> Vector:
        """Return a first value (k,), made of normal numbers (k,)."""
        return self._sigma * drawn

    def advance(self, value: Vector, drawn: Vector) -> Vector:
        """Return the value (k,) that follows one."""
        return self.keep * value + self.new * drawn


class JointSensor:
    """Measures positions of the joints with noise and late, and estimates their velocities."""

    def __init__(self, errors: SensorErrors) -> None:
        """Set the sensor up; it measures nothing before `start`."""
        self._noise, self._delay = errors.noise_q, Delay(errors.state_delay)
        cutoff = errors.velocity_cutoff
        self._exact = cutoff is None and not errors.noise_q
        cutoff = VELOCITY_CUTOFF if cutoff is None else cutoff
        self._share = 1.0 - exp(-2.0 * pi * cutoff * TIMESTEP)
        self._positions_only = not cutoff
        self.ideal = self._exact and ends(errors.state_delay) == (0.0, 0.0)
        """True where it measures the true state."""
        self._q, self._v = np.zeros(0), np.zeros(0)
        self._drawn: Draws | None = None

    def start(
        self,
        state: JointState,
        rng: np.random.Generator | None,
        delays: np.random.Generator | None,
    ) -> None:
        """Begin at a state, at rest so far.

        Args:
            state: The true one.
            rng: Source of the noise, where there is noise.
            delays: Source of the delays, where they vary.
        """
        self._delay.start(np.concatenate(state), delays)
        self._drawn = None
        if rng is not None and self._noise:
            self._drawn = Draws(len(state.q), rng.standard_normal)
        self._q = self._noisy(state.q)
        self._v = np.full_like(state.v, np.nan) if self._positions_only else state.v.copy()

    def sample(self, state: JointState) -> None:
        """Measure the state of a period, of which the true one is given."""
        q, v = np.split(self._delay.sample(np.concatenate(state)), 2)
        q = self._noisy(q)
        # What is no number stays so.
        self._v[:] = (
            v if self._exact else self._v + self._share * ((q - self._q) / TIMESTEP - self._v)
        )
        self._q[:] = q

    def state(self) -> JointState:
        """Return the last measurement."""
        return JointState(self._q.copy(), self._v.copy())

    def prepare(self) -> None:
        """Have random numbers for the next periods; see `Draws`."""
        self._delay.prepare()
        if self._drawn is not None:
            self._drawn.prepare()

    def compiled(self) -> Structure:
        """Return the same for the compiled core, on the arrays of this object since `start`."""
        drawn = {} if self._drawn is None else {"drawn": self._drawn.compiled()}
        return Structure(
            "r47_joint_sensor",
            n=len(self._q),
            delay=self._delay.compiled(),
            noise=self._noise,
            exact=int(self._exact),
            share=self._share,
            period=TIMESTEP,
            q=self._q,
            v=self._v,
            **drawn,
        )

    def _noisy(self, q: Vector) -> Vector:
        if self._drawn is None:
            return q.copy()
        noisy: Vector = q + self._noise * self._drawn.next()
        return noisy


class ForceSensor:
    """Errors of the measured forces at the wrists: white noise and a slow drift of each."""

    def __init__(self, errors: SensorErrors, drift_time: float, wrists: int = 1) -> None:
        """Set the sensors up; their errors begin with `start`.

        Args:
            errors: Sizes of noise and drift.
            drift_time: Time constant of the drift [s].
            wrists: Number of sensors, which know nothing of each other.
        """
        self._noise = errors.noise_force
        self._drift = GaussMarkov(errors.force_drift, TIMESTEP, drift_time)
        self.ideal = not (errors.noise_force or errors.force_drift)
        """True where it measures the true force."""
        self._offset = np.zeros((wrists, 3))
        self.error = np.zeros((wrists, 3))
        """Errors of this period, in the world [N]."""

    def start(self, rng: np.random.Generator) -> None:
        """Begin with a drift as at any time."""
        self._drawn = Draws(2 * self.error.size, rng.standard_normal)
        drift, noise = self._next()
        self._offset[:] = self._drift.start(drift)
        self.error[:] = self._offset + self._noise * noise

    def sample(self) -> None:
        """Draw the error of the next period."""
        drift, noise = self._next()
        self._offset[:] = self._drift.advance(self._offset, drift)
        self.error[:] = self._offset + self._noise * noise

    def prepare(self) -> None:
        """Have random numbers for the next periods; see `Draws`."""
        self._drawn.prepare()

    def compiled(self) -> Structure:
        """Return the same for the compiled core, on the arrays of this object since `start`."""
        return Structure(
            "r47_force_sensor",
            n=self.error.size,
            drawn=self._drawn.compiled(),
            keep=self._drift.keep,
            fresh=self._drift.new,
            noise=self._noise,
            offset=self._offset,
            error=self.error,
        )

    def _next(self) -> Matrix:
        """Return normal numbers for the drifts and for the noise (2, wrists, 3)."""
        return self._drawn.next().reshape(2, *self.error.shape)
