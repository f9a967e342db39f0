"""Several policies in one command: paired worlds, files, interruptions, the comparison."""

import json
import pickle
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import StringIO
from math import comb
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from robo47_qp.errors import InvalidValueError, RecordingError
from robo47_qp.evaluation import evaluate as evaluate_module
from robo47_qp.evaluation import evaluation
from robo47_qp.evaluation.command import evaluate_chosen
from robo47_qp.evaluation.episode import Episode, EpisodeResult, EpisodeSpec, errored
from robo47_qp.evaluation.evaluate import evaluate
from robo47_qp.evaluation.evaluation import PolicyEvaluation
from robo47_qp.evaluation.journal import JournalError
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.evaluation.report.progress import EvaluationBar
from robo47_qp.evaluation.report.report import EvaluationReport, compare_policies
from robo47_qp.evaluation.report.words import paired_markdown
from robo47_qp.evaluation.workers.worker import run_guarded
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.foreign_code import ClassLoadError
from robo47_qp.tasks.reach.reach import Reach as ReachTask
from tests.runs import Reach
from tests.toy_episodes import SETTINGS

QUIET = Console(quiet=True)
THREE = ("classical:qp", "classical:dls", "classical:dls-single")
SKILL = {"qp": 0.75, "dls": 0.6, "dls-single": 0.5}


class InProcess:
    """Runs episodes here, counts them, and is interrupted after some."""

    ran: list[tuple[str, int]] = []  # noqa: RUF012  # of all executors that a command makes
    interrupted_after: int | None = None

    def __init__(self, *, workers: int, timeout: float) -> None:
        self.workers = workers

    def run(self, episode: Episode, specs: Sequence[EpisodeSpec]) -> Iterator[EpisodeResult]:
        episode = pickle.loads(pickle.dumps(episode))
        for spec in specs:
            if len(self.ran) == self.interrupted_after:
                raise KeyboardInterrupt
            self.ran.append((getattr(episode, "ik", ""), spec.seed))
            yield run_guarded(episode, spec)


@dataclass(frozen=True)
class Skilled:
    """Succeeds as often as its IK is good; hard worlds are hard for all."""

    ik: str
    buggy: bool = False
    foreign: bool = False

    def __call__(self, spec: EpisodeSpec) -> EpisodeResult:
        if self.buggy and self.ik == "dls" and spec.seed == 2:
            raise ZeroDivisionError("a bug of ours")
        world, luck, slow = np.random.default_rng(spec.seed).uniform(size=3)
        luck += {"qp": 0.0, "dls": 0.37, "dls-single": 0.45}[self.ik]
        success = bool(0.3 * world + 0.7 * (luck % 1.0) < SKILL[self.ik])
        told: dict[str, Any] = {"cause": "ik", "evidence": f"{self.ik} is stuck", "time": 1.5}
        return EpisodeResult(
            index=spec.index,
            seed=spec.seed,
            success=success,
            metrics={"cycle_time_s": 5.0 + float((slow - luck) ** 2) * len(self.ik)},
            disturbance={"world": float(world)},
            sha256="same" if spec.seed == 0 else f"{self.ik} {spec.seed}",
            broken_promises=("jerk",) if (self.ik, spec.seed) == ("dls", 3) else (),
            audit_ok=(self.ik, spec.seed) != ("dls", 3),
            **({} if success else told),
        )


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(InProcess, "ran", [])
    monkeypatch.setattr(InProcess, "interrupted_after", None)
    monkeypatch.setattr(evaluation, "LocalProcesses", InProcess)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")


@pytest.fixture
def toys(monkeypatch: pytest.MonkeyPatch) -> None:
    """Quick episodes in place of the simulation, and no drawing."""
    monkeypatch.setattr(evaluate_module, "_draw", lambda _, path: path.write_text(""))
    monkeypatch.setattr(PolicyEvaluation, "_episode", lambda self: Skilled(self.policy.ik))


def options(tmp_path: Path, **chosen: Any) -> EvaluateOptions:
    settings = {"episodes": 30, "workers": 2, "log": tmp_path / "eval.rrd", "policy": THREE}
    return EvaluateOptions(**{**settings, **chosen})


def read(tmp_path: Path, name: str = "eval.json") -> dict[str, Any]:
    found: dict[str, Any] = json.loads((tmp_path / name).read_text())
    return found


def without_times(figures: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in figures.items() if name not in ("timing", "provenance")}


