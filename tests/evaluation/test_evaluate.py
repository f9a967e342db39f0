"""The command: its files, its exit codes, its comparisons."""

import json
import re
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rerun.chunk import RrdReader
from rich.console import Console

from robo47_qp.errors import InvalidValueError, MissingExtraError, RecordingError, UnknownNameError
from robo47_qp.evaluation.command import evaluate_chosen
from robo47_qp.evaluation.episode import EpisodeResult, EpisodeSpec
from robo47_qp.evaluation.evaluate import evaluate
from robo47_qp.evaluation.evaluation import evaluate_policy
from robo47_qp.evaluation.journal import JournalError
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.evaluation.perturbation import Perturbation
from robo47_qp.evaluation.policies import PolicyReference
from robo47_qp.evaluation.report.report import EvaluationReport
from robo47_qp.evaluation.workers.ray_cluster import RayCluster
from robo47_qp.model.robots import load_robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.foreign_code import ClassLoadError
from robo47_qp.stack import ClassicalStack
from tests.evaluation.odd_episodes import (
    QUIET,
    InProcess,
    Odd,
    in_process,  # noqa: F401  # a fixture
    options,
    read,
)
from tests.toy_episodes import Toy

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three episodes, of which some fail, with all files."""
    folder = tmp_path_factory.mktemp("evaluation")
    assert evaluate(Odd(), PANDA, options(folder), QUIET) == 0
    return folder


def test_it_leaves_a_report_a_picture_and_the_failures(done: Path) -> None:
    report = read(done)
    assert (report["task"], report["policy"], report["episodes"]) == ("reach", "classical", 3)
    failed = [e for e in report["entries"] if not e["success"]]
    assert 0 < len(failed) < 3
    assert report["successes"] == 3 - len(failed)
    assert report["causes"] == {"place": len(failed)}
    assert report["errors"] == 0
    low, high = report["interval"]
    assert low < report["rate"] < high
    assert [e["seed"] for e in report["entries"]] == [0, 1, 2]
    assert report["settings"]["perturbation"]["friction"] == [0.7, 1.3]
    assert report["versions"]["mujoco"]
    assert report["replayed"] == {str(e["seed"]): True for e in failed}
    assert report["timing"]["episodes"] == 3
    recordings = [r for r in RrdReader(done / "eval.rrd").recordings() if r.kind == "recording"]
    assert len(recordings) == len(failed)
    assert (done / "eval.png").stat().st_size > 20_000
    text = (done / "eval.md").read_text()
    assert f"{report['successes']} of 3 succeeded" in text
    assert failed[0]["evidence"] in text
    assert "![eval.png](eval.png)" in text
    assert not [path for path in done.iterdir() if path.is_dir()]


def test_an_episode_replayed_is_the_one_that_was_evaluated(
    done: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (done / "eval.json").read_bytes()
    seed = 1
    chosen = options(done, replay=seed, json=True)
    assert evaluate(Odd(), PANDA, chosen, Console(stderr=True)) == 0
    entry = json.loads(capsys.readouterr().out)
    evaluated = read(done)["entries"][seed]
    assert entry["same_as_evaluated"] is True
    assert entry["sha256"] == evaluated["sha256"]
    assert read(done, "eval-reach-1.json") == entry
    assert (done / "eval-reach-1.rrd").stat().st_size > 100_000
    assert (done / "eval.json").read_bytes() == before


def test_a_replay_that_differs_is_told_with_exit_code_1(done: Path, tmp_path: Path) -> None:
    """The journal tells of other signals than the episode has."""
    lines = (done / "eval.jsonl").read_text("utf-8").splitlines(keepends=True)
    digest = read(done)["entries"][1]["sha256"]
    altered = [line.replace(digest, "0" * len(digest)) for line in lines]
    assert altered != lines
    (tmp_path / "eval.jsonl").write_text("".join(altered), "utf-8")
    screen = StringIO()
    assert evaluate(Odd(), PANDA, options(tmp_path, replay=1), Console(file=screen)) == 1
    assert "identical to the evaluated episode: NO" in screen.getvalue()
    assert read(tmp_path, "eval-reach-1.json")["same_as_evaluated"] is False


def test_a_replay_of_another_evaluation_has_nothing_to_compare_with(tmp_path: Path) -> None:
    screen = StringIO()
    chosen = options(tmp_path, replay=5, speed=0.9)
    assert evaluate(Odd(), PANDA, chosen, Console(file=screen, width=200)) == 0
    assert read(tmp_path, "eval-reach-5.json")["same_as_evaluated"] is None
    assert "seed 5: " in screen.getvalue()
    assert "identical" not in screen.getvalue()


def test_a_replay_in_another_world_is_refused_before_it_overwrites(tmp_path: Path) -> None:
    screen = StringIO()
    assert evaluate(Odd(), PANDA, options(tmp_path, episodes=1), QUIET) == 0
    chosen = options(tmp_path, replay=0)
    assert evaluate(Odd(), PANDA, chosen, Console(file=screen, width=200)) == 0
    assert "  identical to the evaluated episode: yes\n  audit kept: yes\n" in (screen.getvalue())
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(
        JournalError, match=r"these differ: perturbation\. Ask for the same settings, or name an"
    ) as refused:
        evaluate(Odd(), PANDA, options(tmp_path, replay=0, perturb="severe"), QUIET)
    assert "--resume" not in str(refused.value)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_an_evaluation_goes_on_and_prints_json_alone(
    done: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before, other = read(done), done / "other.json"
    other.write_bytes((done / "eval.json").read_bytes())
    chosen = options(done, resume=True, json=True, failures=0, against=other)
    assert evaluate(Odd(), PANDA, chosen, Console(stderr=True)) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["entries"] == before["entries"]
    assert report["timing"] == {}
    assert report["replayed"] == {}
    comparison = report["comparison"]
    assert (comparison["only_a"], comparison["only_b"], comparison["p"]) == (0, 0, 1.0)
    with pytest.raises(JournalError, match="these differ: perturbation"):
        evaluate(Odd(), PANDA, options(done, resume=True, friction=0.2), QUIET)


def test_a_report_tells_the_files_that_it_was_begun_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[str] = []
    run = InProcess.run

    def origin() -> dict[str, Any]:
        looked.append("made")
        return {"order": list(looked)}

    def ran(self: InProcess, *arguments: Any) -> Iterator[EpisodeResult]:
        looked.append("ran")
        return run(self, *arguments)

    monkeypatch.setattr(InProcess, "run", ran)
    monkeypatch.setattr("robo47_qp.evaluation.evaluate.provenance", origin)
    assert evaluate(Odd(), PANDA, options(tmp_path, episodes=1, failures=0), QUIET) == 0
    assert "ran" in looked
    assert read(tmp_path)["provenance"] == {"order": ["made"]}


def test_what_cannot_be_gone_on_with_is_begun_and_told(tmp_path: Path) -> None:
    screen = StringIO()
    chosen = options(tmp_path, resume=True, episodes=1, failures=0)
    assert evaluate(Odd(), PANDA, chosen, Console(file=screen)) == 0
    assert f"from the first episode: no {tmp_path / 'eval.jsonl'}" in screen.getvalue()


def test_a_robot_whose_files_changed_is_another_one(tmp_path: Path) -> None:
    """A mass in its MJCF, or a rating in its TOML."""
    mjcf, toml = tmp_path / "arm.xml", tmp_path / "arm.toml"
    shutil.copy(ROOT / "tests" / "models" / "free7.xml", mjcf)
    text = 'tcp = "tool"\nhome = [0.0, 0.26, 0.0, 1.9, 0.0, 0.98, 0.0]\n'
    ones = [1.0] * 7
    toml.write_text(text)
    chosen = options(tmp_path, resume=True, episodes=1, failures=0)
    assert evaluate(Odd(), load_robot(str(mjcf)), chosen, QUIET) == 0
    assert evaluate(Odd(), load_robot(str(mjcf)), chosen, QUIET) == 0
    before = mjcf.read_text()
    for path, changed in (
        (toml, f"{text}[profile]\nv_max = {ones}\na_max = {ones}\nj_max = {ones}\n"),
        (mjcf, re.sub(r'mass="([\d.]+)"', r'mass="1\1"', before, count=1)),
    ):
        kept = path.read_text()
        path.write_text(changed)
        with pytest.raises(JournalError, match=r"these differ: robot_sha256\."):
            evaluate(Odd(), load_robot(str(mjcf)), chosen, QUIET)
        path.write_text(kept)


def test_an_internal_error_is_seen(tmp_path: Path) -> None:
    screen = StringIO()
    chosen = options(tmp_path, episodes=1)
    assert evaluate(Odd(buggy=True), PANDA, chosen, Console(file=screen, width=200)) == 1
    report = read(tmp_path)
    assert (report["errors"], report["successes"], report["causes"]) == (1, 0, {})
    assert "1 episode ended with an internal error" in screen.getvalue()
    assert "ZeroDivisionError: a bug of ours" in screen.getvalue()
    assert "an internal error" in (tmp_path / "eval.md").read_text()


def test_bad_input_is_refused_before_anything_runs(tmp_path: Path) -> None:
    def refused(error: type[Exception], match: str, **chosen: Any) -> None:
        with pytest.raises(error, match=match):
            evaluate(Odd(), PANDA, options(tmp_path, **chosen), QUIET)

    refused(ClassLoadError, "cannot be loaded", policy=("nowhere:Policy",))
    refused(RecordingError, "cannot be read", against=tmp_path / "none.json")
    blind = {"perturbations": {"velocity_cutoff": 0.0}, "observer": False}
    for policy in ((), ("tests.toy_policies:LazyPolicy",)):
        told = "--velocity-cutoff must be above 0 without an observer"
        refused(InvalidValueError, told, policy=policy, **blind)
    odd = tmp_path / "odd.json"
    for content, match in (
        ('{"settings": {}}', "a report of an evaluation; found .*odd.json without 'entries'"),
        ('{"settings": {}, "entries": []}', "a report of an evaluation; found .*odd.json without"),
    ):
        odd.write_text(content)
        refused(InvalidValueError, f"--against must be {match}", against=odd)
    assert {path.name for path in tmp_path.iterdir()} == {"odd.json"}
    with pytest.raises(UnknownNameError, match=r"No task is called 'fly'; known: (.*)pick_place"):
        evaluate_chosen(options(tmp_path, task="fly"), QUIET)


def test_a_policy_from_elsewhere_is_evaluated(tmp_path: Path) -> None:
    policy = "tests.toy_policies:LazyPolicy"
    chosen = options(tmp_path, episodes=1, policy=(policy,), workers=1, speed=0.5, rate=10.0)
    assert evaluate(Odd(), PANDA, chosen, QUIET) == 0
    report = read(tmp_path)
    assert report["policy"] == policy
    told = report["settings"]["policy"]
    assert (told["rate"], told["speed"]) == (10.0, 0.5)
    assert len(told["sha256"]) == 64
    assert report["errors"] == 0


def test_a_policy_is_evaluated_without_a_command_and_without_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    far = Perturbation(friction=(0.7, 1.3))
    found = evaluate_policy(Odd(), PANDA, episodes=3, perturbation=far)
    assert evaluate(Odd(), PANDA, options(tmp_path / "files"), QUIET) == 0
    again = EvaluationReport.of_json(read(tmp_path / "files"))
    assert [r.sha256 for r in found.results] == [r.sha256 for r in again.results]
    assert (found.rate, found.interval, found.causes) == (again.rate, again.interval, again.causes)
    assert found.settings == again.settings
    slow = evaluate_policy(Odd(), PANDA, ClassicalStack(pace=0.5), episodes=1, seed=1)
    assert slow.figures["cycle_time_s"].median > found.figures["cycle_time_s"].max
    lazy = PolicyReference(text="tests.toy_policies:LazyPolicy")
    assert evaluate_policy(Odd(), PANDA, lazy, episodes=1).policy == lazy.text
    assert [path.name for path in tmp_path.iterdir()] == ["files"]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"episodes": 0}, "--episodes must be a whole number, at least 1 and at most 1e"),
        ({"seed": -1}, "--seed must be a whole number, 0 or more"),
        ({"seed": 10**400}, "--seed must be a whole number, 0 or more; found 1000"),
        (
            {"workers": 10**400},
            "--workers must be a whole number, at least 1 and at most 4096; found 1000",
        ),
        ({"workers": 0}, "--workers must be a whole number, at least 1 and at most 4096"),
        ({"failures": -1}, "--failures must be a whole number, 0 or more"),
        ({"replay": -1}, "--replay must be a whole number, 0 or more"),
        ({"timeout": float("nan")}, "--timeout must be above 0 and finite"),
        ({"time_limit": float("nan")}, "--time-limit must be above 0 and at most 86400"),
        ({"log": Path("eval.json")}, r"--log must be a file that ends with \.rrd"),
        ({"episodes": 10**9}, "--episodes must be .* at most 1e.06; found 1000000000"),
        ({"replay": 0, "resume": True}, "--resume must be left out with --replay"),
        ({"replay": 0, "against": Path("a.json")}, "--against must be left out with --replay"),
    ],
)
def test_other_options_are_refused(setting: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        EvaluateOptions(**setting)


def test_without_ray_it_is_told_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingExtraError, match=r"--cluster ray needs(.*)'\.\[ray\]"):
        evaluate(Odd(), PANDA, options(tmp_path, cluster="ray"), QUIET)


def test_ray_gives_the_same_results(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ray", reason="ray is not installed: pip install '.[ray]'")
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    toy = Toy(does={1: "raise", 2: "hang", 3: "exit"})
    specs = [EpisodeSpec(index=i, seed=i) for i in range(6)]
    results = {r.seed: r for r in RayCluster(workers=2, timeout=5.0).run(toy, specs)}
    assert sorted(results) == [s.seed for s in specs]
    assert "a bug of ours" in (results[1].error or "")
    assert results[2].cause == "timeout"
    assert results[3].cause == "limit"
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    for seed in (0, 4, 5):
        assert replace(results[seed], timing={}) == replace(toy(specs[seed]), timing={})
