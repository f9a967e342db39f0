"""Controllers compared: what each term of a control law is worth, and what disturbs it.

Every controller makes the same motion from home, back and there again, and then holds still, under
each disturbance in turn: what the joints should do is the same, what goes wrong is the same to the
last bit.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from robo47_qp.report.importing import importing

with importing():
    import numpy as np
    from mink import SE3
    from rich.console import Console
    from rich.progress import track

    from robo47_qp.cli import LOGS, OK, main
    from robo47_qp.control.cartesian_impedance import CartesianImpedance
    from robo47_qp.control.computed_torque import ComputedTorque
    from robo47_qp.control.controller import Controller
    from robo47_qp.control.joint_impedance import FeedForward, JointImpedance
    from robo47_qp.control.observer import DisturbanceObserver
    from robo47_qp.control.operational_space import OperationalSpace
    from robo47_qp.errors import InvalidValueError, UnknownNameError
    from robo47_qp.evaluation.benchmarks.control.plots import plot_trials
    from robo47_qp.evaluation.benchmarks.control.trial import (
        PUSH,
        PUSHED_AFTER,
        Bench,
        Trial,
        TrialCondition,
    )
    from robo47_qp.evaluation.benchmarks.control.trial_log import write_trials
    from robo47_qp.evaluation.perturbation import PRESETS
    from robo47_qp.files import check_writable, claimed, write_json
    from robo47_qp.model.payload import Payload
    from robo47_qp.model.robots.panda import PANDA
    from robo47_qp.report.figures_table import FiguresTable
    from robo47_qp.report.provenance import provenance
    from robo47_qp.report.terminal import print_files
    from robo47_qp.sim.disturbance import Disturbance
    from robo47_qp.sim.push import Push

OFFSET = (0.9, 0.4, -0.5, 0.6, -0.7, 0.4, -0.8)
"""From home to the goal [rad]."""
CONTROLLERS: dict[str, tuple[Controller, DisturbanceObserver | None]] = {
    "PD": (JointImpedance(feed_forward=FeedForward.NONE), None),
    "+ gravity": (JointImpedance(feed_forward=FeedForward.GRAVITY), None),
    "+ Coriolis": (JointImpedance(feed_forward=FeedForward.CORIOLIS), None),
    "+ acceleration": (JointImpedance(), None),
    "computed torque": (ComputedTorque(), None),
    "+ observer": (ComputedTorque(), DisturbanceObserver(friction=None)),
    "+ friction": (ComputedTorque(), DisturbanceObserver()),
    "Cartesian": (CartesianImpedance(), None),
    "operational": (OperationalSpace(), None),
    "joint, observer": (JointImpedance(), DisturbanceObserver()),
    "Cartesian, observer": (CartesianImpedance(), DisturbanceObserver()),
    "operational, observer": (OperationalSpace(), DisturbanceObserver()),
}
"""Each with its observer. Up to "+ friction" from nothing known to all: what one adds, the next
ones have, too. Then the other laws of the stack, without the observer and with it."""


@dataclass(frozen=True, kw_only=True)
class ControllersOptions:
    """Options of this scenario."""

    log: Path = LOGS / "compare_controllers.rrd"
    """Recording to write; plot and report go beside it, with the endings .png and .json."""
    only: tuple[str, ...] = ()
    """Conditions to try, by name; without it, all."""
    json: bool = False
    """Print the report as JSON on the standard output and nothing else."""

    def __post_init__(self) -> None:
        """Check what no type can.

        Raises:
            InvalidValueError: The file has the wrong ending.
        """
        if self.log.suffix != ".rrd":
            raise InvalidValueError("--log", self.log, "a file that ends with .rrd")


def conditions(start: float) -> list[TrialCondition]:
    """All that goes wrong, one thing at a time, and all at once as in cells of two levels.

    Args:
        start: When the motion is over [s].
    """

    def pushed(newton: float) -> Disturbance:
        force = newton * np.array([0.6, -0.64, 0.48])
        return Disturbance(pushes=(Push(force=force, start=start + PUSHED_AFTER, duration=PUSH),))

    both = Disturbance(link_mass_factor=1.05, dry_friction=0.5)
    loads = {mass: _load(mass) for mass in (0.1, 0.5, 1.0)}
    return [
        TrialCondition(name="free"),
        *(
            TrialCondition(name=f"payload {mass} kg", disturbance=Disturbance(payload=load))
            for mass, load in loads.items()
        ),
        TrialCondition(
            name="payload 0.5 kg, told",
            disturbance=Disturbance(payload=loads[0.5]),
            told=loads[0.5],
        ),
        TrialCondition(
            name="payload 0.5 kg, told at rest",
            disturbance=Disturbance(payload=loads[0.5]),
            told_at_rest=loads[0.5],
        ),
        *(TrialCondition(name=f"push {f} N", disturbance=pushed(f)) for f in (10, 30, 50)),
        TrialCondition(name="noise", disturbance=Disturbance(noise_q=1e-4)),
        *(
            TrialCondition(name=f"delay {k} ms", disturbance=Disturbance(torque_delay=k * 1e-3))
            for k in (1, 2, 3, 4, 5)
        ),
        *(
            TrialCondition(name=f"inertia {change:+d} %", disturbance=_heavier(change))
            for change in (-20, 20)
        ),
        TrialCondition(name="links +5 %", disturbance=_heavier(5)),
        TrialCondition(name="dry friction", disturbance=Disturbance(dry_friction=0.5)),
        TrialCondition(name="both", disturbance=both),
        TrialCondition(
            name="both, noise, delay",
            disturbance=replace(both, noise_q=1e-4, torque_delay=1e-3, state_delay=1e-3),
        ),
        *(_cell(level, number) for level in ("moderate", "severe") for number in range(1, 4)),
    ]


def _cell(level: str, number: int) -> TrialCondition:
    """One of the worlds of a level, without its pushes."""
    drawn = PRESETS[level].draw(np.random.default_rng(number))
    return TrialCondition(name=f"{level} {number}", disturbance=replace(drawn, pushes=()))


def _heavier(percent: int) -> Disturbance:
    return Disturbance(link_mass_factor=1.0 + percent / 100.0)


def _load(mass: float) -> Payload:
    """A cube of steel's third of a density, 3 cm in front of the tool point."""
    side = (mass / 2600.0) ** (1 / 3)
    moment = mass * side**2 / 6.0
    T_tcp_com = SE3.from_translation(np.array([0.0, 0.0, 0.03]))
    return Payload(mass=mass, inertia=(moment, moment, moment), T_tcp_com=T_tcp_com)