def test_policies_meet_the_same_worlds_with_their_own_ik(tmp_path: Path) -> None:
    policies = ("classical", "classical:dls-single")
    chosen = options(
        tmp_path,
        episodes=2,
        policy=policies,
        ik="lm",
        failures=0,
        perturbations={"friction": "0.7:1.3"},
    )
    assert evaluate(Reach(), PANDA, chosen, QUIET) == 0
    a, b = read(tmp_path, "eval.classical.json"), read(tmp_path, "eval.classical-dls-single.json")
    assert a["settings"]["policy"] == {
        "name": "classical",
        "ik": "lm",
        "speed": 1.0,
        "qp_solver": "daqp",
        "controller": "computed_torque",
        "observer": True,
        "profile": "gentle",
    }
    assert a["policy"] == "classical:lm"
    assert b["settings"]["policy"]["ik"] == "dls-single"
    assert [e["seed"] for e in a["entries"]] == [e["seed"] for e in b["entries"]] == [0, 1]
    for x, y in zip(a["entries"], b["entries"], strict=True):
        assert x["disturbance"] == y["disturbance"]
        assert x["sha256"] != y["sha256"]
    frictions = {e["disturbance"]["friction"] for e in a["entries"]}
    assert len(frictions) == 2
    assert {k: v for k, v in a["settings"].items() if k != "policy"} == {
        k: v for k, v in b["settings"].items() if k != "policy"
    }


@pytest.mark.usefixtures("toys")
def test_the_comparison_is_what_the_reports_say(tmp_path: Path) -> None:
    """Counted again from the reports, with sums in place of the package's statistics."""
    screen = StringIO()
    assert evaluate(Reach(), PANDA, options(tmp_path), Console(file=screen, width=200)) == 0
    found = read(tmp_path)
    assert (found["task"], found["baseline"], found["episodes"]) == ("reach", THREE[0], 30)
    assert [p["policy"] for p in found["policies"]] == list(THREE)
    reports = {p["policy"]: read(tmp_path, p["report"]) for p in found["policies"]}
    for own in found["policies"]:
        report = reports[own["policy"]]
        entries = report["entries"]
        won = [e for e in entries if e["success"]]
        assert [e["seed"] for e in entries] == list(range(30))
        assert (own["successes"], own["episodes"]) == (len(won), 30)
        assert own["causes"] == dict(Counter(e["cause"] for e in entries if not e["success"]))
        assert own["interval"] == report["interval"]
        cycle = median(e["metrics"]["cycle_time_s"] for e in won)
        assert own["median_cycle_time_s"] == pytest.approx(cycle)
    base = reports[THREE[0]]["entries"]
    p_values = []
    for comparison, name in zip(found["comparisons"], THREE[1:], strict=True):
        assert (comparison["a"], comparison["b"]) == (name, THREE[0])
        pairs = list(zip(reports[name]["entries"], base, strict=True))
        only_a = [x["seed"] for x, y in pairs if x["success"] and not y["success"]]
        only_b = [x["seed"] for x, y in pairs if y["success"] and not x["success"]]
        assert only_a
        assert len(only_b) > len(only_a)
        k, m = len(only_a), len(only_a) + len(only_b)
        assert (comparison["only_a"], comparison["only_b"]) == (k, m - k)
        p_values.append(min(1.0, 2 * sum(comb(m, i) for i in range(k + 1)) / 2**m))
        assert comparison["p"] == pytest.approx(p_values[-1])
        assert comparison["difference"] == pytest.approx((2 * k - m) / 30)
        p12, p21 = (k + 1) / 32, (m - k + 1) / 32
        half = 1.959963984540054 * ((p12 + p21 - (p12 - p21) ** 2) / 32) ** 0.5
        assert comparison["interval"] == pytest.approx([p12 - p21 - half, p12 - p21 + half])
        both = [(x, y) for x, y in pairs if x["success"] and y["success"]]
        longer = [x["metrics"]["cycle_time_s"] - y["metrics"]["cycle_time_s"] for x, y in both]
        assert comparison["cycle_time_s"]["episodes"] == len(both)
        assert comparison["cycle_time_s"]["median_difference"] == pytest.approx(median(longer))
        assert comparison["identical"] == 1
        told = {e["seed"]: (e["solved_by"], e["cause"]) for e in comparison["differing"]}
        assert told == {s: ("a" if s in only_a else "b", "ik") for s in (*only_a, *only_b)}
        loser = {"a": "qp", "b": name.partition(":")[2]}
        for episode in comparison["differing"]:
            assert episode["evidence"] == f"{loser[episode['solved_by']]} is stuck"
    low, high = sorted(p_values)
    holm = {low: min(1.0, 2 * low), high: max(high, min(1.0, 2 * low))}
    assert [c["p_holm"] for c in found["comparisons"]] == pytest.approx([holm[p] for p in p_values])
    for name, report in reports.items():
        assert f"{name}: {report['successes']} of 30 succeeded" in screen.getvalue()
        assert f"%); failed: ik {30 - report['successes']}\n" in screen.getvalue()
    assert f"{THREE[1]} against {THREE[0]} on 30 episodes" in screen.getvalue()


