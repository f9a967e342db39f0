"""EvaluationReport: what it counts, compares and tells of given results."""

import json
from collections.abc import Sequence
from dataclasses import replace
from io import StringIO
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.episode import EpisodeResult, EpisodeSpec, errored
from robo47_qp.evaluation.report.not_judged import NotJudged
from robo47_qp.evaluation.report.progress import EvaluationBar, described
from robo47_qp.evaluation.report.report import EvaluationReport, Throughput, compare
from robo47_qp.evaluation.report.words import MOST, comparison_line, markdown
from tests.toy_episodes import SETTINGS


def entries(won: str) -> list[EpisodeResult]:
    return [
        EpisodeResult(index=i, seed=i, success=c == "+", cause=None if c == "+" else "drop")
        for i, c in enumerate(won)
    ]


def of(results: Sequence[EpisodeResult], **settings: Any) -> EvaluationReport:
    return EvaluationReport(settings={**SETTINGS, **settings}, results=results)


def test_two_results_are_compared_seed_by_seed() -> None:
    found = compare(of(entries("+++++-+-")), of(entries("--++--++--")))
    assert (found.episodes, found.successes_a, found.successes_b) == (8, 6, 4)
    assert (found.only_a, found.only_b) == (3, 1)
    assert found.p == pytest.approx(2 * (4 + 1) / 16)
    assert found.difference == pytest.approx(0.25)
    assert found.interval[0] < 0.25 < found.interval[1]
    words = comparison_line(found)
    assert "toy against toy on 8 episodes: +25.0 points" in words
    assert "3 to 1 that only one solved, p = 0.625" in words
    assert "p_holm" not in found.as_json()


def test_what_is_no_pair_is_not_compared() -> None:
    for name in ("task", "robot", "perturbation", "time_limit", "robot_sha256"):
        other = of(entries("++"), **{name: {"name": "other"}})
        with pytest.raises(InvalidValueError, match=f"one with another {name}"):
            compare(of(entries("++")), other)
    another = of(entries("++"), robot_sha256="other", timeout=5.0)
    with pytest.raises(InvalidValueError, match="one with another robot_sha256"):
        compare(of(entries("++")), another)
    far = [replace(entry, seed=entry.seed + 50) for entry in entries("++")]
    with pytest.raises(InvalidValueError, match="without any of these seeds"):
        compare(of(entries("++")), of(far))


def test_what_differs_beside_the_policy_is_told() -> None:
    """Versions are compared so, in which the digest of a robot may be another one."""
    now = {"code": "a", "versions": {"mujoco": "4.0.0"}, "robot_sha256": "b"}
    alike = compare(of(entries("++"), **now), of(entries("+-"), **now))
    assert alike.settings == ()
    assert "differs" not in comparison_line(alike)
    for before, named in (
        ({"code": "z"}, "code"),
        ({"versions": {"mujoco": "3.9.0"}}, "versions"),
        ({"code": "z", "robot_sha256": "y"}, "code, robot_sha256"),
        ({"timeout": 5.0}, "timeout"),
    ):
        report = of(entries("++"), **now)
        found = compare(report, of(entries("+-"), **{**now, **before}))
        assert found.as_json()["settings"] == tuple(named.split(", "))
        assert comparison_line(found).endswith(f"; not the policy alone differs, also: {named}")
        assert f"also: {named}." in markdown(replace(report, comparison=found), [])


def test_settings_of_policies_of_the_same_name_are_told() -> None:
    """An ablation would be told as one policy against itself."""
    way = {"name": "classical", "ik": "mink", "speed": 1.0, "controller": "computed_torque"}
    other = {**way, "speed": 0.5, "controller": "joint_impedance"}
    found = compare(of(entries("++"), policy=way), of(entries("+-"), policy=other))
    told = ("speed (1.0, 0.5)", "controller (computed_torque, joint_impedance)")
    assert found.as_json()["settings"] == told
    assert comparison_line(found).endswith(f"also: {', '.join(told)}")
    files = [{"name": "p", "sha256": one} for one in "xy"]
    found = compare(of(entries("++"), policy=files[0]), of(entries("+-"), policy=files[1]))
    assert found.settings == ("sha256 (x, y)",)
    # What a name tells is not told again; of another policy, its files are its own.
    another = {"name": "q", "sha256": "y"}
    assert (
        compare(of(entries("++"), policy=files[0]), of(entries("+-"), policy=another)).settings
        == ()
    )
    dls = {**way, "ik": "dls"}
    assert compare(of(entries("++"), policy=way), of(entries("+-"), policy=dls)).settings == ()


