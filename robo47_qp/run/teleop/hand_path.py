"""HandPath: poses over time, relative to where the tool is when it starts."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from mink import SE3, SO3
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError, RecordingError

COLUMNS = "t,x,y,z,rx,ry,rz"
"""First line of a file after its comments: time [s], displacement [m] and rotation vector [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HandPath:
    """A path through poses at given times, at rest at both ends, smooth in between.

    Displacements and rotation vectors are relative to the pose at the start, along and about the
    axes of the world, so one path suits every robot.
    """

    times: Vector
    """Instants (N,), from 0 on, increasing [s]."""
    displacements: Matrix
    """Where the target is then, from the start (N, 3) [m]."""
    turns: Matrix
    """How it is turned then, as rotation vectors (N, 3) [rad]."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: There are fewer than two poses, a number is not finite, or the
                times do not increase from 0.
        """
        rows = np.column_stack([self.times, self.displacements, self.turns])
        if len(rows) < 2 or not np.isfinite(rows).all():
            expected = "at least two poses in finite numbers"
            raise InvalidValueError("hand path", f"{len(rows)} poses, {_faulty(rows)}", expected)
        if self.times[0] != 0.0 or (np.diff(self.times) <= 0.0).any():
            raise InvalidValueError("times of a hand path", "others", "increasing from 0 s")

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return float(self.times[-1])

    def poses(self, instants: ArrayLike, T_world_start: SE3) -> list[SE3]:
        """Return T_world_target at instants (N,) [s]; it stays at its ends before and after."""
        within = np.clip(np.asarray(instants, dtype=np.float64), 0.0, self.duration)
        start, p = T_world_start.rotation(), T_world_start.translation()
        return [
            SE3.from_rotation_and_translation(SO3.exp(row[3:]) @ start, p + row[:3])
            for row in self._spline(within)
        ]

    @cached_property
    def _spline(self) -> CubicSpline:
        rows = np.column_stack([self.displacements, self.turns])
        return CubicSpline(self.times, rows, bc_type="clamped")


def read_hand_path(path: Path) -> HandPath:
    """Read a hand path from a file: lines of comments with #, `COLUMNS`, then a line per pose.

    Raises:
        RecordingError: There is no such file, or it is not such a table.
        InvalidValueError: Its numbers make no path; see `HandPath`.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise RecordingError(
            f"{path} cannot be read: {reason}. A hand path is a text file with a line "
            f"{COLUMNS!r} and a line per pose."
        ) from error
    table = [line for line in lines if line.strip() and not line.startswith("#")]
    if not table or table[0].replace(" ", "") != COLUMNS:
        found = repr(table[0][:60]) if table else "nothing"
        raise RecordingError(f"{path} must begin with the line {COLUMNS!r}; found {found}.")
    try:
        words = [line.split(",") for line in table[1:]]
        odd = next((one for one in words if len(one) != 7), None)
        if odd is not None:
            raise ValueError(f"{len(odd)} in {','.join(odd)[:60]!r}")
        rows = np.array(words, dtype=float).reshape(-1, 7)
        times, displacements, turns = np.split(rows, [1, 4], axis=1)
    except ValueError as error:
        raise RecordingError(f"{path} must hold seven numbers in each line: {error}.") from error
    return HandPath(times=times[:, 0], displacements=displacements, turns=turns)


def _faulty(rows: Matrix) -> str:
    """Return which row is not finite."""
    bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    return f"number {bad[0]} is {rows[bad[0]].tolist()}" if len(bad) else "all finite"
