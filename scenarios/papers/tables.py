"""The tables that README and documentation hold, each made from kept results."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import partial
from typing import Any

from robo47_qp.evaluation.perturbation import PRESETS
from robo47_qp.model.robots import robot_names
from robo47_qp.run.registry import task_names
from scenarios.papers.blocks import markdown_table
from scenarios.papers.judges import franka, franka_clients, robosuite
from scenarios.papers.kept import is_kept, kept, origin_line
from scenarios.papers.mutants import mutants
from scenarios.papers.names import ALONE

Result = Mapping[str, Any]
Cell = Callable[[Result], str]
NOTHING = "No result of this kind is kept yet."
LEVELS = tuple(PRESETS)
ROBOT_TASKS = ("pick_place", "reach", "obstacle_reach")
_LAWS = {
    "textbook": "DLS of textbooks, λ = 0.05, clipped",
    "by error": "λ² = 0.1 ‖e‖²",
    "constant": "λ = 0.02",
    "singular": "near singularities",
}
_EFFECTS = {
    "tuned damping, clipped DLS": ("textbook", "by error, clipped"),
    "clipping over free steps": ("by error, free", "by error, clipped"),
    "bounds in the QP over clipping": ("by error, clipped", "by error, box"),
    "the same with a constant λ": ("constant, clipped", "constant, box"),
    "the same with restarts": ("by error, clipped*", "by error, box*"),
    "restarts, clipped DLS": ("by error, clipped", "by error, clipped*"),
    "restarts, box": ("by error, box", "by error, box*"),
}


def success() -> str:
    """Success of the tasks: a row for each task and level of perturbation that is kept."""
    results = {
        name: kept(name)
        for level in LEVELS
        for task in task_names()
        if is_kept(name := f"success_{level}_{task}")
    }
    if not results:
        return NOTHING
    heads = {
        "task": "---",
        "perturbation": "---",
        "succeeded": "--:",
        "95 % interval": "--:",
        "at the first attempt": "--:",
        "causes of failure": "---",
        "audits kept": "--:",
        "median cycle": "--:",
    }
    rows = [
        [f"`{found['task']}`", name.split("_")[1], *_evaluation(found)]
        for name, found in results.items()
    ]
    return _with_origin(heads, rows, results, "success_*")


def alone() -> str:
    """The stack in worlds that are wrong in one way: a row for each and each task."""
    results = {
        name: kept(name)
        for kind in ALONE
        for task in task_names()
        if is_kept(name := f"alone_{kind}_{task}")
    }
    if not results:
        return NOTHING
    heads = {
        "wrong": "---",
        "task": "---",
        "succeeded": "--:",
        "95 % interval": "--:",
        "at the first attempt": "--:",
        "causes of failure": "---",
        "audits kept": "--:",
        "median cycle": "--:",
    }
    rows = [
        [ALONE[kind].words, f"`{found['task']}`", *_evaluation(found)]
        for kind in ALONE
        for name, found in results.items()
        if name == f"alone_{kind}_{found['task']}"
    ]
    return _with_origin(heads, rows, results, "alone_*")


def success_short() -> str:
    """Success of the tasks: a row for each task, a column for each level that is kept."""
    return _matrix(
        "task",
        {task: {level: f"success_{level}_{task}" for level in LEVELS} for task in task_names()},
        "success_*",
    )


def robots() -> str:
    """Success of the robots: a row for each, a column for each task."""
    return _matrix(
        "robot",
        {
            robot: {task: f"robots_{robot}_{task}" for task in ROBOT_TASKS}
            for robot in robot_names()
        },
        "robots_*",
    )


def policies(name: str) -> str:
    """Policies on the same seeds, the first one as the baseline."""

    def rows(found: Result) -> Iterator[Result]:
        for one, against in zip(found["policies"], [None, *found["comparisons"]], strict=True):
            yield {**one, "against": "" if against is None else _difference(against)}

    return _table(
        name,
        rows,
        {
            "policy": lambda one: f"`{one['policy']}`",
            "succeeded": _counts,
            "95 % interval": _interval,
            "causes of failure": _causes,
            "against the first": lambda one: one["against"],
        },
        words=("policy", "causes of failure"),
    )


def solvers(name: str) -> str:
    """Inverse kinematics compared: a row for each solver and set of targets."""
    return _table(
        name,
        lambda found: found["rows"],
        {
            "targets": lambda row: f"`{row['targets']}`",
            "solver": lambda row: f"`{row['solver']}`",
            "of": lambda row: str(row["n"]),
            "reached": lambda row: f"{100 * row['success']:.1f} %",
            "95 % interval": _interval,
            "outside limits": lambda row: str(row["limit_violations"]),
            "median, p99": _times,
        },
        words=(
            "targets",
            "solver",
        ),
    )


def ablation() -> str:
    """What limits, damping and restarts are worth: success of each solver on each set."""
    if not is_kept("ablate_ik"):
        return NOTHING
    found = kept("ablate_ik")
    rates = {(row["targets"], row["solver"]): row["success"] for row in found["rows"]}
    columns = [(targets, restarts) for restarts in ("", "*") for targets in found["targets"]]
    heads = {"solver": "---", **{f"`{targets}`{mark}": "--:" for targets, mark in columns}}
    names = [name for name in found["solvers"] if not name.endswith("*")]
    rows = [
        [_law(name), *(f"{100 * rates[targets, name + mark]:.1f} %" for targets, mark in columns)]
        for name in names
    ]
    return _with_origin(heads, rows, {"ablate_ik": found})


def ablation_effects() -> str:
    """The paired differences of the ablation, for the damping by the error."""
    if not is_kept("ablate_ik"):
        return NOTHING
    found = kept("ablate_ik")
    heads = {"what": "---", **{f"`{targets}`": "--:" for targets in found["targets"]}}
    effects = {(one["targets"], one["from"], one["to"]): one for one in found["effects"]}
    rows = [
        [what, *(_points(effects[targets, *pair]) for targets in found["targets"])]
        for what, pair in _EFFECTS.items()
    ]
    return _with_origin(heads, rows, {"ablate_ik": found})


def free_axis(name: str) -> str:
    """Targets with the tool's angle fixed and free: a row for each solver."""
    return _table(
        name,
        _named,
        {
            "solver": lambda one: one["name"],
            "reached": lambda one: f"{one['reached']} of {one['of']}",
            "95 % interval": _interval,
            "outside limits": lambda one: str(one["outside_limits"]),
            "median, p99": _times,
        },
        words=("solver",),
    )


