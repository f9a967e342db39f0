"""Success against each kind of wrongness alone, at growing levels until half is lost.

For the stack, with and without its observer, and with damped least squares. The world of each
level differs from the controller's models in one thing; `robo47 evaluate --help` lists them.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from robo47_qp.report.importing import importing

with importing():
    from rich.console import Console
    from rich.table import Table

    from robo47_qp.arrays import Checked, Count, CountOrZero, Suffix
    from robo47_qp.cli import FAILED, INTERRUPTED, LOGS, OK, main, one_of, unset
    from robo47_qp.errors import InvalidValueError
    from robo47_qp.evaluation.benchmarks.robustness.curves import Curve, Point, Robustness, kinds
    from robo47_qp.evaluation.benchmarks.robustness.plot import plot_robustness
    from robo47_qp.evaluation.workers.executor import cores
    from robo47_qp.files import check_writable, claimed, write_json
    from robo47_qp.model.cell import in_cell
    from robo47_qp.model.robots import load_robot, robot_names
    from robo47_qp.report.provenance import provenance
    from robo47_qp.run.registry import load_task

_QUICK = ("joint_friction", "pose_bias", "friction")


@dataclass(frozen=True, kw_only=True)
class RobustnessOptions(Checked):
    """Options of the campaign."""

    task: str = "pick_place"
    """Task, by its name."""
    robot: Annotated[str | None, one_of(robot_names())] = None
    """Robot that does the task; that of the task if none is named."""
    kinds: tuple[str, ...] = ()
    """Kinds of wrongness, named like the options of `robo47 evaluate` with underscores; all of
    them if none is named."""
    stacks: tuple[str, ...] = ("stack", "no-observer", "dls")
    """Stacks: stack, no-observer, dls, dls-single."""
    episodes: Count = 50
    """Episodes at each level, the same seeds at all."""
    levels: Count = 8
    """Levels of a kind at most, each twice as wrong as the one before; a curve ends where half of
    the episodes are lost."""
    seed: CountOrZero = 50_000
    """Seed of the first episode."""
    workers: Count = field(default_factory=cores)
    """Processes at once."""
    quick: bool = False
    """3 kinds, 3 levels each four times as wrong as the one before, 4 episodes: a first look."""
    resume: bool = False
    """Continue an interrupted campaign."""
    report: Annotated[Annotated[Path, Suffix(".json")] | None, unset("PATH")] = None
    """File for the figures (.json); picture (.png) and a folder of journals go beside it. By
    default logs/robustness.json, and with --quick logs/robustness_quick.json."""

    @property
    def file(self) -> Path:
        """The report: one of a first look has a name of its own, and replaces no campaign."""
        name = "robustness_quick.json" if self.quick else "robustness.json"
        return LOGS / name if self.report is None else self.report

    def _label(self, field: str) -> str:
        return f"--{field}"


def run(options: RobustnessOptions, console: Console) -> int:
    """Run the campaign, print the table, write figures and picture; return the exit code."""
    file, picture = options.file, options.file.with_suffix(".png")
    for path in (file, picture):
        check_writable(path)
    if not options.stacks:
        raise InvalidValueError("--stacks", "none", "one at least")
    made = provenance()
    task = load_task(options.task)()
    robot = in_cell(load_robot(options.robot or task.default_robot), task.name)
    chosen = options.kinds or (_QUICK if options.quick else tuple(kinds()))
    campaign = Robustness(
        task=task.laid_out(robot),
        robot=robot,
        stacks=options.stacks,
        kinds=chosen,
        episodes=min(options.episodes, 4) if options.quick else options.episodes,
        levels=min(options.levels, 3) if options.quick else options.levels,
        stride=2 if options.quick else 1,
        seed=options.seed,
        workers=options.workers,
        folder=file.with_suffix(""),
    )
    curves, complete = list[Curve](), True

    def show(stack: str, kind: str, point: Point) -> None:
        at = "" if point.value is None else f" {point.value:.3g} {kinds()[kind][0].strip('-')}"
        told = f"{stack}: {kind}{at}: {point.successes} of {point.episodes}"
        told += f", internal errors {point.errors}" if point.errors else ""
        console.print(told, highlight=False, soft_wrap=True)

    try:
        with claimed(file):
            curves += campaign.run(show, resume=options.resume)
    except KeyboardInterrupt:
        complete = False
        console.print("interrupted; finished episodes are kept: continue with --resume")
    if not complete:
        return INTERRUPTED
    console.print(_table(curves))
    report = {
        **made,
        "task": options.task,
        "robot": robot.name,
        "episodes": campaign.episodes,
        "seed": options.seed,
        "units": {kind: kinds()[kind][0] for kind in chosen},
        "curves": [curve.as_json() for curve in curves],
    }
    plot_robustness(curves, title_of(report), picture)
    write_json(file, report)
    for path in (file, picture):
        console.print(f"{path}", soft_wrap=True)
    return FAILED if any(point.errors for curve in curves for point in curve.points) else OK


def title_of(report: Mapping[str, Any]) -> str:
    """Return the title of a report's picture."""
    return f"{report['task']}, {report['episodes']} episodes a level from seed {report['seed']}"


def _table(curves: list[Curve]) -> Table:
    """Return where half is lost, by kind and stack; beyond the last level where it is not."""
    table = Table(box=None, header_style="")
    table.add_column("half is lost at")
    stacks = list(dict.fromkeys(curve.stack for curve in curves))
    for stack in stacks:
        table.add_column(stack, justify="right")
    for kind in dict.fromkeys(curve.kind for curve in curves):
        unit = kinds()[kind][0]
        cells = [curve.half_told for curve in curves if curve.kind == kind]
        table.add_row(kind + ("" if unit == "-" else f", {unit}"), *cells)
    return table


if __name__ == "__main__":
    sys.exit(main(RobustnessOptions, run, __doc__ or ""))
