"""Signal: a named group of columns of a recording."""

from dataclasses import dataclass

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
POSE_UNIT = "m, quaternion wxyz"
"""Labels and unit of a pose."""
XYZ = ("x", "y", "z")


@dataclass(frozen=True, kw_only=True)
class Signal:
    """A named group of columns."""

    name: str
    """Path with slashes, for example "joints/q"."""
    labels: tuple[str, ...]
    """One per column."""
    unit: str
    shown: bool = True
    """False: it only serves to compute others, and the Rerun recording leaves it out."""