def same_step() -> str:
    """Steps of the solvers beside exact ones and those of mink: the largest differences."""
    kinds = {
        "from the exact step": "largest_from_exact_rad",
        "mink from the exact step": "largest_of_mink_from_exact_rad",
        "from mink": "largest_from_mink_rad",
        "from mink, refined": "largest_from_mink_refined_rad",
    }
    return _table(
        "same_step",
        lambda found: [{**one, "of": found["n"]} for one in _named(found)],
        {
            "solver": lambda one: f"`{one['name']}`",
            **{head: partial(_radians, kind) for head, kind in kinds.items()},
            "states with joints at limits": lambda one: (
                f"{one['states_with_joints_at_limits']} of {one['of']}"
            ),
        },
        words=("solver",),
    )


def streams() -> str:
    """DLS and the QP as streams on gliding targets: how often and how far each is too close."""
    return _table(
        "compare_streams",
        lambda found: [
            {**one, "of": found["ticks"]} for one in found["figures"] if one["targets"] == "gentle"
        ],
        {
            "robot": lambda one: f"`{one['robot']}`",
            "stream": lambda one: f"`{one['stream']}`",
            "ticks too close": lambda one: f"{one['clearance_violations']} of {one['of']}",
            "by at most": lambda one: f"{max(0.0, one['clearance_lacking_mm']):.1f} mm",
            "error of the tool, median, p95": lambda one: (
                f"{one['error_median_mm']:.2f}, {one['error_p95_mm']:.1f} mm"
            ),
        },
        words=(
            "robot",
            "stream",
        ),
    )


def motions() -> str:
    """Random motions: what was planned, refused and broken, a row for each robot and kind."""
    return _table(
        "check_motions",
        _named,
        {
            "robot and motion": lambda one: one["name"],
            "planned": lambda one: str(one["planned"]),
            "violations": lambda one: str(len(one["violations"])),
            "refused": lambda one: str(sum(one["refused"].values())),
            "not confirmed": lambda one: str(len(one["unconfirmed"])),
            "off its path": lambda one: f"{1e6 * one['off_m']:.2f} µm",
            "planning, median": lambda one: (
                "–" if one["plan_ms_median"] is None else f"{one['plan_ms_median']:.0f} ms"
            ),
        },
        words=("robot and motion",),
    )


def controllers(*conditions: str) -> str:
    """Errors of the controllers, a row for each under each condition; none named takes all."""
    return _table(
        "compare_controllers",
        lambda found: [
            {**one, "condition": condition, "controller": name}
            for condition, trials in found["trials"].items()
            if not conditions or condition.replace(" ", "_") in conditions
            for name, one in trials.items()
            if one["stable"]
        ],
        {
            "condition": lambda one: one["condition"],
            "controller": lambda one: f"`{one['controller']}`",
            "joints, moving": lambda one: f"{1e3 * one['max_joint_error_rad']:.3g} mrad",
            "tool, moving": lambda one: f"{1e3 * one['max_tool_error_m']:.3g} mm",
            "tool, at the end": lambda one: f"{1e3 * one['last_tool_error_m']:.2g} mm",
        },
        words=(
            "condition",
            "controller",
        ),
    )


