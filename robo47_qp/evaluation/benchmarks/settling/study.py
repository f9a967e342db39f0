"""What studies of settling times over random starts share: options, table, report."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.benchmarks.settling.settling import BAND
from robo47_qp.files import write_json
from robo47_qp.report.figures_table import FiguresTable


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """What can be chosen for every study."""

    report: Path
    """File for the figures (JSON)."""
    seconds: float
    """How long each start is watched [s]."""
    starts: int = 20
    """How many random starts."""
    seed: int = 0
    """Seed of the starts."""

    def __post_init__(self) -> None:
        """Check what no type can.

        Raises:
            InvalidValueError: A number is out of range.
        """
        if self.report.suffix != ".json":
            raise InvalidValueError("--report", self.report, "a file that ends with .json")
        if self.starts < 1:
            raise InvalidValueError("--starts", self.starts, "1 or more")
        if self.seed < 0:
            raise InvalidValueError("--seed", self.seed, "0 or more")
        if not 0.1 <= self.seconds <= 600.0:
            raise InvalidValueError("--seconds", self.seconds, "between 0.1 and 600 [s]")

    def settings(self) -> dict[str, Any]:
        """What the figures depend on."""
        return {name: value for name, value in asdict(self).items() if name != "report"}


def conclude(
    options: StudyOptions,
    times: Vector,
    columns: Mapping[str, Sequence[str]],
    others: Mapping[str, Any],
    console: Console,
) -> bool:
    """Print the starts and the mean settling time, and write the report.

    Args:
        options: The choices.
        times: Settling time of each start; infinite where it did not settle [s].
        columns: What else to print of each start, by heading.
        others: What else to report, beside "metrics": also what `provenance` told before.
        console: Where to print.

    Returns:
        True where every start settled; otherwise there is no mean, and no report.

    Raises:
        RecordingError: The report cannot be written.
    """
    settled = ["no" if np.isinf(time) else f"{time:.4f}" for time in times]
    shown = {"start": [str(i) for i in range(len(times))], **columns, "settled after s": settled}
    table = FiguresTable([*shown], title="Settling")
    for row in zip(*shown.values(), strict=True):
        table.add_row(*row)
    console.print(table)
    lost = int(np.isinf(times).sum())
    if lost:
        options.report.unlink(missing_ok=True)
        console.print(
            f"[bold red]failed:[/] {lost} of {len(times)} starts did not settle within "
            f"{options.seconds} s; there is no mean",
            highlight=False,
        )
        return False
    content = {
        "settings": {**options.settings(), "band": BAND},
        "metrics": {
            "mean_settling_time_s": float(times.mean()),
            "shortest_settling_time_s": float(times.min()),
            "longest_settling_time_s": float(times.max()),
        },
        "settling_times_s": times.tolist(),
    }
    write_json(options.report, {**content, **others})
    console.print(
        f"[bold green]mean settling time {times.mean():.4f} s[/]  {len(times)} starts, standard "
        f"deviation {times.std():.4f} s, band {100 * BAND:.0f} %\n  report  {options.report}",
        highlight=False,
        soft_wrap=True,
    )
    return True