def test_figures_are_those_of_the_successes_and_errors_have_no_cause() -> None:
    results = [replace(e, metrics={"t": float(e.seed)}) for e in entries("+-+++")]
    report = of([*results, errored(EpisodeSpec(index=5, seed=5), "bug")])
    found = report.as_json()
    assert found["figures"]["t"] == {"n": 4, "median": 2.5, "p95": pytest.approx(3.85), "max": 4.0}
    assert (found["episodes"], found["successes"], found["errors"]) == (6, 4, 1)
    assert found["causes"] == {"drop": 1}
    assert sum(found["causes"].values()) + found["errors"] + found["successes"] == 6
    read_back = json.loads(json.dumps(found, allow_nan=False))
    assert EvaluationReport.of_json(read_back).as_json() == read_back


def test_the_throughput_is_of_what_ran_now() -> None:
    results = [replace(e, timing={"wall_s": 3.0}) for e in entries("++++")]
    found = Throughput.of(results, 8.0, 2)
    assert found is not None
    assert found.episodes_per_minute == 30.0
    assert found.episodes_per_minute_per_worker == 15.0
    assert found.busy == 0.75
    assert Throughput.of([], 8.0, 2) is None


def test_a_long_list_of_failures_is_cut_and_told() -> None:
    text = markdown(of(entries("-" * (MOST + 7))), ["a.png"])
    assert text.count("| drop |") == MOST + 1
    assert "7 more are in the JSON file" in text


def test_each_setting_has_a_row_and_versions_have_a_table() -> None:
    policy = {"name": "x", "speed": 0.5}
    text = markdown(of(entries("+"), policy=policy, versions={"mink": "1"}), ["a.png"])
    assert "| policy: name | x |" in text
    assert "| policy: speed | 0.5 |" in text
    assert "| versions" not in text


def test_the_bar_tells_the_rate_so_far() -> None:
    assert described([]) == "starting"
    assert described(entries("+++-")) == "75.0 % (30.1 to 95.4)"
    assert described([errored(EpisodeSpec(index=0, seed=0), "bug")]).endswith("1 errors")
    screen = StringIO()
    console = Console(file=screen, force_terminal=True, width=120)
    with EvaluationBar(console, 8) as bar:
        bar.results(entries("+++-"))
    assert "4/8" in screen.getvalue()
    assert "75.0 %" in screen.getvalue()


def test_what_was_not_judged_is_told_with_its_furthest_value_and_its_share() -> None:
    def exempt(signal: str, extreme: float, share: float, *, least: bool = False) -> dict[str, Any]:
        told = {"signal": f"{signal}, exempt", "unit": "m", "exempt": f"why {signal[:4]}"}
        return {
            **told,
            "extreme": extreme,
            "limit": 0.1,
            "time": 0.0,
            "share": share,
            "least": least,
        }

    episodes = [
        [exempt("path (tool)", 0.3, 0.2), exempt("gap, scene (a to b)", 0.4, 0.5, least=True)],
        [exempt("path (other tool)", 0.2, 0.1), exempt("path (tool)", 0.05, 0.4)],
        [exempt("gap, scene (c to b)", -0.2, 0.3, least=True)],
        [],
    ]
    results = [
        EpisodeResult(index=i, seed=20 + i, success=True, exempt=tuple(one))
        for i, one in enumerate(episodes)
    ]
    gap, path = NotJudged.of(results)
    assert (gap.signal, path.signal) == ("gap, scene", "path")
    assert [gap.episodes, gap.median_share, gap.max_share] == pytest.approx([2, 0.4, 0.5])
    assert (gap.extreme, gap.limit, gap.seed) == (-0.2, 0.1, 22)
    assert [path.episodes, path.median_share, path.max_share] == pytest.approx([2, 0.3, 0.4])
    assert (path.extreme, path.seed, path.why) == (0.3, 20, "why path")
    report = of(results)
    assert [one["signal"] for one in report.as_json()["not_judged"]] == ["gap, scene", "path"]
    row = "| path | 2 | 30.0 | 40.0 | 0.3 m | 0.1 m | 20 | why path |"
    assert row in markdown(report, []).splitlines()


def test_a_value_that_is_no_number_is_the_furthest() -> None:
    told = {"signal": "x", "unit": "", "exempt": "y", "limit": 1.0, "share": 1.0, "least": False}
    results = [
        EpisodeResult(index=i, seed=i, success=True, exempt=({**told, "extreme": extreme},))
        for i, extreme in enumerate([5.0, "nan", 7.0])
    ]
    (one,) = NotJudged.of(results)
    assert (one.seed, np.isnan(one.extreme)) == (1, True)
