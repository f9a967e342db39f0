"""The tables that README and documentation hold, each made from kept results."""

from collections.abc import Callable, Mapping
from typing import Any

from robo47_qp.evaluation.perturbation import PRESETS
from robo47_qp.evaluation.policies import policy_settings
from robo47_qp.files import plain
from robo47_qp.model.robots import robot_names
from robo47_qp.run.registry import task_names
from robo47_qp.stack import ClassicalStack
from scenarios.papers.blocks import markdown_table
from scenarios.papers.kept import is_kept, kept, origin_line

NOTHING = "No result of this kind is kept yet."
LEVELS = tuple(PRESETS)
ROBOT_TASKS = ("pick_place", "reach", "obstacle_reach")
_LAWS = {
    "textbook": "DLS of textbooks, λ = 0.05, clipped",
    "by error": "λ² = 0.1 ‖e‖²",
    "constant": "λ = 0.02",
    "singular": "near singularities",
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
    if not is_kept(name):
        return NOTHING
    found = kept(name)
    heads = {
        "policy": "---",
        "succeeded": "--:",
        "95 % interval": "--:",
        "causes of failure": "---",
        f"against `{found['baseline']}`": "--:",
    }
    against = ["", *(_difference(one) for one in found["comparisons"])]
    rows = [
        [f"`{one['policy']}`", _counts(one), _interval(one), _causes(one), told]
        for one, told in zip(found["policies"], against, strict=True)
    ]
    return _with_origin(heads, rows, {name: found})


def solvers(name: str) -> str:
    """Inverse kinematics compared: a row for each solver and set of targets."""
    if not is_kept(name):
        return NOTHING
    found = kept(name)
    heads = {
        "targets": "---",
        "solver": "---",
        "of": "--:",
        "reached": "--:",
        "95 % interval": "--:",
        "outside limits": "--:",
        "median, p99": "--:",
    }
    rows = [
        [
            f"`{row['targets']}`",
            f"`{row['solver']}`",
            str(row["n"]),
            f"{100 * row['success']:.1f} %",
            _interval(row),
            str(row["limit_violations"]),
            f"{row['median_ms']:.2f}, {row['p99_ms']:.2f} ms",
        ]
        for row in found["rows"]
    ]
    return _with_origin(heads, rows, {name: found})


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
    asked = {
        "tuned damping, clipped DLS": ("textbook", "by error, clipped"),
        "clipping over free steps": ("by error, free", "by error, clipped"),
        "bounds in the QP over clipping": ("by error, clipped", "by error, box"),
        "the same with a constant λ": ("constant, clipped", "constant, box"),
        "the same with restarts": ("by error, clipped*", "by error, box*"),
        "restarts, clipped DLS": ("by error, clipped", "by error, clipped*"),
        "restarts, box": ("by error, box", "by error, box*"),
    }
    effects = {(one["targets"], one["from"], one["to"]): one for one in found["effects"]}
    rows = [
        [what, *(_points(effects[targets, *pair]) for targets in found["targets"])]
        for what, pair in asked.items()
    ]
    return _with_origin(heads, rows, {"ablate_ik": found})


def free_axis(name: str) -> str:
    """Targets with the tool's angle fixed and free: a row for each solver."""
    if not is_kept(name):
        return NOTHING
    found = kept(name)
    heads = {
        "solver": "---",
        "reached": "--:",
        "95 % interval": "--:",
        "outside limits": "--:",
        "median, p99": "--:",
    }
    rows = [
        [
            what,
            f"{one['reached']} of {one['of']}",
            _interval(one),
            str(one["outside_limits"]),
            f"{one['median_ms']:.2f}, {one['p99_ms']:.2f} ms",
        ]
        for what, one in found["figures"].items()
    ]
    return _with_origin(heads, rows, {name: found})


def same_step() -> str:
    """Steps of the solvers beside exact ones and those of mink: the largest differences."""
    if not is_kept("same_step"):
        return NOTHING
    found = kept("same_step")
    heads = {
        "solver": "---",
        "from the exact step": "--:",
        "mink from the exact step": "--:",
        "from mink": "--:",
        "states with joints at limits": "--:",
    }
    kinds = ("largest_from_exact_rad", "largest_of_mink_from_exact_rad", "largest_from_mink_rad")
    rows = [
        [
            f"`{what}`",
            *(f"{one[kind]:.1e} rad" for kind in kinds),
            f"{one['states_with_joints_at_limits']} of {found['n']}",
        ]
        for what, one in found["figures"].items()
    ]
    return _with_origin(heads, rows, {"same_step": found})


def streams() -> str:
    """DLS and the QP as streams on gliding targets: how often and how far each is too close."""
    if not is_kept("compare_streams"):
        return NOTHING
    found = kept("compare_streams")
    heads = {
        "robot": "---",
        "stream": "---",
        "ticks too close": "--:",
        "by at most": "--:",
        "error of the tool, median, p95": "--:",
    }
    rows = [
        [
            f"`{one['robot']}`",
            f"`{one['stream']}`",
            f"{one['clearance_violations']} of {found['ticks']}",
            f"{max(0.0, one['clearance_lacking_mm']):.1f} mm",
            f"{one['error_median_mm']:.2f}, {one['error_p95_mm']:.1f} mm",
        ]
        for one in found["figures"]
        if one["targets"] == "gentle"
    ]
    return _with_origin(heads, rows, {"compare_streams": found})


def motions() -> str:
    """Random motions: what was planned, refused and broken, a row for each robot and kind."""
    if not is_kept("check_motions"):
        return NOTHING
    found = kept("check_motions")
    heads = {
        "robot and motion": "---",
        "planned": "--:",
        "violations": "--:",
        "refused": "--:",
        "not confirmed": "--:",
        "off its path": "--:",
        "planning, median": "--:",
    }
    rows = [
        [
            what,
            str(one["planned"]),
            str(len(one["violations"])),
            str(sum(one["refused"].values())),
            str(len(one["unconfirmed"])),
            f"{1e6 * one['off_m']:.2f} µm",
            "–" if one["plan_ms_median"] is None else f"{one['plan_ms_median']:.0f} ms",
        ]
        for what, one in found["figures"].items()
    ]
    return _with_origin(heads, rows, {"check_motions": found})


def controllers(*conditions: str) -> str:
    """Errors of the controllers, a row for each under each condition; none named takes all."""
    if not is_kept("compare_controllers"):
        return NOTHING
    found = kept("compare_controllers")
    heads = {
        "condition": "---",
        "controller": "---",
        "joints, moving": "--:",
        "tool, moving": "--:",
        "tool, at the end": "--:",
    }
    rows = [
        [
            condition,
            f"`{name}`",
            f"{1e3 * one['max_joint_error_rad']:.3g} mrad",
            f"{1e3 * one['max_tool_error_m']:.3g} mm",
            f"{1e3 * one['last_tool_error_m']:.2g} mm",
        ]
        for condition, trials in found["trials"].items()
        if not conditions or condition.replace(" ", "_") in conditions
        for name, one in trials.items()
        if one["stable"]
    ]
    return _with_origin(heads, rows, {"compare_controllers": found})


def _success_name(result: Mapping[str, Any]) -> str:
    """Return the name of an evaluation with the defaults in one of the levels."""
    level = _level(result)
    return "none of those" if level is None else f"success_{level}_{result['task']}"


def _robots_name(result: Mapping[str, Any]) -> str:
    """Return the name of an evaluation of a robot without perturbations."""
    robot = result["settings"]["robot"]
    return f"robots_{robot}_{result['task']}" if _level(result) == "none" else "none of those"


def _level(result: Mapping[str, Any]) -> str | None:
    """Return the level of an evaluation of the default stack; None for any other."""
    settings = result["settings"]
    if settings["policy"] != policy_settings(ClassicalStack(), None):
        return None
    found = settings["perturbation"]
    return next((name for name, level in PRESETS.items() if plain(level) == found), None)


OWN_NAMES: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "success": _success_name,
    "robots": _robots_name,
}
"""What the kept evaluations of the tables `success` and `robots` are called, by their beginning."""


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
    results: Mapping[str, Mapping[str, Any]],
    files: str | None = None,
) -> str:
    return f"{markdown_table(heads, rows)}\n\n{origin_line(results, files)}"


