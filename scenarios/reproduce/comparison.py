"""Comparison: figures measured now against figures kept from before."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from math import isfinite

BAR = 0.01
"""Largest difference between machines, as a share of the kept figure [-]."""
FLOOR = 1e-9
"""Differences up to this are rounding, whatever their share: a nanometre, a nanoradian, ... ."""


class Agreement(Enum):
    """What became of one figure."""

    IDENTICAL = "identical"
    """Equal to the last bit."""
    WITHIN = "within the bar"
    """Not identical, and not by much."""
    BEYOND = "BEYOND THE BAR"
    """Further from the kept figure than the bar allows."""
    CHANGED = "NOT IDENTICAL"
    """Within the bar, on a machine where it had to be identical."""
    MISSING = "NOT MEASURED"
    """Kept, but no longer measured."""
    NEW = "NOT KEPT"
    """Measured, but not kept."""
    NOT_A_NUMBER = "NOT A NUMBER"
    """NaN or infinite, kept or measured."""
    UNJUDGED = "not judged"
    """Depends on how fast and how busy the machine is."""

    @property
    def good(self) -> bool:
        """True where the figure was reproduced, or need not be."""
        return self in (Agreement.IDENTICAL, Agreement.WITHIN, Agreement.UNJUDGED)


@dataclass(frozen=True, kw_only=True)
class Compared:
    """One figure, kept and measured."""

    name: str
    kept: float | None
    """None where it was not kept."""
    measured: float | None
    """None where it was not measured."""
    agreement: Agreement

    @property
    def difference(self) -> float | None:
        """(measured - kept) / |kept| [-]; None where there are not two finite figures."""
        if self.kept is None or self.measured is None:
            return None
        change = self.measured - self.kept
        if change == 0.0:
            return 0.0
        return change / abs(self.kept) if isfinite(change) and self.kept != 0.0 else None


def compare(
    kept: Mapping[str, float],
    measured: Mapping[str, float],
    *,
    same_machine: bool,
    unjudged: Sequence[str] = (),
) -> list[Compared]:
    """Judge every figure that is kept or measured.

    Args:
        kept: Figures from before, by name.
        measured: Figures of now, by name.
        same_machine: Whether both are from the same machine and the same versions, where
            nothing but the same bits will do.
        unjudged: Names of figures that must be there, whatever they are.

    Returns:
        One entry per name, those that are measured first.
    """
    names = [*measured, *(name for name in kept if name not in measured)]
    return [
        Compared(
            name=name,
            kept=kept.get(name),
            measured=measured.get(name),
            agreement=_agreement(
                kept.get(name), measured.get(name), same_machine, name not in unjudged
            ),
        )
        for name in names
    ]


def _agreement(
    kept: float | None, measured: float | None, same_machine: bool, judged: bool
) -> Agreement:
    if kept is None or measured is None:
        return Agreement.NEW if kept is None else Agreement.MISSING
    if not (isfinite(kept) and isfinite(measured)):
        return Agreement.NOT_A_NUMBER
    if not judged:
        return Agreement.UNJUDGED
    if measured == kept:
        return Agreement.IDENTICAL
    if abs(measured - kept) > max(BAR * abs(kept), FLOOR):
        return Agreement.BEYOND
    return Agreement.CHANGED if same_machine else Agreement.WITHIN
