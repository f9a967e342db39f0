"""Rows of a recording as columns of one Rerun entity.

All signals share one entity: every further entity would cost 24 bytes per row for row ids and
times, a quarter of the file.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
import rerun as rr

from robo47_qp.arrays import Matrix
from robo47_qp.errors import RecordingError
from robo47_qp.model.robot import Robot
from robo47_qp.run.recording import Rows
from robo47_qp.sim.signal import Signal

_column, _FrameIds = rr.ComponentColumn, rr.components.TransformFrameIdBatch
_QUATERNION = ("qw", "qx", "qy", "qz")


class SignalColumn:
    """Converts a signal to a column: signal "joints/q" becomes component "joints:q"."""

    def __init__(self, signal: Signal) -> None:
        """Prepare the descriptor of the column."""
        self._name, self._width = signal.name, len(signal.labels)
        self._descriptor = _descriptor(signal.name)

    def of(self, rows: Rows) -> rr.ComponentColumn:
        """Return the column: a list of numbers per row."""
        return _lists(self._descriptor, rows[self._name])


def xyzw(wxyz: Matrix) -> Matrix:
    """Return quaternions wxyz (..., 4) in Rerun's order."""
    return np.roll(wxyz, -1, axis=-1)


def component(signal: str) -> str:
    """Return the name of the component that holds a signal."""
    return signal.replace("/", ":", 1)


def limit_columns(model: mujoco.MjModel, robot: Robot) -> list[rr.ComponentColumn]:
    """Return columns of two equal rows with the limits of all joints, the lower ones first.

    A joint that turns freely has none: NaN is not drawn.
    """
    joints = [model.joint(name).id for name in robot.joints]
    ranges = np.where(model.jnt_limited[joints, None], model.jnt_range[joints], np.nan)
    v_max, tau_max = robot.rated.v_max, robot.tau_max
    bounds = {
        "limits/q": ranges.T.ravel(),
        "limits/v": np.concatenate((-v_max, v_max)),
        "limits/tau": np.concatenate((-tau_max, tau_max)),
    }
    return [_lists(_descriptor(name), np.tile(bound, (2, 1))) for name, bound in bounds.items()]


class PoseColumns:
    """Converts the poses of several frames to columns: one row per frame and instant."""

    def __init__(self, frames: Sequence[str], parent: str) -> None:
        """Set the names of the frames, and of the frame in which their poses are given."""
        self._frames, self._parent = list(frames), parent
        self._names: dict[int, list[rr.ComponentColumn]] = {}

    def of(self, positions: Matrix, quaternions: Matrix) -> list[rr.ComponentColumn]:
        """Return columns of positions (N, frames, 3) [m] and quaternions wxyz (N, frames, 4)."""
        count = len(positions)
        if count not in self._names:
            children = self._frames * count
            parents = [self._parent] * len(children)
            self._names[count] = [
                _column(rr.Transform3D.descriptor_child_frame(), _FrameIds(children)),
                _column(rr.Transform3D.descriptor_parent_frame(), _FrameIds(parents)),
            ]
        translations = rr.components.Translation3DBatch(positions.reshape(-1, 3))
        rotations = rr.components.RotationQuatBatch(xyzw(quaternions).reshape(-1, 4))
        return [
            _column(rr.Transform3D.descriptor_translation(), translations),
            _column(rr.Transform3D.descriptor_quaternion(), rotations),
            *self._names[count],
        ]


def check_rows(rows: Rows) -> None:
    """Reject values that Rerun would accept without a warning and then not show.

    Raises:
        RecordingError: A value is NaN or infinite, or a quaternion has no unit length.
    """
    if not np.isfinite(rows.values).all():
        for signal in rows.signals:
            bad = np.argwhere(~np.isfinite(rows[signal.name]))
            if bad.size:
                row, column = (int(index) for index in bad[0])
                label, value = signal.labels[column], rows[signal.name][row, column]
                raise _refused(signal.name, rows["time"][row], f"its {label} is {value}")
    for signal in rows.signals:
        if signal.labels[-4:] == _QUATERNION:
            q = rows[signal.name][:, -4:]
            off = np.abs(np.einsum("ij,ij->i", q, q) - 1.0) > 1e-6
            if off.any():
                row = int(off.argmax())
                length = float(np.linalg.norm(q[row]))
                fault = f"its quaternion has length {length:.6g} instead of 1"
                raise _refused(signal.name, rows["time"][row], fault)


def _refused(signal: str, time: Matrix, fault: str) -> RecordingError:
    return RecordingError(
        f"Signal {signal!r} cannot be recorded at {time.item():.3f} s: {fault}. "
        "Look for the first wrong value in what computes it."
    )


def _descriptor(signal: str) -> rr.ComponentDescriptor:
    return rr.ComponentDescriptor(
        component(signal),
        archetype=signal.partition("/")[0],
        component_type="rerun.components.Scalar",
    )


def _lists(descriptor: rr.ComponentDescriptor, values: Matrix) -> rr.ComponentColumn:
    rows, width = values.shape
    offsets = np.arange(0, rows * width + 1, width, dtype=np.int32)
    batch = rr.components.ScalarBatch(np.ravel(values))
    return rr.ComponentColumn(descriptor, batch, offsets=offsets)
