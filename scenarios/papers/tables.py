"""The tables that README and documentation hold, each made from kept results."""

from collections.abc import Callable
from functools import partial

from robo47_qp.errors import RecordingError
from scenarios.papers.evaluations import (
    alone,
    broken,
    policies,
    robots,
    robustness,
    success,
    success_short,
    tracking,
)
from scenarios.papers.judges import franka, franka_clients, robosuite
from scenarios.papers.kept import is_kept, kept
from scenarios.papers.mutants import mutants
from scenarios.papers.rows import NOTHING, Result, interval, table, with_origin

_LAWS = {
    "constant": "λ constant",
    "by error": "λ by the error",
    "singular": "λ larger near singularities",
}
_TEXTBOOK = {
    "textbook": "DLS of textbooks, clipped",
    "textbook free": "DLS of textbooks, free",
}
_EFFECTS = {
    "tuned settings, clipped DLS": ("textbook", "{law}, clipped"),
    "clipping over free steps": ("{law}, free", "{law}, clipped"),
    "bounds in the QP over clipping": ("{law}, clipped", "{law}, box"),
    "the same with restarts": ("{law}, clipped*", "{law}, box*"),
    "`qp` over clipped DLS": ("{law}, clipped", "qp"),
    "the same with restarts, each with its best settings": ("{law}, clipped*", "qp*"),
    "restarts, clipped DLS": ("{law}, clipped", "{law}, clipped*"),
    "restarts, box": ("{law}, box", "{law}, box*"),
}


def solvers(name: str) -> str:
    """Inverse kinematics compared: a row for each solver and set of targets."""
    columns = {
        "targets": lambda row: f"`{row['targets']}`",
        "solver": lambda row: f"`{row['solver']}`",
        "of": lambda row: str(row["n"]),
        "reached": lambda row: f"{100 * row['success']:.1f} %",
        "95 % interval": interval,
        "outside limits": lambda row: str(row["limit_violations"]),
        "median, p99": _times,
    }
    if is_kept(name) and any(row["in_vain_median_ms"] for row in kept(name)["rows"]):
        columns["median in vain"] = _in_vain
    return table(name, lambda found: found["rows"], columns, words=("targets", "solver"))


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
    return with_origin(heads, rows, {"ablate_ik": found})


def ablation_settings() -> str:
    """The settings of DLS that the sweeps of the ablation chose."""
    if not is_kept("ablate_ik"):
        return NOTHING
    found = kept("ablate_ik")
    rows = [
        [
            name,
            _setting(found["solvers"][f"{law}, clipped"]),
            _setting(found["solvers"][f"{law}, clipped*"]["solver"]),
        ]
        for law, name in _LAWS.items()
    ]
    heads = {"damping": "---", "from one start": "---", "with restarts": "---"}
    return with_origin(heads, rows, {"ablate_ik": found})


def ablation_effects() -> str:
    """The paired differences of the ablation, for each law of damping."""
    if not is_kept("ablate_ik"):
        return NOTHING
    found = kept("ablate_ik")
    heads = {"what": "---", "damping": "---"}
    heads |= {f"`{targets}`": "--:" for targets in found["targets"]}
    effects = {(one["targets"], one["from"], one["to"]): one for one in found["effects"]}
    rows = []
    for what, (a, b) in _EFFECTS.items():
        for law, name in _LAWS.items():
            pair = a.format(law=law), b.format(law=law)
            told = [_points(effects[targets, *pair]) for targets in found["targets"]]
            rows.append([what, name, *told])
    return with_origin(heads, rows, {"ablate_ik": found})


