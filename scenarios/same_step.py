"""Steps of the solvers beside those of mink.solve_ik and beside exact ones (in 50 digits)."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robo47_qp.report.importing import importing

with importing():
    import numpy as np
    from rich.console import Console

    from robo47_qp.arrays import Checked, Count, CountOrZero
    from robo47_qp.cli import FAILED, LOGS, OK, main
    from robo47_qp.evaluation.benchmarks.ik.same_step import OBJECTIVES, differences, states
    from robo47_qp.files import check_writable, write_json
    from robo47_qp.model.arm import Arm
    from robo47_qp.model.robots import load_robot
    from robo47_qp.report.figures_table import FiguresTable
    from robo47_qp.report.provenance import provenance
    from robo47_qp.report.terminal import print_files

_SAME = 1e-9
"""Steps of the fused solvers may differ from exact ones by so much [rad]."""


@dataclass(frozen=True, kw_only=True)
class SameStepOptions(Checked):
    """Options of the comparison."""

    n: Count = 1000
    """States: configurations within limits and on them, targets from 0.1 mm to a metre away."""
    seed: CountOrZero = 4
    """Seed of the states."""
    robot: str = "panda"
    """Robot."""
    report: Path = LOGS / "same_step.json"
    """File for the figures (JSON)."""

    def _label(self, field: str) -> str:
        return f"--{field}"


def run(options: SameStepOptions, console: Console) -> int:
    """Compare, print, write; return 0 if all steps of the fused solvers are exact to 1e-9 rad."""
    check_writable(options.report)
    made = provenance()
    arm = Arm(load_robot(options.robot))
    beside = ("mink", "> 1e-9", "refined", "> 1e-9")
    headings = ("solver", "from exact", "mink, exact", *beside, "held")
    table = FiguresTable(headings, texts=("solver",))
    figures: dict[str, Any] = {}
    for name in OBJECTIVES:
        found = np.array(
            [differences(name, arm, one) for one in states(arm, options.n, options.seed)]
        )
        exact, own, plain, refined = found[:, :4].max(axis=0).tolist()
        figures[name] = {
            "largest_from_exact_rad": exact,
            "largest_of_mink_from_exact_rad": own,
            "largest_from_mink_rad": plain,
            "states_above_1e-9_from_mink": int((found[:, 2] > _SAME).sum()),
            "largest_from_mink_refined_rad": refined,
            "states_above_1e-9_from_mink_refined": int((found[:, 3] > _SAME).sum()),
            "states_with_joints_at_limits": int((found[:, 4] > 0).sum()),
        }
        cells = [f"{one:.1e}" if isinstance(one, float) else one for one in figures[name].values()]
        table.add_row(name, *map(str, cells))
    console.print(table)
    options_told = {"robot": options.robot, "n": options.n, "seed": options.seed}
    write_json(options.report, {**made, **options_told, "figures": figures})
    print_files(console, {"report": options.report})
    fused = [one["largest_from_exact_rad"] for name, one in figures.items() if name != "mink"]
    return OK if all(one <= _SAME for one in fused) else FAILED


if __name__ == "__main__":
    sys.exit(main(SameStepOptions, run, __doc__ or ""))
