"""Options of a comparison."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

from robo47_qp.cli import LOGS
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.evaluation.benchmarks.ik.comparison import Start

Member = TypeVar("Member")


@dataclass(frozen=True, kw_only=True)
class CompareOptions:
    """What can be chosen for a comparison."""

    n: int = 1000
    """Targets per target set."""
    seed: int = 0
    """Seed of the targets."""
    solvers: tuple[str, ...] = ()
    """Names of the solvers to compare; all of them if none is named."""
    targets: tuple[str, ...] = ()
    """Names of the target sets; all of them if none is named."""
    start: Literal["home", "random"] = "home"
    """Where every search starts: the robot's home, or a random configuration per target."""
    peers: bool = False
    """Also compare the solvers of other packages; those that are not installed are named."""
    log: Path = LOGS / "ik.rrd"
    """Recording to write; the report goes beside it, with the ending .json."""
    plot: Path | None = None
    """Picture to write (PNG); by default beside the recording."""
    json: bool = False
    """Print the report as JSON on the standard output and nothing else."""

    def __post_init__(self) -> None:
        """Check what no type can.

        Raises:
            InvalidValueError: A number is out of range, or a file has the wrong ending.
        """
        if self.n < 1:
            raise InvalidValueError("--n", self.n, "1 or more")
        if self.seed < 0:
            raise InvalidValueError("--seed", self.seed, "0 or more")
        for option, path, ending in (("--log", self.log, ".rrd"), ("--plot", self.plot, ".png")):
            if path is not None and path.suffix != ending:
                raise InvalidValueError(option, path, f"a file that ends with {ending}")

    @property
    def start_at(self) -> Start:
        """Where every search starts."""
        return Start(self.start)

    @property
    def files(self) -> dict[str, Path]:
        """What is written, by name."""
        return {
            "report": self.log.with_suffix(".json"),
            "plot": self.plot or self.log.with_suffix(".png"),
            "recording": self.log,
        }


def chosen(kind: str, known: Mapping[str, Member], names: Iterable[str]) -> dict[str, Member]:
    """The named members, in the order of all; all where none is named.

    Raises:
        UnknownNameError: A name is not among those known.
    """
    wanted = tuple(names)
    for name in wanted:
        if name not in known:
            raise UnknownNameError(kind, name, known)
    return {name: member for name, member in known.items() if not wanted or name in wanted}
