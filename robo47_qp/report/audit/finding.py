"""Finding: one limit and whether it was kept."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.constants import TIMESTEP

_ROUNDING = 1e-9
"""Relative slack for the rounding of differences."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One limit and whether it was kept."""

    signal: str
    """Name of the quantity, with its joint, waypoint or obstacle."""
    unit: str
    limit: float
    extreme: float
    """Value closest to the limit, or furthest beyond it."""
    time: float
    """When [s]."""
    ok: bool
    exempt: str = ""
    """Why it is not judged; empty where it is. Then `ok` is True, whatever the extreme."""
    share: float = 1.0
    """Share of the time of the run that it covers [-]."""
    least: bool = False
    """Whether the limit is that of the smallest value, as of a distance."""

    def __str__(self) -> str:
        told = (
            f"{self.signal}: {self.extreme:.4g} {self.unit} at {self.time:.3f} s, the limit is "
            f"{self.limit:.4g} {self.unit}"
        )
        if not self.exempt:
            return told
        return f"{told}; not judged in {100 * self.share:.1f} % of the time: {self.exempt}"


class Exempt(NamedTuple):
    """Rows in which a bound is not promised, and why."""

    rows: NDArray[np.bool_]
    """True in these rows (N,)."""
    why: str
    covered: NDArray[np.bool_] | None = None
    """True in the rows in which the quantity exists (N,); None is in all."""


def judged(
    signal: str,
    units: Sequence[str],
    names: Sequence[str],
    values: Matrix,
    bound: Vector,
    exempt: Exempt,
) -> list[Finding]:
    """Return the findings of the rows that are judged, and of those that are not, if any.

    Args:
        signal: Name of the quantity.
        units: Unit of each column (n,).
        names: Name of each column (n,).
        values: As recorded (N, n).
        bound: Symmetric bound of each column (n,).
        exempt: Which rows are not judged.
    """
    findings = []
    rows_of = np.ones(len(values), bool) if exempt.covered is None else exempt.covered
    for rows, reason in ((rows_of & ~exempt.rows, ""), (rows_of & exempt.rows, exempt.why)):
        if rows.any():
            found = bounded(signal, units, names, values[rows], bound)
            row = int(np.flatnonzero(rows)[round(found.time / TIMESTEP)])
            findings.append(
                replace(
                    found,
                    signal=f"{found.signal}, exempt" if reason else found.signal,
                    time=row * TIMESTEP,
                    ok=found.ok or bool(reason),
                    exempt=reason,
                    share=float(np.mean(rows)),
                )
            )
    return findings


def bounded(
    signal: str, units: Sequence[str], names: Sequence[str], values: Matrix, bound: Vector
) -> Finding:
    """Return the finding of the column that uses most of its symmetric bound."""
    use = np.abs(values) / bound
    row, column = divmod(int(np.argmax(use)), use.shape[1])
    return Finding(
        signal=f"{signal} ({names[column]})",
        unit=units[column],
        limit=float(bound[column]),
        extreme=float(np.abs(values[row, column])),
        time=row * TIMESTEP,
        ok=bool(use[row, column] <= 1.0 + _ROUNDING),
    )


def within(
    signal: str,
    units: Sequence[str],
    names: Sequence[str],
    values: Matrix,
    low: Vector,
    high: Vector,
) -> list[Finding]:
    """Return the findings of the columns closest to their lower and to their upper bound.

    A side on which no column has a bound has no finding.
    """
    findings = []
    for side, bound, margin in (("lower", low, values - low), ("upper", high, high - values)):
        row, column = divmod(int(np.argmin(margin)), margin.shape[1])
        if not np.isfinite(bound[column]):
            continue
        findings.append(
            Finding(
                signal=f"{signal} {side} ({names[column]})",
                unit=units[column],
                limit=float(bound[column]),
                extreme=float(values[row, column]),
                time=row * TIMESTEP,
                ok=bool(margin[row, column] >= 0.0),
            )
        )
    return findings


def at_most(signal: str, unit: str, sizes: Vector, limit: float) -> Finding:
    """Return the finding of the largest of some magnitudes; the limit may be 0."""
    row = int(np.argmax(sizes))
    extreme = float(sizes[row])
    return Finding(
        signal=signal,
        unit=unit,
        limit=limit,
        extreme=extreme,
        time=row * TIMESTEP,
        ok=extreme <= limit,
    )
