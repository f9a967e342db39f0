"""Compare the figures of the last runs with those kept in the repository, and write RETRO.md.

Reads what `make reproduce` leaves in logs/ and what docs/reproduced.json keeps. With --keep, the
figures of the last runs become the kept ones instead.
"""

import platform
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from robo47_qp.report.importing import importing

with importing():
    from rich.console import Console
    from rich.markup import escape

    from robo47_qp.cli import FAILED, LOGS, OK, main
    from robo47_qp.errors import RecordingError
    from robo47_qp.files import read_json, write_json
    from robo47_qp.report.terminal import print_files
    from scenarios.reproduce.comparison import compare
    from scenarios.reproduce.page import comparison_page, outcome, row

ROOT = Path(__file__).resolve().parents[1]
REPORTS = {
    "settling": "settling.json",
    "cartpole_lqr": "cartpole_lqr.json",
    "pickplace": "run.json",
}
"""Reports in logs/, by the scenario that writes them."""
OF_THE_CLOCK = ("pickplace/real_time_factor", "pickplace/step_us")
"""Metrics that tell how fast and how busy the machine is, not what the robot did."""
_NOTES = (
    "Kept figures are those of `docs/reproduced.json`; `make keep` renews them.",
    "Left out are the effort of the inverse kinematics (iterations, residuals below its "
    "tolerance, time), the instants of extremes, and which joint comes closest to a limit: "
    "rounding decides between equals.",
)


@dataclass(frozen=True, kw_only=True)
class RetroOptions:
    """Options of this scenario."""

    logs: Path = LOGS
    """Folder with the reports of the last runs."""
    kept: Path = ROOT / "docs" / "reproduced.json"
    """File with the figures that the repository keeps."""
    out: Path = ROOT / "RETRO.md"
    """File for the comparison."""
    commit: str = "this folder"
    """What was run, for the reader of the comparison."""
    keep: bool = False
    """Keep the figures of the last runs from now on, and compare nothing."""


def figures(reports: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """Every figure that is kept, as "scenario/figure".

    These are all metrics of every report and, of the main job, whether it succeeded, how many
    promises the audit found broken, the extreme of each promise, and the planned durations.
    The joint that comes closest to a limit is left out: where several do, rounding decides.

    Raises:
        RecordingError: A report lacks a part, or a figure is not a number.
    """
    found: list[tuple[str, object]] = []
    scenario = ""
    try:
        for scenario, report in reports.items():
            figures = [*report["metrics"].items()]
            if scenario == "pickplace":
                figures += _of_main_job(report)
            found += [(f"{scenario}/{name}", value) for name, value in figures]
    except (KeyError, TypeError, AttributeError) as error:
        raise RecordingError(
            f"The report of {scenario} is not as expected: {error!r}. Make it: make reproduce"
        ) from error
    names = [name for name, _ in found]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise RecordingError(f"The reports tell figures twice: {', '.join(twice)}.")
    return {name: _number(name, value) for name, value in found}


def machine() -> dict[str, str]:
    """What the last bits of a computation depend on, besides the versions of the packages."""
    processor, flags = platform.processor() or "unknown", ""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        lines = cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines()
        fields = {k.strip(): v.strip() for k, _, v in (line.partition(":") for line in lines)}
        processor = fields.get("model name", processor)
        flags = fields.get("flags", fields.get("Features", ""))
    return {
        "processor": f"{platform.machine()}, {processor}",
        "instructions": sha256(" ".join(sorted(flags.split())).encode()).hexdigest()[:12],
        "system": f"{platform.system()}, {' '.join(platform.libc_ver())}".strip(", "),
    }


def _check_main_job(reports: Mapping[str, Mapping[str, Any]]) -> None:
    """Check that figures to keep are those of the main job, and its studies of one commit.

    Raises:
        RecordingError: They are not.
    """
    job = reports["pickplace"]
    if job.get("task") != "pick_place" or job.get("seed") is not None or not job.get("audit"):
        found = f"{job.get('task')} with seed {job.get('seed')}"
        raise RecordingError(f"The last run is not the main job, but {found}: make reproduce.")
    commits = {reports[study].get("commit") for study in ("settling", "cartpole_lqr")}
    if len(commits) > 1:
        raise RecordingError("The two studies are of different commits: make reproduce.")


def run(options: RetroOptions, console: Console) -> int:
    """Keep or compare; returns the exit code."""
    reports = {
        scenario: read_json(options.logs / name, "Make it first: make reproduce")
        for scenario, name in REPORTS.items()
    }
    measured = figures(reports)
    here = {**machine(), **_packages(reports["pickplace"])}
    if options.keep:
        _check_main_job(reports)
        if not (measured["pickplace/succeeded"] and not measured["pickplace/promises broken"]):
            raise RecordingError("The last main job failed, or broke a promise: not to be kept.")
        write_json(options.kept, {"machine": here, "figures": measured})
        console.print(f"{len(measured)} figures kept")
        print_files(console, {"figures": options.kept})
        return OK
    kept = read_json(options.kept, "Make it: make keep")
    there, before = kept.get("machine"), kept.get("figures")
    if not isinstance(there, dict) or not isinstance(before, dict):
        raise RecordingError(f"{options.kept} lacks its machine or its figures: make keep")
    kept_figures = {name: _number(name, value) for name, value in before.items()}
    compared = compare(kept_figures, measured, same_machine=there == here, unjudged=OF_THE_CLOCK)
    page = comparison_page(compared, there, here, [f"Run: {options.commit}.", *_NOTES])
    try:
        options.out.write_text(page + "\n", encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{options.out} cannot be written: {error.strerror}.") from error
    bad = [entry for entry in compared if not entry.agreement.good]
    for entry in bad:
        console.print(
            f"[bold red]not reproduced[/]  {escape(row(entry))}", highlight=False, soft_wrap=True
        )
    console.print(outcome(compared), soft_wrap=True)
    print_files(console, {"comparison": options.out})
    return FAILED if bad else OK


def _of_main_job(report: Mapping[str, Any]) -> Iterator[tuple[str, object]]:
    yield "succeeded", float(report["success"])
    yield "promises broken", sum(not finding["ok"] for finding in report["audit"])
    for finding in report["audit"]:
        promise = finding["signal"].partition(" (")[0] + (", exempt" if finding["exempt"] else "")
        yield f"{promise} [{finding['unit']}]", finding["extreme"]
    for i, waypoint in enumerate(report["waypoints"], start=1):
        yield f"{i} {waypoint['name']} [s]", waypoint["duration_s"]


def _packages(report: Mapping[str, Any]) -> dict[str, str]:
    """Versions that figures depend on: all but the project's own, whose figures these are."""
    versions = report.get("versions", {})
    return {name: str(version) for name, version in versions.items() if name != "robo47_qp"}


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RecordingError(f"{name} must be a number; found {value!r}.")
    return float(value)


if __name__ == "__main__":
    sys.exit(main(RetroOptions, run, __doc__))
