"""Robot: description of an arm, its limits and its gripper."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from mink import SE3

from robo47_qp.arrays import Checked, Range, Vector, frozen_vector
from robo47_qp.errors import InvalidValueError, ModelError, UnknownNameError
from robo47_qp.model.gripper import Gripper
from robo47_qp.model.tool_poses import check_se3


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionProfile:
    """Bounds on a joint-space reference; each a vector of shape (n,)."""

    v_max: Vector
    """Largest joint speed [rad/s; m/s where the joint slides]."""
    a_max: Vector
    """Largest joint acceleration [rad/s² or m/s²]."""
    j_max: Vector
    """Largest joint jerk [rad/s³ or m/s³]."""

    def __post_init__(self) -> None:
        """Check and freeze the arrays.

        Raises:
            InvalidValueError: A bound is not positive and finite, or the lengths differ.
        """
        # Rows of different lengths have no size as numbers.
        n = np.size(np.asarray(self.v_max, dtype=object))
        for name in ("v_max", "a_max", "j_max"):
            bound = frozen_vector(name, getattr(self, name), n)
            if (bound <= 0.0).any():
                raise InvalidValueError(name, bound.tolist(), "positive in every joint")
            object.__setattr__(self, name, bound)

    @classmethod
    def uniform(cls, n: int, *, v: float, a: float, j: float) -> "MotionProfile":
        """Return a profile with the same bounds for all n joints [rad/s, rad/s², rad/s³]."""
        return cls(v_max=np.full(n, v), a_max=np.full(n, a), j_max=np.full(n, j))

    def followed_by(self, other: "MotionProfile") -> "MotionProfile":
        """Return the profile of these joints and then those of another one."""
        names = ("v_max", "a_max", "j_max")
        ends = {name: (getattr(self, name), getattr(other, name)) for name in names}
        return MotionProfile(**{name: np.concatenate(pair) for name, pair in ends.items()})

    def check_joints(self, n: int) -> None:
        """Check that the bounds are those of n joints.

        Raises:
            InvalidValueError: They are not.
        """
        if len(self.v_max) != n:
            found = f"bounds of {len(self.v_max)} joints"
            raise InvalidValueError("profile", found, f"those of all {n} joints")

    def slowed(self, pace: float) -> "MotionProfile":
        """Return the profile with time stretched by 1 / `pace`.

        Raises:
            InvalidValueError: `pace` is outside (0, 1].
        """
        Range(above=0.0, at_most=1.0).check("pace", pace)
        return MotionProfile(
            v_max=self.v_max * pace, a_max=self.a_max * pace**2, j_max=self.j_max * pace**3
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class ToolFrame:
    """A tool frame on a body of the MJCF, which has no site for it."""

    body: str
    """Body that carries the tool."""
    T_body_tcp: SE3 = field(default_factory=SE3.identity)
    """Pose in the frame of the body; z points out of the tool."""

    def __post_init__(self) -> None:
        """Check the pose.

        Raises:
            InvalidValueError: It is none.
        """
        check_se3(f"tool frame on {self.body!r}", self.T_body_tcp)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tool:
    """A tool of a robot: its frame, and its gripper where it has one."""

    name: str
    """By which targets and commands address it."""
    tcp: str
    """Site that is the tool frame: z points out of the tool."""
    gripper: Gripper | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Hand(Checked):
    """A hand with a file of its own, fixed to a site of the arm's file."""

    mjcf: Path
    """MJCF file of the hand; `PREFIX` is put before all its names."""
    site: str
    """Site of the arm's file where the origin of the hand's file goes."""
    gripper: Gripper
    """Its gripper, with the names of its file."""
    turn: Annotated[float, Range()] = 0.0
    """Angle by which it is turned about the z axis of the site [rad]."""
    PREFIX: ClassVar[str] = "hand_"

    def _label(self, field: str) -> str:
        return f"hand {field}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Mount:
    """A copy of the MJCF as a part of a larger robot."""

    prefix: str
    """What is put before every name of the file."""
    T_world_base: SE3
    """Where the origin of the file goes."""

    def __post_init__(self) -> None:
        """Check the pose.

        Raises:
            InvalidValueError: It is none.
        """
        check_se3(f"T_world_base of mount {self.prefix!r}", self.T_world_base)


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """Describes an arm with n joints: its model and its limits, no state.

    A robot of several arms is one `Robot` with several tools.

    Units are those of hinges; for a sliding joint read m for rad and N for N·m.
    """

    name: str
    mjcf: Path
    """MJCF file, with the robot's base at its pose in the world."""
    hand: Hand | None = None
    """Hand that is added to the file; None where the file has it, or there is none."""
    T_world_base: SE3 | None = None
    """Where the origin of the file stands in the world; None leaves it at the world's."""
    mounts: tuple[Mount, ...] = ()
    """Copies of the file that make up the robot; none takes the file itself once."""
    joints: tuple[str, ...]
    """The n arm joints, base to tip; of several arms one after the other."""
    slides: tuple[str, ...] = ()
    """The sliding joints among them; all others are hinges."""
    motors: tuple[str, ...]
    """Torque motors, in the order of `joints`."""
    has_motors: bool = True
    """True where the file has the motors; else motors limited to `tau_max` replace the actuators
    that it has for the joints."""
    tcp: str
    """Site that is the tool frame: z points out of the tool."""
    tool: ToolFrame | None = None
    """Frame at which the site `tcp` is added; None where the file has the site."""
    home: Vector
    """Rest configuration (n,) [rad]."""
    rated: MotionProfile
    """Limits of the manufacturer."""
    profile: MotionProfile
    """Limits of motions by default."""
    tau_max: Vector
    """Torque limits (n,) [N·m]."""
    tau_rate_max: Vector
    """Torque-rate limits (n,) [N·m/s]."""
    stiffness: Vector
    """Joint impedance stiffness used by default (n,) [N·m/rad]."""
    neighbours_apart: bool = False
    """True where the joint ranges keep neighbouring links apart: then their shapes, which may be
    larger than the links, are not compared."""
    armature: Vector | None = None
    """Inertia of the rotors as the joints feel it (n,) [kg·m²]; None takes that of the file."""
    damping: Vector | None = None
    """Viscous friction of the joints (n,) [N·m s/rad]; None takes that of the file."""
    dry_friction: Vector | None = None
    """Dry friction that observers expect of the joints before they have learned of it (n,) [N·m];
    None is none."""
    gripper: Gripper | None = None
    """None where it has none or it stays unused: all joints except the arm's are then welded."""
    tool_name: str = "tool"
    """Name of the main tool, which `tcp` and `gripper` describe."""
    more_tools: tuple[Tool, ...] = ()
    """Further tools; each has joints of its own behind the joints that it shares."""
    menagerie: str | None = None
    """Directory and file of the same robot in MuJoCo Menagerie, for its meshes."""

    def __post_init__(self) -> None:
        """Check the fields and freeze the arrays.

        Raises:
            InvalidValueError: A field has the wrong length, is not finite or has the wrong sign.
            ModelError: The MJCF file does not exist.
        """
        n = len(self.joints)
        if not n:
            raise InvalidValueError("joints", self.joints, "one name or more")
        for name in ("home", "tau_max", "tau_rate_max", "stiffness"):
            object.__setattr__(self, name, frozen_vector(name, getattr(self, name), n))
        for name in ("tau_max", "tau_rate_max", "stiffness"):
            Range(above=0.0).check(name, getattr(self, name))
        for name in ("armature", "damping", "dry_friction"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen_vector(name, getattr(self, name), n))
                Range(at_least=0.0).check(name, getattr(self, name))
        if self.T_world_base is not None:
            check_se3("T_world_base", self.T_world_base)
        for name, profile in (("rated", self.rated), ("profile", self.profile)):
            frozen_vector(f"{name}.v_max", profile.v_max, n)
        names = [tool.name for tool in self.tools]
        if len(set(names)) != len(names):
            raise InvalidValueError("names of tools", names, "different names")
        if len(self.motors) != n:
            raise InvalidValueError("motors", self.motors, f"{n} names, one per joint")
        if not set(self.slides) <= set(self.joints):
            raise InvalidValueError("slides", self.slides, f"some of the joints {self.joints}")
        for file in (self.mjcf, *(() if self.hand is None else (self.hand.mjcf,))):
            if not file.is_file():
                raise ModelError(f"Robot {self.name!r} needs the model {file}: no such file.")

    @cached_property
    def tools(self) -> tuple[Tool, ...]:
        """All tools, the main one first."""
        main = Tool(name=self.tool_name, tcp=self.tcp, gripper=self.gripper)
        return (main, *self.more_tools)

    @property
    def grippers(self) -> tuple[Gripper, ...]:
        """The grippers of all tools that have one."""
        return tuple(tool.gripper for tool in self.tools if tool.gripper is not None)

    def tool_index(self, name: str) -> int:
        """Return the place of a tool in `tools`.

        Raises:
            UnknownNameError: No tool has this name.
        """
        names = [tool.name for tool in self.tools]
        if name not in names:
            raise UnknownNameError("tool", name, names)
        return names.index(name)

    def tool_labels(self) -> Iterator[tuple[str, Tool]]:
        """Yield what signals of each tool begin with, and the tool: nothing for the main one."""
        for i, tool in enumerate(self.tools):
            yield (f"{tool.name}_" if i else "", tool)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each joint's position."""
        return tuple("m" if joint in self.slides else "rad" for joint in self.joints)

    def unit(self, turning: str, sliding: str) -> str:
        """Return the unit of a quantity of all joints: both, where some turn and some slide."""
        if not self.slides:
            return turning
        return sliding if len(self.slides) == len(self.joints) else f"{turning} or {sliding}"
