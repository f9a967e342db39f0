"""The signals that a run records, and how each is computed.

A row has, in this order: time and phase; the references for t_k; the state at t_k; the command at
t_k; the effects from t_k to t_k+1; what is derived from these. The simulation defines state and
effects (`Simulation.signals_now`, `signals_last`). Each signal is one entry of its group.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TypeAlias

import numpy as np

from robo47_qp._core.library import Structure, backend, functions, pointer
from robo47_qp._core.mujoco_functions import dynamics, function
from robo47_qp.arrays import Matrix, contiguous
from robo47_qp.ik.stream.settings import Event
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import Robot
from robo47_qp.run.recording import Rows, slices
from robo47_qp.sim.signal import POSE, POSE_UNIT, Signal
from robo47_qp.sim.simulation import Simulation

_ROUNDING = 1e-9
"""Part of a motor's limit by which a torque at it may be less."""

Samples: TypeAlias = tuple[Matrix, Matrix, Matrix]
"""q, v and a of the samples of a trajectory, (N, n) each."""
TARGET_POSE = "target/pose"
"""The signal of a target that is followed."""


def references(robot: Robot) -> dict[Signal, Callable[[Arm, Samples], Matrix]]:
    """Return the reference signals, with functions of samples (N, size)."""
    joints, unit = robot.joints, robot.unit
    return {
        Signal(name="joints/q_ref", labels=joints, unit=unit("rad", "m")): lambda _, s: s[0],
        Signal(name="joints/v_ref", labels=joints, unit=unit("rad/s", "m/s")): lambda _, s: s[1],
        Signal(name="joints/a_ref", labels=joints, unit=unit("rad/s²", "m/s²")): lambda _, s: s[2],
        Signal(name="joints/tau_ref", labels=joints, unit=unit("N·m", "N")): _torques,
        **{
            Signal(name=f"tool/{label}pose_ref", labels=POSE, unit=POSE_UNIT): partial(_poses, i)
            for i, (label, _) in enumerate(robot.tool_labels())
        },
    }


def reference_rows(arm: Arm, samples: Samples) -> Matrix:
    """Return the columns `references` of samples (N, columns).

    Raises:
        InvalidValueError: The samples are of another size.
    """
    q, v, a = (contiguous("a sample", x, len(samples[0]), arm.n) for x in samples)
    samples = q, v, a
    if backend() == "numpy":
        return np.hstack([values(arm, samples) for values in references(arm.robot).values()])
    return arm.derived(_CompiledReferences).rows(samples)


def command(robot: Robot) -> Signal:
    """Return the signal of the controller's command, before the limits of the motors."""
    return Signal(name="joints/tau_command", labels=robot.joints, unit=robot.unit("N·m", "N"))


def derived(robot: Robot) -> dict[Signal, Callable[[Rows], Matrix]]:
    """Return the signals that follow from others, with functions of rows (N, size)."""
    found: dict[Signal, Callable[[Rows], Matrix]] = {
        Signal(name="errors/q", labels=robot.joints, unit=robot.unit("rad", "m")): lambda rows: (
            rows["joints/q_ref"] - rows["joints/q"]
        ),
        **{
            signal: values
            for label, _ in robot.tool_labels()
            for signal, values in _tool_errors(label).items()
        },
        Signal(name="joints/saturated", labels=("motors",), unit="count"): lambda rows: (
            np.abs(rows["joints/tau"]) >= robot.tau_max * (1.0 - _ROUNDING)
        ).sum(axis=1, keepdims=True),
    }
    for label, tool in robot.tool_labels():
        if tool.gripper is not None:
            found |= _grip(label, tool.gripper.fingers)
    return found


def _tool_errors(label: str) -> dict[Signal, Callable[[Rows], Matrix]]:
    """Return the signals of the errors of a tool, with functions of rows."""

    def poses(rows: Rows) -> tuple[Matrix, Matrix]:
        return rows[f"tool/{label}pose_ref"], rows[f"tool/{label}pose"]

    def distance(rows: Rows) -> Matrix:
        reference, measured = poses(rows)
        return _size(reference[:, :3] - measured[:, :3])

    def angle(rows: Rows) -> Matrix:
        reference, measured = poses(rows)
        return angle_between(reference[:, 3:], measured[:, 3:])

    return {
        Signal(name=f"errors/{label}tool_position", labels=("distance",), unit="m"): distance,
        Signal(name=f"errors/{label}tool_angle", labels=("angle",), unit="rad"): angle,
    }


def _grip(label: str, fingers: tuple[str, str]) -> dict[Signal, Callable[[Rows], Matrix]]:
    """Return the signals of width and force of a gripper, with functions of rows."""

    def width(rows: Rows) -> Matrix:
        total: Matrix = rows[f"gripper/{label}fingers"].sum(axis=1, keepdims=True)
        return total

    def force(rows: Rows) -> Matrix:
        return np.hstack([_size(rows[f"gripper/{finger}_contact"]) for finger in fingers])

    return {
        Signal(name=f"gripper/{label}width", labels=("width",), unit="m"): width,
        Signal(name=f"gripper/{label}force", labels=fingers, unit="N"): force,
    }