def _evaluation(result: Mapping[str, Any]) -> list[str]:
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


def _rate(result: Mapping[str, Any] | None) -> str:
    return "–" if result is None else f"{_counts(result)} ({_interval(result)})"


def _counts(result: Mapping[str, Any]) -> str:
    return f"{result['successes']} of {result['judged']}"


def _interval(result: Mapping[str, Any]) -> str:
    low, high = (100 * bound for bound in result["interval"])
    return f"{low:.1f} – {high:.1f} %"


def _causes(result: Mapping[str, Any]) -> str:
    return ", ".join(f"{cause} {count}" for cause, count in result["causes"].items()) or "–"


def _difference(comparison: Mapping[str, Any]) -> str:
    """Return a paired difference of success; its p is corrected where several are compared."""
    low, high = (100 * bound for bound in comparison["interval"])
    p = comparison.get("p_holm", comparison["p"])
    return f"{100 * comparison['difference']:+.1f} points ({low:+.1f} to {high:+.1f}), p = {p:.2g}"


def _points(effect: Mapping[str, Any]) -> str:
    low, high = effect["interval"]
    return f"{effect['points']:+.1f} ({low:.1f} to {high:.1f})"


def _law(name: str) -> str:
    """Return the name of a solver of the ablation in words."""
    law, _, steps = name.partition(", ")
    return f"{_LAWS[law]}: {steps}" if steps else _LAWS.get(law, f"`{name}`")


TABLES: dict[str, Callable[..., str]] = {
    "success": success,
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
}
"""What writes a table, by the name that a page gives."""
