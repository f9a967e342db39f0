"""What an evaluation says and draws: audits, causes, corrected p, forces that are all zero."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from robo47_qp.evaluation.episode import EpisodeResult, EpisodeSpec, errored
from robo47_qp.evaluation.report import plots
from robo47_qp.evaluation.report.paired import CycleTimes, PairedComparison
from robo47_qp.evaluation.report.plots import _factors, _spread, plot_evaluation
from robo47_qp.evaluation.report.progress import described
from robo47_qp.evaluation.report.report import EvaluationReport, Throughput
from robo47_qp.evaluation.report.words import (
    broken_line,
    cause_lines,
    comparison_line,
    markdown,
    rate_line,
    throughput_line,
)
from robo47_qp.report.metrics import FAILED_STEPS

SETTINGS: dict[str, Any] = {"task": {"name": "reach"}, "policy": {"name": "mine.py:Mine"}}
PAIR = PairedComparison(
    a="x",
    b="y",
    episodes=9,
    successes_a=5,
    successes_b=4,
    only_a=2,
    only_b=1,
    p=0.25,
    difference=0.1,
    interval=(-0.1, 0.3),
    identical=0,
    cycle_time_s=CycleTimes(episodes=0, median_difference=None),
    differing=(),
)


def figures(*episodes: tuple[str | None, tuple[str, ...]]) -> EvaluationReport:
    """Of episodes with a cause of failure, or None, and the promises that broke."""
    results = [
        EpisodeResult(
            index=i,
            seed=10 + i,
            success=cause is None,
            cause=cause,
            evidence=cause and f"{cause} at {i}",
            measures={"left_m": 1.0 * i},
            audit_ok=not broken,
            broken_promises=broken,
        )
        for i, (cause, broken) in enumerate(episodes)
    ]
    return EvaluationReport(settings=SETTINGS, results=results)


def test_successes_with_retries_are_told_apart_where_they_were_counted() -> None:
    report = figures((None, ()), (None, ()), ("grasp", ()), (None, ()))
    assert report.first_attempts is None
    assert rate_line(report).startswith("3 of 4 succeeded, 75.0 %")
    counts = (0.0, 2.0, 1.0, 0.0)
    results = [
        replace(result, metrics={FAILED_STEPS: count})
        for result, count in zip(report.results, counts, strict=True)
    ]
    counted = replace(report, results=results)
    assert counted.first_attempts == 2
    assert counted.as_json()["first_attempts"] == 2
    assert rate_line(counted).startswith("3 of 4 succeeded (2 at the first attempt), 75.0 %")
    partly = replace(report, results=[*results[:3], report.results[3]])
    assert partly.first_attempts is None
    assert replace(report, results=results[2:3]).first_attempts is None


def test_the_promises_that_broke_are_told_with_their_seeds() -> None:
    found = figures((None, ("jerk",)), (None, ()), ("drop", ("speed", "jerk")), (None, ("jerk",)))
    assert broken_line(found) == "3 episodes violated the audit: jerk 3, speed 1"
    text = markdown(found, [])
    assert "| jerk | 3 | 10, 12, 13 |" in text
    assert "| speed | 1 | 12 |" in text
    assert broken_line(figures((None, ("jerk",)))) == "1 episode violated the audit: jerk 1"
    kept = figures((None, ()))
    assert broken_line(kept) == ""
    assert "audit" not in markdown(kept, [])


def test_of_promises_that_broke_often_not_every_seed_is_listed() -> None:
    text = markdown(figures(*[(None, ("jerk",))] * 23), [])
    assert "| jerk | 23 | 10, 11," in text
    assert "28, 29 and 3 more |" in text
    assert ", 30" not in text


def test_each_cause_has_the_evidence_of_its_first_episode() -> None:
    found = figures(("drop", ()), ("ik", ()), (None, ()), ("ik", ()))
    assert cause_lines(found) == [
        "  ik         2; seed 11: ik at 1",
        "  drop       1; seed 10: drop at 0",
    ]


def test_no_text_of_an_episode_ends_its_cell() -> None:
    """Every line of a report is its own: a heading, a table or a comment of a policy's is none."""
    text = "x\r\r# reach\n\n20 of 20\x0b\x0c\x1c\x85\u2028\u2029| 1 |<!-- <h1>"
    plain, forged = figures(("drop", ("jerk",))), figures(("drop", (text,)))
    forged = replace(forged, results=[replace(forged.results[0], evidence=text)])
    told = markdown(forged, [])
    assert len(told.splitlines()) == len(markdown(plain, []).splitlines())
    assert "<" not in told
    for line in told.splitlines():
        if "reach  20 of 20" in line:
            assert line.startswith("| ")
            assert "\\| 1 \\|" in line