def _table(
    name: str,
    rows: Callable[[Result], Iterable[Result]],
    columns: Mapping[str, Cell],
    *,
    words: Collection[str],
) -> str:
    """A table of one kept result: `words` to the left, numbers to the right, the origin below."""
    if not is_kept(name):
        return NOTHING
    found = kept(name)
    heads = {head: "---" if head in words else "--:" for head in columns}
    cells = [[cell(row) for cell in columns.values()] for row in rows(found)]
    return _with_origin(heads, cells, {name: found})


def _named(found: Result) -> list[Result]:
    """The figures of a result, each with its name."""
    return [{"name": name, **one} for name, one in found["figures"].items()]


def _times(row: Result) -> str:
    return f"{row['median_ms']:.2f}, {row['p99_ms']:.2f} ms"


def _radians(kind: str, row: Result) -> str:
    return f"{row[kind]:.1e} rad"


def _matrix(head: str, names: Mapping[str, Mapping[str, str]], files: str) -> str:
    """Success by row and column; rows and columns without a kept result are left out."""
    results = {name: kept(name) for row in names.values() for name in row.values() if is_kept(name)}
    if not results:
        return NOTHING
    columns = list(
        dict.fromkeys(
            column for row in names.values() for column, name in row.items() if name in results
        )
    )
    columns.sort(key=list(next(iter(names.values()))).index)
    heads = {head: "---", **{f"`{column}`": "--:" for column in columns}}
    rows = [
        [f"`{row}`", *(_rate(results.get(of[column])) for column in columns)]
        for row, of in names.items()
        if any(of[column] in results for column in columns)
    ]
    return _with_origin(heads, rows, results, files)


def _with_origin(
    heads: Mapping[str, str],
    rows: list[list[str]],
    results: Mapping[str, Result],
    files: str | None = None,
) -> str:
    return f"{markdown_table(heads, rows)}\n\n{origin_line(results, files)}"


def _evaluation(result: Result) -> list[str]:
    cycle = result["figures"].get("cycle_time_s", {}).get("median")
    first = result["first_attempts"]
    return [
        _counts(result),
        _interval(result),
        "–" if first is None else str(first),
        _causes(result),
        str(result["judged"] - result["broken_audits"]),
        "–" if cycle is None else f"{cycle:.1f} s",
    ]


def _rate(result: Result | None) -> str:
    if result is None:
        return "–"
    told, broken = f"{_counts(result)} ({_interval(result)})", result["broken_audits"]
    return f"{told}, audit kept in {result['judged'] - broken}" if broken else told


def _counts(result: Result) -> str:
    return f"{result['successes']} of {result['judged']}"


def _interval(result: Result) -> str:
    low, high = (100 * bound for bound in result["interval"])
    return f"{low:.1f}–{high:.1f} %"


def _causes(result: Result) -> str:
    return ", ".join(f"{cause} {count}" for cause, count in result["causes"].items()) or "–"


def _difference(comparison: Result) -> str:
    """Return a paired difference of success; its p is corrected where several are compared."""
    low, high = (100 * bound for bound in comparison["interval"])
    p = comparison.get("p_holm", comparison["p"])
    return f"{100 * comparison['difference']:+.1f} points ({low:+.1f} to {high:+.1f}), p = {p:.2g}"


def _points(effect: Result) -> str:
    low, high = effect["interval"]
    return f"{effect['points']:+.1f} ({low:.1f} to {high:.1f})"


def _law(name: str) -> str:
    """Return the name of a solver of the ablation in words."""
    law, _, steps = name.partition(", ")
    return f"{_LAWS[law]}: {steps}" if steps else _LAWS.get(law, f"`{name}`")


TABLES: dict[str, Callable[..., str]] = {
    "success": success,
    "alone": alone,
    "success_short": success_short,
    "robots": robots,
    "policies": policies,
    "solvers": solvers,
    "ablation": ablation,
    "ablation_effects": ablation_effects,
    "free_axis": free_axis,
    "same_step": same_step,
    "streams": streams,
    "motions": motions,
    "controllers": controllers,
    "franka_clients": franka_clients,
    "judge_franka": franka,
    "judge_robosuite": robosuite,
    "mutants": mutants,
}
"""What writes a table, by the name that a page gives."""