@pytest.mark.usefixtures("toys")
@pytest.mark.parametrize("policies", [THREE, THREE[1:2]])
def test_promises_that_broke_and_causes_are_told_on_the_screen(
    tmp_path: Path, policies: tuple[str, ...]
) -> None:
    screen = StringIO()
    chosen = options(tmp_path, policy=policies, failures=0)
    assert evaluate(Reach(), PANDA, chosen, Console(file=screen, width=200)) == 0
    assert screen.getvalue().count("1 episode violated the audit: jerk 1\n") == 1
    assert ("dls is stuck" in screen.getvalue()) == (len(policies) == 1)


@pytest.mark.usefixtures("toys")
def test_the_recordings_that_there_are_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def record(_: Any, __: Any, failures: Sequence[EpisodeResult], path: Path) -> dict[int, bool]:
        if failures and "single" not in path.name:
            path.write_text("")
        return {}

    monkeypatch.setattr(evaluate_module, "record_failures", record)
    screen = StringIO()
    assert evaluate(Reach(), PANDA, options(tmp_path), Console(file=screen, width=200)) == 0
    told = [line.split() for line in screen.getvalue().splitlines()]
    named = [line[1] for line in told if line[:1] == ["recording"]]
    assert named == [str(tmp_path / f"eval.classical-{ik}.rrd") for ik in ("qp", "dls")]


@pytest.mark.usefixtures("toys")
def test_each_policy_has_files_of_its_own_and_the_comparison_names_them(tmp_path: Path) -> None:
    assert evaluate(Reach(), PANDA, options(tmp_path, failures=2), QUIET) == 0
    names = {"eval.json", "eval.md"}
    for label in ("qp", "dls", "dls-single"):
        names |= {f"eval.classical-{label}.{end}" for end in ("json", "md", "jsonl", "png")}
    assert {path.name for path in tmp_path.iterdir()} == names
    text = (tmp_path / "eval.md").read_text()
    found = read(tmp_path)
    for own in found["policies"]:
        row = f"| [{own['policy']}]({own['report']}) | {own['successes']} of 30 |"
        assert row in text
    assert f"ik {found['policies'][1]['causes']['ik']} |" in text
    first = found["comparisons"][0]
    assert f"| classical:dls | {100 * first['difference']:+.1f} |" in text
    lost = first["differing"][0]
    winner, loser = (first[k] for k in (("a", "b") if lost["solved_by"] == "a" else ("b", "a")))
    assert f"| {lost['seed']} | {winner} | {loser} | ik |  | 1.50 |" in text


@pytest.mark.usefixtures("toys")
def test_json_is_the_comparison_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    chosen = options(tmp_path, episodes=3, json=True)
    assert evaluate(Reach(), PANDA, chosen, Console(stderr=True)) == 0
    assert json.loads(capsys.readouterr().out) == read(tmp_path)


@pytest.mark.usefixtures("toys")
def test_an_interruption_in_the_second_policy_is_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part, whole = tmp_path / "part", tmp_path / "whole"
    assert evaluate(Reach(), PANDA, options(whole), QUIET) == 0
    monkeypatch.setattr(InProcess, "ran", [])
    monkeypatch.setattr(InProcess, "interrupted_after", 41)
    screen = StringIO()
    assert evaluate(Reach(), PANDA, options(part), Console(file=screen, width=200)) == 130
    assert "finished episodes are kept: continue with --resume" in screen.getvalue()
    assert not (part / "eval.json").exists()
    lines = [len((part / f"eval.classical-{k}.jsonl").read_text().splitlines()) for k in SKILL]
    assert lines == [31, 12, 1]
    monkeypatch.setattr(InProcess, "ran", [])
    monkeypatch.setattr(InProcess, "interrupted_after", None)
    assert evaluate(Reach(), PANDA, options(part, resume=True), QUIET) == 0
    left = [("dls", seed) for seed in range(11, 30)] + [("dls-single", s) for s in range(30)]
    assert InProcess.ran[: len(left)] == left
    # What follows are the failures of each policy, recorded to be looked at.
    assert len(InProcess.ran) <= len(left) + 3 * EvaluateOptions.failures
    assert without_times(read(part)) == without_times(read(whole))
    for own in read(whole)["policies"]:
        a, b = read(part, own["report"]), read(whole, own["report"])
        assert without_times(a) == without_times(b)


@pytest.mark.usefixtures("toys")
def test_without_resume_no_old_journal_is_left_to_go_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert evaluate(Reach(), PANDA, options(tmp_path, episodes=4), QUIET) == 0
    monkeypatch.setattr(InProcess, "ran", [])
    monkeypatch.setattr(InProcess, "interrupted_after", 1)
    assert evaluate(Reach(), PANDA, options(tmp_path, episodes=4), QUIET) == 130
    for label, count in (("qp", 1), ("dls", 0), ("dls-single", 0)):
        journal = tmp_path / f"eval.classical-{label}.jsonl"
        assert len(journal.read_text().splitlines()) == 1 + count
        assert len(journal.with_name(f"{journal.name}.old").read_text().splitlines()) == 5


