"""CellSheet: what the data sheets of a cell say."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class CellSheet:
    """What the data sheets of a cell say, the same to programs and policies, as JSON types.

    All of it is nominal: how this world differs from it is nowhere in it.
    """

    task: Mapping[str, Any] = field(default_factory=dict)
    """The task's fields by name: nominal sizes [m] and masses [kg] of its items, forces [N],
    tolerances and so on."""
    obstacles: Sequence[Mapping[str, Any]] = ()
    """Static obstacles: name, shape, size and pose."""
    noise: Mapping[str, Any] = field(default_factory=dict)
    """Figures of the sensors and lines by the names of the fields of `SensorErrors`, such as the
    standard deviation of the camera's noise, `pose_noise` [m], and `mass_tolerance` and
    `size_tolerance`, by what part of nominal mass and lengths objects may be off [-]."""
    time_limit: float = 0.0
    """Longest simulated time of the job [s]."""
    acceleration: float = 0.0
    """Acceleration of the tool, at home, with all joints at those of the arm's motions [m/s²]."""