def run(options: ControllersOptions, console: Console) -> int:
    """Run the scenario; returns the exit code."""
    bench = Bench(PANDA, OFFSET)
    known = {condition.name: condition for condition in conditions(bench.duration)}
    for name in options.only:
        if name not in known:
            raise UnknownNameError("condition", name, [repr(one) for one in known])
    chosen = [known[name] for name in options.only or known]
    with claimed(options.log):
        return compared(bench, chosen, options, console)


def compared(
    bench: Bench,
    chosen: Sequence[TrialCondition],
    options: ControllersOptions,
    console: Console,
) -> int:
    """Run the chosen conditions and write the files; returns the exit code."""
    for ending in (".rrd", ".png", ".json"):
        check_writable(options.log.with_suffix(ending))
    made = provenance()
    by_condition = [
        [bench.run(name, law, condition, seen) for name, (law, seen) in CONTROLLERS.items()]
        for condition in track(chosen, "trying", console=console, transient=True)
    ]
    write_trials(by_condition, markdown(by_condition), options.log)
    plot_trials(by_condition, options.log.with_suffix(".png"))
    report = {
        "robot": PANDA.name,
        **made,
        "motion": {"offset_rad": list(OFFSET), "duration_s": bench.duration},
        "trials": {
            trials[0].condition: {trial.controller: trial.figures() for trial in trials}
            for trials in by_condition
        },
    }
    write_json(options.log.with_suffix(".json"), report)
    if options.json:
        sys.stdout.write(options.log.with_suffix(".json").read_text(encoding="utf-8"))
        return OK
    show(by_condition, console)
    endings = {"recording": ".rrd", "plot": ".png", "report": ".json"}
    print_files(console, {kind: options.log.with_suffix(end) for kind, end in endings.items()})
    return OK


def cells(trial: Trial) -> list[str]:
    """One row of the table."""
    figures = trial.figures()
    settled = figures["settling_time_s"]
    return [
        trial.controller,
        f"{1e3 * float(figures['max_joint_error_rad'] or 0.0):.3f}",
        f"{1e3 * float(figures['max_joint_error_again_rad'] or 0.0):.3f}",
        f"{1e3 * float(figures['max_tool_error_m'] or 0.0):.3f}",
        f"{1e3 * float(figures['max_tool_error_at_rest_m'] or 0.0):.3f}",
        f"{1e3 * float(figures['last_tool_error_m'] or 0.0):.4f}",
        "no" if settled is None else f"{float(settled):.3f}",
        f"{100 * float(figures['peak_torque_use'] or 0.0):.0f}",
        "yes" if trial.stable else "NO",
    ]


HEADINGS = (
    "controller",
    "joint mrad",
    "again mrad",
    "tool mm",
    "at rest mm",
    "at last mm",
    "settled s",
    "torque %",
    "stable",
)


def show(by_condition: Sequence[Sequence[Trial]], console: Console) -> None:
    """Print the table."""
    headings = ("condition", *HEADINGS)
    table = FiguresTable(
        headings,
        texts=headings[:2],
        title="Largest errors: in motion, of which on the last leg again, and at rest",
    )
    for trials in by_condition:
        for k, trial in enumerate(trials):
            style = None if trial.stable else "red"
            table.add_row(trial.condition if k == 0 else "", *cells(trial), style=style)
    console.print(table)


def markdown(by_condition: Sequence[Sequence[Trial]]) -> str:
    """The table as Markdown."""
    lines = ["| " + " | ".join(("condition", *HEADINGS)) + " |", "|---" * (len(HEADINGS) + 1) + "|"]
    for trials in by_condition:
        lines += ["| " + " | ".join((t.condition, *cells(t))) + " |" for t in trials]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main(ControllersOptions, run, __doc__))