def free_axis(name: str) -> str:
    """Targets with the tool's angle fixed and free: a row for each solver."""
    return table(
        name,
        _named,
        {
            "solver": lambda one: one["name"],
            "reached": lambda one: f"{one['reached']} of {one['of']}",
            "95 % interval": interval,
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
    return table(
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
    return table(
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
    return table(
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
    """Errors of the controllers, a row for each under each condition; none named takes all.

    Raises:
        RecordingError: A condition was not measured.
    """

    def rows(found: Result) -> list[Result]:
        trials = {name.replace(" ", "_"): one for name, one in found["trials"].items()}
        missing = [name for name in conditions if name not in trials]
        if missing:
            raise RecordingError(
                f"docs/results/compare_controllers.json has no condition {', '.join(missing)}; "
                f"there are: {', '.join(trials)}."
            )
        return [
            {**one, "condition": name.replace("_", " "), "controller": controller}
            for name in conditions or trials
            for controller, one in trials[name].items()
            if one["stable"]
        ]

    return table(
        "compare_controllers",
        rows,
        {
            "condition": lambda one: one["condition"],
            "controller": lambda one: f"`{one['controller']}`",
            "joints, moving": lambda one: f"{1e3 * one['max_joint_error_rad']:.3g} mrad",
            "on the last leg": lambda one: f"{1e3 * one['max_joint_error_again_rad']:.3g} mrad",
            "tool, moving": lambda one: f"{1e3 * one['max_tool_error_m']:.3g} mm",
            "tool, at the end": lambda one: f"{1e3 * one['last_tool_error_m']:.2g} mm",
        },
        words=(
            "condition",
            "controller",
        ),
    )


def _named(found: Result) -> list[Result]:
    """The figures of a result, each with its name."""
    return [{"name": name, **one} for name, one in found["figures"].items()]


def _times(row: Result) -> str:
    return f"{row['median_ms']:.2f}, {row['p99_ms']:.2f} ms"


def _in_vain(row: Result) -> str:
    """The time spent on a target that none reached; – where there is none."""
    return f"{row['in_vain_median_ms']:.1f} ms" if row["in_vain_median_ms"] else "–"


def _radians(kind: str, row: Result) -> str:
    return f"{row[kind]:.1e} rad"


def _points(effect: Result) -> str:
    low, high = effect["interval"]
    return f"{effect['points']:+.1f} ({low:.1f} to {high:.1f})"


def _law(name: str) -> str:
    """Return the name of a solver of the ablation in words."""
    law, _, steps = name.partition(", ")
    return f"{_LAWS[law]}: {steps}" if steps else _TEXTBOOK.get(law, f"`{name}`")


def _setting(dls: Result) -> str:
    """Return the settings of a DLS in words."""
    law = dls["damping"]
    parts = [
        f"{sign} = {law[field]:g}"
        for field, sign in (("constant", "λ"), ("per_error", "λ²/‖e‖²"))
        if law[field]
    ]
    if law["singular"]:
        parts.append(f"{law['singular']:g} more at w = 0, from w = {law['threshold']:g} on")
    if dls["longest"] != "inf":
        parts.append(f"error clamped to {dls['longest']:g} m, {dls['widest']:g} rad")
    if dls["centring"]:
        parts.append(f"centring {dls['centring']:g}")
    return ", ".join(parts)


def costs() -> str:
    """What the parts of a control period cost, and a decision of a policy."""
    return table(
        "step_cost",
        lambda found: [
            *({"part": part, "us": us} for part, us in found["all_us"].items()),
            {"part": "a decision of a policy in this process", "us": found["decision_us"]},
            {"part": "the same in its own", "us": found["decision_own_process_us"]},
        ],
        {"part": lambda one: one["part"], "µs": lambda one: f"{one['us']:.1f}"},
        words=("part",),
    )


TABLES: dict[str, Callable[..., str]] = {
    "success": success,
    "alone": alone,
    "tracking": tracking,
    "broken": broken,
    "success_short": success_short,
    "robots": robots,
    "robustness": robustness,
    "policies": policies,
    "solvers": solvers,
    "ablation": ablation,
    "ablation_settings": ablation_settings,
    "ablation_effects": ablation_effects,
    "free_axis": free_axis,
    "same_step": same_step,
    "streams": streams,
    "motions": motions,
    "controllers": controllers,
    "costs": costs,
    "franka_clients": franka_clients,
    "judge_franka": franka,
    "judge_robosuite": robosuite,
    "mutants": mutants,
}
"""What writes a table, by the name that a page gives."""
