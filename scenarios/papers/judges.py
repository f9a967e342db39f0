"""Tables of outside judges, each made from kept results."""

from collections.abc import Mapping
from typing import Any

from scenarios.papers.blocks import markdown_table
from scenarios.papers.kept import is_kept, kept, origin_line

_LEARNED = {"Lift": "100", "PickPlaceCan": "100", "NutAssemblySquare": "84", "ToolHang": "19.3"}
"""Success of BC-RNN from proficient humans' demonstrations, low-dimensional observations [%]
(Mandlekar et al., What Matters in Learning from Offline Human Demonstrations, CoRL 2021, table 1:
means of three seeds, each with its best checkpoint)."""


def robosuite() -> str:
    """robosuite's tasks: a row for each, without and with noise on the poses."""
    if not is_kept("judge_robosuite"):
        return "No result of this kind is kept yet."
    found = kept("judge_robosuite")
    heads = {
        "task": "---",
        "noise on poses": "---",
        "succeeded": "--:",
        "95 % interval": "--:",
        "causes of failure": "---",
        "median cycle": "--:",
        "largest speed": "--:",
        "motors at their limit": "--:",
        "BC-RNN": "--:",
        "seeds": "--:",
        "commit": "---",
    }
    rows = [_row(row) for row in found["rows"]]
    return f"{markdown_table(heads, rows)}\n\n{origin_line({'judge_robosuite': found})}"


def _row(row: Mapping[str, Any]) -> list[str]:
    low, high = (100 * bound for bound in row["interval"])
    causes = ", ".join(f"{cause} {count}" for cause, count in row["causes"].items())
    learned = "" if row["noise"] else _LEARNED.get(row["task"], "")
    return [
        f"`{row['task']}`",
        "2 mm, 2°" if row["noise"] else "none",
        f"{row['successes']} of {row['judged']}",
        f"{low:.1f}–{high:.1f} %",
        causes or "–",
        "–" if row["seconds"] is None else f"{row['seconds']:.1f} s",
        "–" if row["speed"] is None else f"{100 * row['speed']:.0f} %",
        "–" if row["saturated"] is None else f"{100 * row['saturated']:.1f} %",
        f"{learned} %" if learned else "–",
        "{}–{}".format(*row["seeds"]),
        f"`{row['commit'][:7]}`",
    ]


def franka() -> str:
    """franka-sim's motions: a row for each kind."""
    if not is_kept("judge_franka"):
        return "No result of this kind is kept yet."
    found = kept("judge_franka")
    heads = {
        "motions": "---",
        "made": "--:",
        "commands in time: least, median": "--:",
        "largest joint error": "--:",
        "rms": "--:",
        "within 2 mrad": "--:",
        "in even time": "--:",
        "of these within 2 mrad": "--:",
        "longest period": "--:",
    }
    rows = [_motions(row) for row in found["rows"] if row["done"]]
    low, high = found["seeds"]
    priority = "with" if all(found["real_time"].values()) else "without"
    told = (
        f"Reflexes: {found['reflexes']}; runs that stopped: {len(found['stops'])}. Pace "
        f"{found['pace']:g}, {priority} real-time priority, seeds {low} to {high}; the clock of "
        f"franka-sim at {found.get('clock', 1.0):g} of its pace. "
    )
    # Judgements from before a slower clock was possible tell neither.
    worse = "; ".join(_worse(motion) for motion in found.get("worse", ()))
    told += origin_line({"judge_franka": found})
    told += f"\n\nTracked worse: {worse}." if worse else ""
    return f"{markdown_table(heads, rows)}\n\n{told}"


def _worse(motion: Mapping[str, Any]) -> str:
    return (
        f"motion {motion['motion']} of seed {motion['seed']} ({motion['kind']}, joint "
        f"{motion['joint']}: {motion['largest']:.2f} mrad, longest period "
        f"{1e3 * motion['jump']:.1f} ms, {motion['lost']} commands late)"
    )


def franka_clients() -> str:
    """Scripts of other clients of libfranka that pick in our world: a row for each."""
    if not is_kept("franka_clients"):
        return "No result of this kind is kept yet."
    found = kept("franka_clients")
    heads = {"client": "---", "picked and placed": "--:"}
    rows = [[f"`{row['client']}`", f"{row['done']} of {row['episodes']}"] for row in found["rows"]]
    first, last = found["seeds"]
    seeds = f"Seeds {first} to {last}. "
    return f"{markdown_table(heads, rows)}\n\n{seeds}{origin_line({'franka_clients': found})}"


def _motions(row: Mapping[str, Any]) -> list[str]:
    return [
        row["kind"],
        str(row["done"]),
        f"{row['rate_min']:.2f}, {row['rate_median']:.2f}",
        f"{row['largest']:.2f} mrad",
        f"{row['rms']:.2f} mrad",
        f"{row['within']}",
        f"{row['even']}",
        f"{row['even_within']}",
        f"{row['jump']:.1f} ms",
    ]