def test_of_one_comparison_among_several_the_corrected_p_is_told() -> None:
    assert comparison_line(PAIR).endswith("p = 0.25 (McNemar, exact)")
    among = comparison_line(replace(PAIR, p_holm=0.5))
    assert among.endswith("p = 0.5 (McNemar, exact; corrected by Holm)")


def test_without_a_success_there_are_no_figures_of_successes() -> None:
    assert "Figures of the successful episodes" in markdown(figures((None, ())), [])
    assert "Figures of the successful episodes" not in markdown(figures(("ik", ())), [])


def test_one_is_not_told_as_several() -> None:
    one = Throughput(
        episodes=1,
        workers=1,
        wall_s=2.0,
        episodes_per_minute=30.0,
        episodes_per_minute_per_worker=30.0,
        busy=1.0,
    )
    assert throughput_line(one) == (
        "1 episode in 2.0 s on 1 worker: 30.0 per minute, 30.0 per worker"
    )
    assert "2 episodes in 2.0 s on 2 workers" in throughput_line(
        replace(one, episodes=2, workers=2)
    )


WRONG = errored(EpisodeSpec(index=9, seed=9), "a bug")


@pytest.mark.parametrize(
    ("wrong", "told", "drawn"),
    [(1, "50.0 % (9.5 to 90.5), 1 errors", [100.0, 50.0]), (0, "50.0 % (9.5 to 90.5)", [100, 50])],
)
def test_an_internal_error_is_no_failure_while_it_runs_and_in_the_picture(
    wrong: int, told: str, drawn: list[float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = [*figures((None, ()), ("drop", ())).results, *[WRONG] * wrong]
    assert described(results) == told
    lines: list[list[float]] = []

    def kept(axes: Axes, judged: list[EpisodeResult]) -> None:
        known(axes, judged)
        lines.append(list(axes.lines[0].get_ydata()))  # type: ignore[arg-type]

    known = plots._rate
    monkeypatch.setattr(plots, "_rate", kept)
    plot_evaluation(EvaluationReport(settings=SETTINGS, results=results), tmp_path / "a.png")
    assert lines == [drawn]


def test_errors_alone_are_told_and_drawn(tmp_path: Path) -> None:
    assert described([WRONG]) == "nothing judged, 1 errors"
    assert described([]) == "starting"
    plot_evaluation(EvaluationReport(settings=SETTINGS, results=[WRONG]), tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_where_nothing_is_touched_no_negative_force_is_drawn() -> None:
    axes = Figure().subplots()
    one = EpisodeResult(index=0, seed=0, success=True, metrics={"peak_contact_force_N": 0.0})
    _spread(axes, [one] * 3, "peak_contact_force_N", "force [N]")
    low, high = axes.get_xlim()
    assert low == 0.0
    assert high > 0.0


def test_a_task_without_objects_has_no_masses_to_draw() -> None:
    none = {"friction": 0.5, "object_mass_factor": []}
    two = {"friction": 0.5, "object_mass_factor": [0.8, 1.0]}
    one = EpisodeResult(index=0, seed=0, success=True, disturbance=none)
    assert _factors(one) is None
    assert _factors(replace(one, disturbance=two)) == pytest.approx((0.9, 0.5))
