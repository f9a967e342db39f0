"""The tables of evaluations: how often tasks succeed, by world, robot and policy."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping

from robo47_qp.evaluation.benchmarks.robustness.curves import Curve
from robo47_qp.evaluation.perturbation import PRESETS
from robo47_qp.model.robots import robot_names
from robo47_qp.run.registry import task_names
from scenarios.papers.kept import is_kept, kept
from scenarios.papers.names import ALONE
from scenarios.papers.rows import NOTHING, Result, interval, table, with_origin

LEVELS = tuple(PRESETS)
ROBOT_TASKS = ("pick_place", "reach", "obstacle_reach")


def success() -> str:
    """Success of the tasks: a row for each task and level of perturbation that is kept."""
    return _by_task("perturbation", _levels(), "success_*")


def tracking(head: str, worlds: str) -> str:
    """What the arm did in successes: a row for each kept evaluation of the tasks or worlds.

    Args:
        head: What the world is called.
        worlds: `success`, or `alone` for those that are wrong in one way.
    """
    names = _levels() if worlds == "success" else _alone()
    results = {name: kept(name) for name in names if is_kept(name)}
    if not results:
        return NOTHING
    heads = {"task": "---", head: "---", **dict.fromkeys(_TRACKED, "--:")}
    rows = [
        [f"`{found['task']}`", names[name], *(cell(found) for cell in _TRACKED.values())]
        for name, found in results.items()
    ]
    return with_origin(heads, rows, results, f"{worlds}_*")


def _spread(figure: str, scale: float, *, less_one: bool = False) -> Callable[[Result], str]:
    """Return what tells the median and the worst of a figure over episodes."""

    def told(result: Result) -> str:
        if figure not in result["figures"]:
            return "–"
        found = [scale * result["figures"][figure][name] for name in ("median", "max")]
        return ", ".join(f"{max(1.0 - one, 0.0) if less_one else one:.2f}" for one in found)

    return told


def _longest_not_judged(result: Result) -> str:
    """Return what the audit did not judge for the longest time: median, and most."""
    told = result.get("not_judged")
    if not told:
        return "–" if told is None else "nothing"
    one = max(told, key=lambda it: it["median_share"])
    return f"{one['signal']}: {100 * one['median_share']:.0f}, {100 * one['max_share']:.0f} %"


_TRACKED = {
    "joint error [mrad]": _spread("max_joint_error_rad", 1e3),
    "tool error [mm]": _spread("max_tool_error_m", 1e3),
    "contact force on the tool [N]": _spread("peak_contact_force_N", 1.0),
    "slip margin": _spread("max_friction_use", 1.0, less_one=True),
    "not judged for the longest time": _longest_not_judged,
}


def broken() -> str:
    """What broke audits, and in how many episodes: a row for each evaluation in which any was."""
    levels = _levels()
    results = {name: kept(name) for name in levels if is_kept(name)}
    results = {name: found for name, found in results.items() if found["broken"]}
    if not results:
        return NOTHING
    heads = {"task": "---", "perturbation": "---", "audits broken": "--:", "by": "---"}
    rows = [
        [f"`{found['task']}`", levels[name], str(len(found["broken"])), _breaking(found)]
        for name, found in results.items()
    ]
    return with_origin(heads, rows, results, "success_*")


def _breaking(result: Result) -> str:
    """Return the limits that were broken, of any joint or motion, the most frequent one first."""
    episodes = result["broken"].values()
    counts = Counter(limit for one in episodes for limit in {it.split(" (")[0] for it in one})
    told = sorted(counts.items(), key=lambda one: (-one[1], one[0]))
    return ", ".join(f"{limit} {count}" for limit, count in told)


def alone() -> str:
    """The stack in worlds that are wrong in one way: a row for each of them and each task."""
    return _by_task("wrong", _alone(), "alone_*")


def _levels() -> dict[str, str]:
    return {f"success_{level}_{task}": level for level in LEVELS for task in task_names()}


def _alone() -> dict[str, str]:
    return {
        f"alone_{kind}_{task}": one.words for kind, one in ALONE.items() for task in task_names()
    }


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


def robustness(name: str) -> str:
    """Where half of the episodes are lost: a row for each kind of wrongness, a column per stack."""
    if not is_kept(name):
        return NOTHING
    found = kept(name)
    curves = curves_of(name)
    stacks = list(dict.fromkeys(curve.stack for curve in curves))
    heads = {"alone": "---", **{f"`{stack}`": "--:" for stack in stacks}}
    rows = {kind: [_with_unit(kind, unit)] for kind, unit in found["units"].items()}
    for curve in curves:
        rows[curve.kind].append(curve.half_told)
    return with_origin(heads, list(rows.values()), {name: found})


def curves_of(name: str) -> list[Curve]:
    """Return the curves of a kept campaign of robustness."""
    return [Curve.from_json(curve) for curve in kept(name)["curves"]]


def _with_unit(kind: str, unit: str) -> str:
    option = f"`--{kind.replace('_', '-')}`"
    return option if unit == "-" else f"{option} [{unit}]"


def policies(name: str) -> str:
    """Policies on the same seeds, the first one as the baseline."""

    def rows(found: Result) -> Iterator[Result]:
        for one, against in zip(found["policies"], [None, *found["comparisons"]], strict=True):
            yield {**one, "against": "" if against is None else _difference(against)}

    return table(
        name,
        rows,
        {
            "policy": lambda one: f"`{one['policy']}`",
            "succeeded": _counts,
            "95 % interval": interval,
            "causes of failure": _causes,
            "against the first": lambda one: one["against"],
        },
        words=("policy", "causes of failure"),
    )


def _by_task(head: str, worlds: Mapping[str, str], files: str) -> str:
    """A row for each kept evaluation: its task, and its world under `head`.

    Args:
        head: What the world is called.
        worlds: The words for the world, by the name of the result.
        files: Pattern of the files.
    """
    results = {name: kept(name) for name in worlds if is_kept(name)}
    if not results:
        return NOTHING
    heads = {
        "task": "---",
        head: "---",
        "succeeded": "--:",
        "95 % interval": "--:",
        "at the first attempt": "--:",
        "causes of failure": "---",
        "audits kept": "--:",
        "median cycle": "--:",
        "first seed": "--:",
        "commit": "---",
    }
    rows = [
        [f"`{found['task']}`", worlds[name], *_evaluation(found)] for name, found in results.items()
    ]
    return with_origin(heads, rows, results, files)


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
    return with_origin(heads, rows, results, files)


def _evaluation(result: Result) -> list[str]:
    cycle = result["figures"].get("cycle_time_s", {}).get("median")
    first = result["first_attempts"]
    return [
        _counts(result),
        interval(result),
        "–" if first is None else str(first),
        _causes(result),
        str(_audits_kept(result)),
        "–" if cycle is None else f"{cycle:.1f} s",
        str(result["seeds"][0]),
        f"`{result['commit'][:7]}`",
    ]


def _rate(result: Result | None) -> str:
    if result is None:
        return "–"
    told, audits = f"{_counts(result)} ({interval(result)})", _audits_kept(result)
    return told if audits == result["judged"] else f"{told}, audit kept in {audits}"


def _audits_kept(result: Result) -> int:
    """Return in how many episodes the audit was kept.

    Results of before do not tell it: those without an audit count there, too.
    """
    return int(result.get("audits_kept", result["judged"] - result["broken_audits"]))


def _counts(result: Result) -> str:
    told, errors = f"{result['successes']} of {result['judged']}", result.get("errors", 0)
    return f"{told}, {errors} ended by errors of ours" if errors else told


def _causes(result: Result) -> str:
    return ", ".join(f"{cause} {count}" for cause, count in result["causes"].items()) or "–"


def _difference(comparison: Result) -> str:
    """Return a paired difference of success; its p is corrected where several are compared."""
    low, high = (100 * bound for bound in comparison["interval"])
    p = comparison.get("p_holm", comparison["p"])
    return f"{100 * comparison['difference']:+.1f} points ({low:+.1f} to {high:+.1f}), p = {p:.2g}"
