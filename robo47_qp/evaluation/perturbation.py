"""Perturbation: how much the world of an episode may differ from the controller's models."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from robo47_qp.arrays import Ends, Matrix, NotNegative, Range, Span, Vector, ends
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.sim.disturbance import Disturbance
from robo47_qp.sim.push import Push
from robo47_qp.sim.sensing import About, Growth, SensorErrors

PUSHES = 3
"""Pushes that are drawn for every episode, used or not."""
LARGEST, LONGEST = 1e6, 10.0
"""Largest size of a perturbation in its SI unit, and of a delay in seconds: far beyond what an arm
can stand, and what MuJoCo can still integrate."""
LINKS, JOINTS, OBJECTS = 64, 32, 16
"""Bodies and joints of a robot, and free objects, that errors are drawn for, used or not."""


@dataclass(frozen=True, kw_only=True)
class Perturbation(SensorErrors):
    """Ranges that the disturbance of an episode is drawn from; by default nothing is perturbed.

    Each field states its range and meaning; units are SI. A `Span` is one value for every
    episode and every link or joint, or the range that each one's value is drawn from.
    """

    link_mass: Annotated[
        Span,
        Ends(above=-1.0),
        About("Mass of every link, heavier by this part", "-", growth=Growth(first=0.05)),
    ] = 0.0
    link_inertia: Annotated[
        Span,
        Ends(above=-1.0),
        About(
            "Moments of inertia of every link, larger by this part than its mass says",
            "-",
            growth=Growth(first=0.2),
        ),
    ] = 0.0
    link_com: Annotated[
        NotNegative,
        About(
            "Centre of mass of every link, off by at most this along each axis",
            "m",
            growth=Growth(first=5e-3),
        ),
    ] = 0.0
    joint_friction: Annotated[
        Span,
        Ends(at_least=0.0),
        About(
            "Dry friction of the joints 1 to 4, of those that turn",
            "N·m",
            growth=Growth(first=0.25),
        ),
    ] = 0.0
    wrist_friction: Annotated[
        NotNegative, About("Dry friction of the other joints, relative to that of 1 to 4", "-")
    ] = 0.6
    joint_damping: Annotated[
        Span,
        Ends(at_least=-1.0),
        About("Viscous friction of every joint, more by this part", "-", growth=Growth(first=0.5)),
    ] = 0.0
    armature: Annotated[
        Span,
        Ends(above=-1.0),
        About("Inertia of every joint's drive, larger by this part", "-", growth=Growth(first=0.5)),
    ] = 0.0
    payload_error: Annotated[
        Span,
        Ends(above=-1.0),
        About(
            "Weight of what is carried, told to the controller as more by this part",
            "-",
            growth=Growth(first=0.5),
        ),
    ] = 0.0
    object_mass: Annotated[
        Span,
        Ends(above=-1.0),
        About(
            "Mass of every free object, more by this part", "-", "mass", growth=Growth(first=0.5)
        ),
    ] = 0.0
    object_com: Annotated[
        NotNegative,
        About(
            "Centre of mass of every free object, off by at most this along each axis, but "
            "within the object",
            "m",
            growth=Growth(first=5e-3),
        ),
    ] = 0.0
    object_size: Annotated[
        Span,
        Ends(at_least=-0.9),
        About("Lengths of every free object, more by this part", "-", growth=Growth(first=0.02)),
    ] = 0.0
    friction: (
        Annotated[
            Span,
            Ends(at_least=0.0),
            About(
                "Coefficient of sliding friction µ of all contacts, in place of the models'",
                "-",
                growth=Growth(first=0.6, factor=2**-0.5),
            ),
        ]
        | None
    ) = None
    pushes: Annotated[
        int,
        Range(at_least=0, at_most=PUSHES, whole=True),
        About("Pushes on the tool in an episode", "count"),
    ] = 0
    push_force: Annotated[
        NotNegative,
        About(
            "Force of a push at most, in any direction",
            "N",
            growth=Growth(first=5.0, beside=(("pushes", 2),)),
        ),
    ] = 0.0
    push_time: (
        Annotated[
            NotNegative,
            About("Latest start of a push, in place of the time that the task usually takes", "s"),
        ]
        | None
    ) = None

    def __post_init__(self) -> None:
        """Check every field.

        Raises:
            InvalidValueError: A value breaks the rule of its field, or is beyond all measure.
        """
        super().__post_init__()
        for name, _, about in options().values():
            value, late = getattr(self, name), about.unit == "ms"
            most = LONGEST if late else LARGEST
            if value is not None and max(map(abs, ends(value))) > most:
                unit = {"-": "", "ms": " s"}.get(about.unit, f" {about.unit}")
                raise InvalidValueError(name, value, f"at most {most:g}{unit}")

    def draw(self, rng: np.random.Generator, usual_time: float = 30.0) -> Disturbance:
        """Return the disturbance of one episode.

        The same random numbers are drawn for any ranges, so that episodes with the same seed
        differ in the chosen perturbations only. Fields with the name of one of `Disturbance` are
        passed on.

        Args:
            rng: Generator of the episode.
            usual_time: `Task.usual_time`, within which pushes begin unless `push_time` is given
                [s].
        """
        pushed_for = usual_time if self.push_time is None else self.push_time
        friction = rng.random()
        directions, sizes = rng.standard_normal((PUSHES, 3)), rng.uniform(0.0, 1.0, PUSHES)
        starts = rng.uniform(0.0, 1.0, PUSHES)
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        links, joints, told = rng.random((5, LINKS)), rng.random((3, JOINTS)), rng.random()
        objects = rng.random((5, OBJECTS))
        passed_on = {f.name for f in fields(self)} & {f.name for f in fields(Disturbance)}
        return Disturbance(
            **{name: getattr(self, name) for name in passed_on - {"pushes", "friction"}},
            link_mass_factor=1.0 + _drawn(self.link_mass, links[0]),
            link_inertia_factor=1.0 + _drawn(self.link_inertia, links[1]),
            link_com_shift=_around(self.link_com, links[2:]),
            dry_friction=_drawn(self.joint_friction, joints[0]),
            damping_factor=1.0 + _drawn(self.joint_damping, joints[1]),
            armature_factor=1.0 + _drawn(self.armature, joints[2]),
            payload_factor=1.0 + float(_drawn(self.payload_error, told)),
            object_mass_factor=1.0 + _drawn(self.object_mass, objects[0]),
            mass_tolerance=max(map(abs, ends(self.object_mass))) or None,
            object_size_factor=1.0 + _drawn(self.object_size, objects[1]),
            size_tolerance=max(map(abs, ends(self.object_size))) or None,
            object_com_shift=_around(self.object_com, objects[2:]),
            friction=None if self.friction is None else float(_drawn(self.friction, friction)),
            pushes=tuple(
                Push(force=self.push_force * sizes[i] * directions[i], start=float(start))
                for i, start in enumerate(pushed_for * starts[: self.pushes])
            ),
        )

    def with_options(self, chosen: Mapping[str, float | str]) -> "Perturbation":
        """Return the perturbation with some values replaced, by the names of their options.

        A range is written with a colon, as "-0.05:0.05".

        Raises:
            InvalidValueError: A value is out of range, or neither number nor range; or pushes are
                chosen without a force, or a force without pushes.
            UnknownNameError: There is no such option.
        """
        known = options()
        for option in chosen:
            if option not in known:
                raise UnknownNameError("perturbation", option, known)
        values: dict[str, Any] = {
            known[option][0]: _scaled(_label(option), value, known[option][2].scale)
            for option, value in chosen.items()
        }
        try:
            changed = replace(self, **values)
        except InvalidValueError as error:
            option = next(name for name in chosen if known[name][0] == error.name)
            raise InvalidValueError(_label(option), chosen[option], error.expected) from error
        for given, other in (("pushes", "push_force"), ("push_force", "pushes")):
            if values.get(given) and other not in values and not getattr(changed, other):
                expected = f"given, too, with {_label(given)} {chosen[given]}"
                raise InvalidValueError(_label(other), getattr(changed, other), expected)
        return changed


@cache
def options() -> dict[str, tuple[str, type, About]]:
    """Return field, type and meaning of every perturbation by the name of its option.

    The type of a `Span` is `str`.
    """
    found = {}
    for name, hint in get_type_hints(Perturbation, include_extras=True).items():
        hints = (hint, *get_args(hint))
        stated = next(one for one in hints if get_origin(one) is Annotated)
        about = next(one for one in stated.__metadata__ if isinstance(one, About))
        kind = stated.__origin__
        found[about.option or name] = (name, kind if isinstance(kind, type) else str, about)
    return found


def _label(option: str) -> str:
    return f"--{option.replace('_', '-')}"


def _scaled(label: str, value: float | str, scale: float) -> Span:
    """Return the value of an option in SI units."""
    if not isinstance(value, str):
        return value * scale
    try:
        numbers = [float(part) * scale for part in value.split(":")]
    except ValueError as error:
        expected = "a number, or a range such as 0.1:0.2"
        raise InvalidValueError(label, value, expected) from error
    return numbers[0] if len(numbers) == 1 else tuple(numbers)  # type: ignore[return-value]


def _drawn(span: Span, chance: Vector | float) -> Vector | float:
    """Return values in a span by numbers between 0 and 1; one value if the span is a number."""
    low, high = ends(span)
    return low if low == high else low + (high - low) * chance


def _around(most: float, chance: Matrix) -> ArrayLike:
    """Return points (k, 3) off by at most this along each axis, by numbers from 0 to 1 (3, k)."""
    return most * (2.0 * chance.T - 1.0) if most else (0.0, 0.0, 0.0)


_MODERATE = Perturbation(
    link_mass=(-0.05, 0.05),
    link_com=5e-3,
    link_inertia=(-0.1, 0.1),
    joint_friction=(0.2, 0.6),
    wrist_friction=0.5,
    joint_damping=(-0.3, 0.3),
    noise_q=5e-5,
    noise_force=0.3,
    force_drift=1.0,
    state_delay=(0.5e-3, 1e-3),
    torque_delay=(0.5e-3, 1e-3),
    pose_bias=2e-3,
    rotation_bias=float(np.radians(0.5)),
    pose_noise=2e-3,
    pose_noise_time=0.3,
    heading_noise=float(np.radians(2.0)),
    camera_latency=0.05,
    dropped_frames=0.05,
    outliers=0.01,
    outlier_size=0.03,
    object_mass=(-0.3, 0.3),
    object_com=0.01,
    friction=(0.3, 0.9),
)
PRESETS: Mapping[str, Perturbation] = {
    "none": Perturbation(),
    "moderate": _MODERATE,
    "severe": replace(
        _MODERATE,
        link_mass=(-0.1, 0.1),
        link_com=10e-3,
        link_inertia=(-0.2, 0.2),
        joint_friction=(0.4, 1.2),
        joint_damping=(-0.6, 0.6),
        armature=(-0.2, 0.2),
        payload_error=(-0.2, 0.2),
        noise_q=1e-4,
        state_delay=(1e-3, 2e-3),
        torque_delay=(1e-3, 2e-3),
        pose_bias=4e-3,
        rotation_bias=float(np.radians(1.0)),
        pose_noise=4e-3,
        heading_noise=float(np.radians(5.0)),
        object_mass=(-0.6, 0.6),
        friction=(0.2, 0.9),
        pushes=2,
        push_force=10.0,
    ),
}
"""Named levels: moderate is how wrong we take a calibrated cell to be, severe about twice that, and
pushed. The delays of state and torque together are 1 to 2 ms, and 2 to 4 ms."""


def perturbation_table() -> str:
    """Return the table of all perturbations and levels in Markdown, in the units of the options."""
    levels = [PRESETS[name] for name in ("moderate", "severe")]
    lines = ["| option | meaning | moderate | severe |", "|---|---|---|---|"]
    for option, (name, _, about) in options().items():
        cells = [_told(getattr(level, name), about.scale) for level in levels]
        unit = "" if about.unit == "-" else f" [{about.unit}]"
        lines.append(f"| `{_label(option)}`{unit} | {about.text} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _told(value: Span | None, scale: float) -> str:
    """Return a value as an option has it."""
    if value is None:
        return "–"
    low, high = (end / scale for end in ends(value))
    if low == high:
        return f"{low:.3g}"
    return f"±{high:.3g}" if low == -high else f"{low:.3g} to {high:.3g}"