def followed() -> tuple[Signal, ...]:
    """Return the signals of a run that follows a target: where it is, and what the stream told."""
    events = tuple(event.name.lower() for event in Event)
    return (
        Signal(name=TARGET_POSE, labels=POSE, unit=POSE_UNIT),
        Signal(name="target/events", labels=events, unit="count"),
    )


def followed_errors() -> dict[Signal, Callable[[Rows], Matrix]]:
    """Return how far the tool is from the target, with functions of rows (N, 1)."""
    return {
        Signal(name="target/position_error", labels=("distance",), unit="m"): lambda rows: _size(
            rows[TARGET_POSE][:, :3] - rows["tool/pose"][:, :3]
        ),
        Signal(name="target/angle_error", labels=("angle",), unit="rad"): lambda rows: (
            angle_between(rows[TARGET_POSE][:, 3:], rows["tool/pose"][:, 3:])
        ),
    }


def is_followed(signals: Iterable[Signal]) -> bool:
    """Return whether these are signals of a run that follows a target."""
    return any(signal.name == TARGET_POSE for signal in signals)


def all_signals(simulation: Simulation, extra: Sequence[Signal] = ()) -> tuple[Signal, ...]:
    """Return every signal of a run, in the order of its columns.

    Args:
        simulation: Its world.
        extra: Signals that are written besides: none, or those of `followed`.
    """
    robot = simulation.robot
    return (
        Signal(name="time", labels=("t",), unit="s", shown=False),
        Signal(name="phase", labels=("index",), unit="count", shown=False),
        *references(robot),
        *simulation.signals_now,
        command(robot),
        *simulation.signals_last,
        *derived(robot),
        *extra,
        *(followed_errors() if is_followed(extra) else ()),
    )


def derive(rows: Rows, robot: Robot) -> None:
    """Fill the derived columns of rows whose other columns are filled."""
    found = derived(robot)
    if is_followed(rows.signals):
        found |= followed_errors()
    for signal, values in found.items():
        rows[signal.name][:] = values(rows)


class Columns:
    """The columns of the groups of signals in a row."""

    def __init__(self, simulation: Simulation, extra: Sequence[Signal] = ()) -> None:
        """Look them up; `extra` is as in `all_signals`."""
        found = slices(all_signals(simulation, extra))

        def span(group: Iterable[Signal]) -> slice:
            spans = [found[signal.name] for signal in group]
            return slice(spans[0].start, spans[-1].stop)

        self.references = span(references(simulation.robot))
        self.now, self.last = span(simulation.signals_now), span(simulation.signals_last)
        self.command = span([command(simulation.robot)])
        self.extra = span(extra) if extra else slice(0, 0)
        self._found = found

    def of(self, rows: Matrix, name: str) -> Matrix:
        """Return the columns of a signal in some rows (N, size)."""
        return rows[:, self._found[name]]


class _CompiledReferences:
    """The same columns in the compiled core, with one evaluation of a sample for all of them."""

    def __init__(self, arm: Arm) -> None:
        d, sites = arm.scratch, arm.tool_sites
        self._arm, self._columns = arm, 4 * arm.n + 7 * len(sites)
        self._structure = Structure(
            "r47_references",
            arm=dynamics(arm.model, d),
            quaternion=function("mju_mat2Quat"),
            tools=len(sites),
            site=np.array(sites, dtype=np.int32),
            xpos=d.site_xpos,
            xmat=d.site_xmat,
        )

    def rows(self, samples: Samples) -> Matrix:
        rows = np.empty((len(samples[0]), self._columns))
        functions().r47_reference_rows(
            self._structure.pointer, len(rows), *map(pointer, samples), pointer(rows)
        )
        self._arm.evaluated = True
        return rows


def _torques(arm: Arm, samples: Samples) -> Matrix:
    return np.array([arm.inverse_dynamics(q, v, a) for q, v, a in zip(*samples, strict=True)])


def _poses(tool: int, arm: Arm, samples: Samples) -> Matrix:
    poses = np.array([arm.pose(q, tool).wxyz_xyz for q in samples[0]])
    return np.hstack([poses[:, 4:], poses[:, :4]])


def _size(vectors: Matrix) -> Matrix:
    """Return the length of each row (N, 1)."""
    size: Matrix = np.linalg.norm(vectors, axis=1, keepdims=True)
    return size


def angle_between(a: Matrix, b: Matrix) -> Matrix:
    """Return the angle between the rotations of unit quaternions (N, 4), accurate near 0 (N, 1)."""
    # |a ∓ b| = 2 sin(angle/4): unlike arccos of the dot product, exact for small angles.
    chord = np.minimum(_size(a - b), _size(a + b))
    angle: Matrix = 4.0 * np.arcsin(np.clip(chord / 2.0, 0.0, 1.0))
    return angle
