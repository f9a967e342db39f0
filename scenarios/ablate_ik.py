"""What joint limits, damping and restarts are worth in IK: one law of damping at a time.

Each law is combined with steps that know no joint limits (free, angles wrapped at the end), that
are clamped to them (clipped), and that keep them as the bounds of a QP (box). The settings are the
best ones of clipped DLS, chosen first on targets of their own, from one start and with restarts
each for itself. A star marks restarts.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple

from robo47_qp.report.importing import importing

with importing():
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    from robo47_qp.arrays import Checked, Count, CountOrZero
    from robo47_qp.cli import LOGS, OK, main
    from robo47_qp.evaluation.benchmarks.ik.answers import Answers
    from robo47_qp.evaluation.benchmarks.ik.catalogue import EACH, SINGLE, STARTS, target_sets
    from robo47_qp.evaluation.benchmarks.ik.command import chosen
    from robo47_qp.evaluation.benchmarks.ik.comparison import Comparison, Start
    from robo47_qp.evaluation.benchmarks.ik.summary import rows
    from robo47_qp.evaluation.statistics import mcnemar, paired_difference
    from robo47_qp.files import check_writable, plain, write_json
    from robo47_qp.ik.damping import Damping
    from robo47_qp.ik.dls import DlsIk
    from robo47_qp.ik.lm import LmIk
    from robo47_qp.ik.mink import MinkIk
    from robo47_qp.ik.multistart import MultiStart
    from robo47_qp.ik.qp import QpIk
    from robo47_qp.ik.seeds import build_seconds
    from robo47_qp.ik.solver import IkSolver
    from robo47_qp.model.arm import Arm
    from robo47_qp.model.robots import load_robot
    from robo47_qp.report.provenance import provenance

LAWS = {
    "constant": [Damping(constant=one) for one in (0.01, 0.02, 0.05, 0.1, 0.2)],
    "by error": [Damping(per_error=one) for one in (0.003, 0.01, 0.03, 0.1, 0.3)],
    "singular": [
        Damping(constant=0.01, singular=one, threshold=w)
        for one, w in product((0.05, 0.1, 0.2), (0.02, 0.05, 0.1))
    ],
}
"""Laws of damping, each with the settings that are tried. w of the Panda is at most about 0.1."""
CLAMPS = ((np.inf, np.inf), (0.1, 0.4), (0.3, 1.0))
"""Longest displacement [m] and widest rotation [rad] that a step goes for."""
CENTRING = (0.0, 0.02, 0.1)
_TUNED = ("damping", "longest", "widest", "centring")


@dataclass(frozen=True, kw_only=True)
class AblateOptions(Checked):
    """Options of the ablation."""

    robot: str = "panda"
    """Robot whose inverse kinematics is solved."""
    n: Count = 1000
    """Targets per set."""
    seed: CountOrZero = 0
    """Seed of the targets."""
    tune: Count = 200
    """Targets per set on which the settings of DLS are chosen, with the next seed."""
    targets: tuple[str, ...] = ("uniform", "near_limits")
    """Target sets of `robo47 compare-ik`."""
    report: Path = LOGS / "ablate_ik.json"
    """File for the figures (JSON)."""

    def _label(self, field: str) -> str:
        return f"--{field}"


def run(options: AblateOptions, console: Console) -> int:
    """Sweep, compare, print and write; return the exit code."""
    check_writable(options.report)
    made = provenance()
    arm = Arm(load_robot(options.robot))
    swept, best = sweep(arm, options, alone, settings())
    console.print(f"best of {len(swept)} settings of clipped DLS, by law: " + _told(best))
    swept_again, best_again = sweep(arm, options, restarted, better_half(swept))
    console.print("with restarts: " + _told(best_again))
    cast = solvers(best) | {
        f"{name}*": restarted(solver) for name, solver in solvers(best_again).items()
    }
    fields = _compared(arm, cast, options, options.n, options.seed)
    effects = [one for field in fields for one in worth(field, best)]
    console.print(_rates(fields))
    console.print(_effects(effects))
    library, count = build_seconds(arm), MultiStart(solver=LmIk()).library
    console.print(
        f"The library of {count} configurations is made in {library:.2f} s, once, and kept in the "
        "user's cache folder; no time above includes it."
    )
    write_json(
        options.report,
        {
            **made,
            **{name: getattr(options, name) for name in ("robot", "n", "seed", "tune")},
            "targets": list(options.targets),
            "library_seconds": library,
            "solvers": {name: plain(solver) for name, solver in cast.items()},
            "sweep": [one.told() for one in swept],
            "sweep_restarted": [one.told() for one in swept_again],
            "rows": [row for field in fields for row in rows(field)],
            "effects": effects,
        },
    )
    console.print(f"{options.report}", soft_wrap=True)
    return OK


def alone(solver: IkSolver) -> IkSolver:
    """Return a solver from one start."""
    return replace(solver, max_iterations=SINGLE)  # type: ignore[type-var]


def restarted(solver: IkSolver) -> IkSolver:
    """Return a solver with restarts, and the second looks that all solvers get."""
    each = replace(solver, max_iterations=EACH)  # type: ignore[type-var]
    return MultiStart(solver=each, max_restarts=STARTS - 1)


class Tried(NamedTuple):
    """A setting of clipped DLS, and what it reached."""

    law: str
    """Name of its law of damping."""
    dls: DlsIk
    """The setting."""
    reached: int
    """Targets that were reached."""
    of: int
    """Targets that were tried."""
    steps: int
    """Steps on all of them."""

    @property
    def rank(self) -> tuple[int, int]:
        """What is larger the better it is: of those that reach as many, by fewer steps."""
        return self.reached, -self.steps

    def told(self) -> dict[str, Any]:
        """Return it for a report."""
        own = {one: plain(getattr(self.dls, one)) for one in _TUNED}
        return {"law": self.law, **own, **{k: getattr(self, k) for k in ("reached", "of", "steps")}}


def settings() -> list[tuple[str, DlsIk]]:
    """Return all settings of clipped DLS that are tried, each with its law."""
    return [
        (law, DlsIk(damping=one, longest=clamp[0], widest=clamp[1], centring=centring))
        for law, dampings in LAWS.items()
        for one, clamp, centring in product(dampings, CLAMPS, CENTRING)
    ]


def better_half(swept: Sequence[Tried]) -> list[tuple[str, DlsIk]]:
    """Return the better half of the settings of each law; the others need most of the time."""
    found = []
    for law in LAWS:
        ranked = sorted((t for t in swept if t.law == law), key=lambda t: t.rank, reverse=True)
        found += [(law, tried.dls) for tried in ranked[: ceil(len(ranked) / 2)]]
    return found


def sweep(
    arm: Arm,
    options: AblateOptions,
    searched: Callable[[IkSolver], IkSolver],
    cast: Sequence[tuple[str, DlsIk]],
) -> tuple[list[Tried], dict[str, DlsIk]]:
    """Return what each setting of clipped DLS reaches, and the best one of each law.

    Args:
        arm: The arm.
        options: Targets.
        searched: Makes of a solver the search that is tried.
        cast: The settings, each with its law.
    """
    searches = {str(i): searched(dls) for i, (_, dls) in enumerate(cast)}
    fields = _compared(arm, searches, options, options.tune, options.seed + 1)
    swept = [
        Tried(
            law,
            dls,
            reached=sum(int(field[i].success.sum()) for field in fields),
            of=options.tune * len(fields),
            steps=sum(int(field[i].iterations.sum()) for field in fields),
        )
        for i, (law, dls) in enumerate(cast)
    ]
    best = {law: max((t for t in swept if t.law == law), key=lambda t: t.rank).dls for law in LAWS}
    return swept, best


def solvers(best: dict[str, DlsIk]) -> dict[str, IkSolver]:
    """Return law × limits, and the package's and mink's own QPs."""
    found: dict[str, IkSolver] = {
        "textbook": DlsIk(),
        "textbook free": DlsIk(clip=False, wrap=True),
    }
    for law, dls in best.items():
        found[f"{law}, free"] = replace(dls, clip=False, wrap=True)
        found[f"{law}, clipped"] = dls
        if isinstance(dls.damping, Damping):
            found[f"{law}, box"] = LmIk(
                damping=dls.damping, longest=dls.longest, widest=dls.widest, max_iterations=SINGLE
            )
    found["qp"] = QpIk(max_iterations=SINGLE)
    found["mink"] = MinkIk(max_iterations=SINGLE)
    return found


def worth(field: Sequence[Answers], best: dict[str, DlsIk]) -> list[dict[str, Any]]:
    """Return the paired effects on one target set: of limits, of damping and of restarts."""
    by_name = {answers.solver: answers for answers in field}
    pairs = [("tuning", "textbook", f"{law}, clipped") for law in best]
    for law in best:
        for end in ("", "*"):
            pairs += [
                (f"clipping{end}", f"{law}, free{end}", f"{law}, clipped{end}"),
                (f"bounds{end}", f"{law}, clipped{end}", f"{law}, box{end}"),
            ]
    for end in ("", "*"):
        clipped = ("textbook", *(f"{law}, clipped" for law in best))
        pairs += [("QP", f"{name}{end}", f"qp{end}") for name in clipped]
    pairs += [("law", "constant, box", f"{law}, box") for law in best if law != "constant"]
    single = [name for name in by_name if not name.endswith("*")]
    pairs += [("restarts", name, f"{name}*") for name in single]
    pairs += [("mink", "qp", "mink")]
    found = []
    for what, a, b in pairs:
        better, worse, p = mcnemar(by_name[b].success, by_name[a].success)
        low, high = paired_difference(better, worse, by_name[a].n)
        found.append(
            {
                "targets": field[0].targets.name,
                "effect": what,
                "from": a,
                "to": b,
                "points": 100.0 * (better - worse) / by_name[a].n,
                "interval": [100.0 * low, 100.0 * high],
                "p": p,
            }
        )
    return found


def _compared(
    arm: Arm, cast: dict[str, Any], options: AblateOptions, n: int, seed: int
) -> list[Sequence[Answers]]:
    fields = chosen("target set", target_sets(arm.robot), options.targets)
    comparison = Comparison(
        arm=arm, solvers=cast, fields=fields, n=n, seed=seed, start=Start.HOME, warm=0
    )
    return list(comparison.run(lambda *_: None))


def _told(best: dict[str, DlsIk]) -> str:
    parts = []
    for law, one in best.items():
        values = vars(one.damping).items() if isinstance(one.damping, Damping) else ()
        stated = ", ".join(f"{name} {value:g}" for name, value in values if value)
        clamp = f"clamped to {one.longest:g} m, {one.widest:g} rad"
        parts.append(f"{law} ({stated}; {clamp}; centring {one.centring:g})")
    return "; ".join(parts)


def _rates(fields: Sequence[Sequence[Answers]]) -> Table:
    table = Table(box=None, header_style="")
    table.add_column("solver")
    for field in fields:
        for name in (field[0].targets.name, "median ms", "p99 ms"):
            table.add_column(name, justify="right")
    told = [rows(field) for field in fields]
    for i, answers in enumerate(fields[0]):
        cells = []
        for figures in told:
            one = figures[i]
            cells += [f"{100 * one['success']:.1f} %"]
            cells += [f"{one[name]:.2f}" for name in ("median_ms", "p99_ms")]
        table.add_row(answers.solver, *cells)
    return table


def _effects(effects: Sequence[dict[str, Any]]) -> Table:
    table = Table(box=None, header_style="")
    for name in ("targets", "effect", "to"):
        table.add_column(name)
    for name in ("points", "95 %", "p"):
        table.add_column(name, justify="right")
    for one in effects:
        low, high = one["interval"]
        names = [one[name] for name in ("targets", "effect", "to")]
        table.add_row(
            *names, f"{one['points']:+.1f}", f"{low:+.1f} to {high:+.1f}", f"{one['p']:.1g}"
        )
    return table


if __name__ == "__main__":
    sys.exit(main(AblateOptions, run, __doc__ or ""))