@pytest.mark.usefixtures("toys")
def test_what_the_last_policy_lacks_is_told_before_the_first_runs(tmp_path: Path) -> None:
    assert evaluate(Reach(), PANDA, options(tmp_path, episodes=1, policy=THREE[1:]), QUIET) == 0
    InProcess.ran.clear()

    def refused(error: type[Exception], match: str, **chosen: Any) -> None:
        with pytest.raises(error, match=match):
            evaluate(Reach(), PANDA, options(tmp_path, **chosen), QUIET)
        assert InProcess.ran == []
        assert not (tmp_path / "eval.classical-qp.json").exists()

    refused(
        JournalError, "classical-dls.jsonl is of another(.*)policy, speed", resume=True, speed=0.5
    )
    assert not (tmp_path / "eval.classical-qp.jsonl").exists()
    (tmp_path / "eval.classical-lm.jsonl").mkdir()
    refused(RecordingError, "cannot be written", policy=("classical:qp", "classical:lm"))


def test_policies_that_cannot_be_had_are_told_before_any_runs(tmp_path: Path) -> None:
    for name, error, match in (
        ("nowhere:Policy", ClassLoadError, "'nowhere:Policy' cannot be loaded"),
        ("tests.toy_policies:GoodPolicy", InvalidValueError, "verdict is no success before any"),
    ):
        with pytest.raises(error, match=match):
            evaluate(Reach(), PANDA, options(tmp_path, policy=("classical", name)), QUIET)
    assert InProcess.ran == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("toys")
def test_an_internal_error_is_told_and_does_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        PolicyEvaluation, "_episode", lambda self: Skilled(self.policy.ik, buggy=True)
    )
    screen = StringIO()
    chosen = options(tmp_path, episodes=4)
    assert evaluate(Reach(), PANDA, chosen, Console(file=screen, width=200)) == 1
    assert "1 episode ended with an internal error" in screen.getvalue()
    assert "ZeroDivisionError: a bug of ours" in screen.getvalue()
    found = read(tmp_path)
    assert [p["errors"] for p in found["policies"]] == [0, 1, 0]
    assert [p["judged"] for p in found["policies"]] == [4, 3, 4]
    assert found["comparisons"][0]["episodes"] == 3
    assert not [e for e in found["comparisons"][0]["differing"] if e["seed"] == 2]
    assert "internal error 1" in (tmp_path / "eval.md").read_text()


def test_where_nothing_is_solved_by_both_no_times_are_compared() -> None:
    def report(name: str, won: str) -> EvaluationReport:
        results = [
            EpisodeResult(index=i, seed=i, success=c == "+", cause=None if c == "+" else "drop")
            for i, c in enumerate(won)
        ]
        results[-1] = errored(EpisodeSpec(index=len(won) - 1, seed=len(won) - 1), "x\nlast line")
        return EvaluationReport(settings={**SETTINGS, "policy": {"name": name}}, results=results)

    reports = {"a.json": report("one", "+-+."), "b.json": report("two", "-+-.")}
    comparison = compare_policies(reports)
    found = comparison.as_json()
    assert found["comparisons"][0]["cycle_time_s"] == {"episodes": 0, "median_difference": None}
    assert found["comparisons"][0]["identical"] == 0
    assert [p["median_cycle_time_s"] for p in found["policies"]] == [None, None]
    assert [e["seed"] for e in found["comparisons"][0]["differing"]] == [0, 1, 2]
    assert "| [one](a.json) | 2 of 3 | 20.8 to 93.9 % | drop 1, internal error 1 | 0 |  |" in (
        paired_markdown(comparison)
    )


def test_a_policy_from_elsewhere_needs_a_task_that_can_be_judged_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ReachTask, "verdict", lambda _task, _simulation: None)
    chosen = options(tmp_path, task="reach", policy=("classical", "tests.toy_policies:GoodPolicy"))
    with pytest.raises(
        InvalidValueError,
        match="task must be one whose verdict is no success",
    ):
        evaluate_chosen(chosen, QUIET)


def test_the_bar_tells_whose_episodes_they_are() -> None:
    screen = StringIO()
    console = Console(file=screen, force_terminal=True, width=120)
    with EvaluationBar(console, 8, "a.py:B [odd]") as bar:
        bar.results([EpisodeResult(index=0, seed=0, success=True)])
    assert "a.py:B [odd]" in screen.getvalue()
    assert "1/8" in screen.getvalue()
