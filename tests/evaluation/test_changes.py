"""Files that change while an evaluation runs: no report tells two versions as one."""

import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from robo47_qp.cli import main
from robo47_qp.errors import ModelError
from robo47_qp.evaluation import evaluation
from robo47_qp.evaluation.command import evaluate_chosen
from robo47_qp.evaluation.episode import Episode, EpisodeResult, EpisodeSpec
from robo47_qp.evaluation.evaluate import evaluate
from robo47_qp.evaluation.evaluation import ChangedError, Evaluation, PolicyEvaluation
from robo47_qp.evaluation.journal import Journal, JournalError
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.evaluation.policies import PolicyReference
from robo47_qp.model.robots import load_robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.tasks.reach.reach import Reach
from tests.toy_episodes import SETTINGS, Toy

ROOT = Path(__file__).resolve().parents[2]
MINE = "class Mine:\n    def reset(self, o): pass\n    def act(self, o): return None\n"


@pytest.fixture(autouse=True)
def threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers have it set; here, toy episodes run in this process."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")


@dataclass
class Changing:
    """Runs episodes here, and changes something after some; it may be interrupted after that."""

    after: int
    interrupted: bool = False
    now: dict[str, Any] = field(default_factory=lambda: dict(SETTINGS))
    ran: list[int] = field(default_factory=list)
    workers: int = 1

    def run(self, episode: Episode, specs: Sequence[EpisodeSpec]) -> Iterator[EpisodeResult]:
        for spec in specs:
            self.ran.append(spec.seed)
            if len(self.ran) > self.after:
                self.now["code"] = "other"
            yield Toy()(spec)
            if self.interrupted and len(self.ran) > self.after:
                raise KeyboardInterrupt


def evaluated(path: Path | None, executor: Changing, *, resume: bool = False) -> Any:
    def now() -> Mapping[str, Any]:
        return executor.now

    done = Evaluation(episode=Toy(), settings=SETTINGS, episodes=4, now=now)
    return done.run(executor, path, resume=resume)


@pytest.mark.parametrize(("after", "run"), [(0, 1), (1, 4), (3, 4)])
def test_a_change_ends_an_evaluation_without_a_report(after: int, run: int, tmp_path: Path) -> None:
    """After the first episode, where little is lost, or at the end; its journal is never resumed.

    Not even where what has changed is as before.
    """
    path, executor = tmp_path / "eval.jsonl", Changing(after)
    with pytest.raises(
        ChangedError, match=r"These changed while the evaluation ran: code\. .*\.jsonl"
    ):
        evaluated(path, executor)
    assert len(executor.ran) == run
    assert path.read_bytes().count(b'"seed"') == run
    with pytest.raises(JournalError, match=r"episodes of two versions; .*: code\. Name another"):
        evaluated(path, Changing(9), resume=True)
    evaluated(path, Changing(9))
    assert len(Journal.read(path, SETTINGS)) == 4


def test_a_change_is_told_also_where_the_evaluation_is_interrupted(tmp_path: Path) -> None:
    path = tmp_path / "eval.jsonl"
    with pytest.raises(ChangedError):
        evaluated(path, Changing(1, interrupted=True))
    with pytest.raises(JournalError, match="two versions"):
        evaluated(path, Changing(9), resume=True)
    with pytest.raises(ChangedError, match=r"none was written\. Let all"):
        evaluated(None, Changing(2))


def test_files_that_cannot_be_read_any_more_have_changed(tmp_path: Path) -> None:
    def now() -> Mapping[str, Any]:
        raise ModelError("no such file")

    done = Evaluation(episode=Toy(), settings=SETTINGS, episodes=2, now=now)
    with pytest.raises(ChangedError, match=r"ran: files \(no such file\)\."):
        done.run(Changing(9), tmp_path / "eval.jsonl")


def changed(chosen: PolicyEvaluation, change: Any) -> list[str]:
    before = chosen.evaluation
    assert before.now is not None
    assert before.now() == before.settings
    change()
    after = before.now()
    return [name for name, value in before.settings.items() if after[name] != value]


def test_policies_code_and_robots_are_looked_at_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine, code, arm = (tmp_path / name / f"{name}.py" for name in ("mine", "code", "arm"))
    for path in (mine, code, arm):
        path.parent.mkdir()
        path.write_text(MINE)
    task = Reach(count=1)
    policy = PolicyReference(text=f"{mine}:Mine")
    chosen = PolicyEvaluation(task=task, robot=PANDA, policy=policy)
    assert changed(chosen, lambda: mine.write_text(f"{MINE}# other")) == ["policy"]

    monkeypatch.setattr(evaluation, "_sources", lambda _: [code.parent])
    chosen = PolicyEvaluation(task=task, robot=PANDA)
    assert changed(chosen, lambda: code.write_text(f"{MINE}# other")) == ["code"]

    mjcf = arm.with_suffix(".xml")
    shutil.copy(ROOT / "tests" / "models" / "free7.xml", mjcf)
    mjcf.with_suffix(".toml").write_text('tcp = "tool"\nhome = [0, 0.26, 0, 1.9, 0, 0.98, 0]\n')
    heavier = re.sub(r'mass="([\d.]+)"', r'mass="1\1"', mjcf.read_text(), count=1)
    chosen = PolicyEvaluation(task=task, robot=load_robot(str(mjcf)))
    assert changed(chosen, lambda: mjcf.write_text(heavier)) == ["robot_sha256"]


def test_the_command_ends_with_2_and_leaves_the_journal_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A policy that writes into its folder."""
    folder, log = tmp_path / "policy", tmp_path / "logs" / "eval.rrd"
    folder.mkdir()
    writes = MINE.replace("return None", f"open({str(folder / 'seen')!r}, 'w').close()")
    (folder / "mine.py").write_text(writes)
    given = ["--task", "reach", "--policy", f"{folder}/mine.py:Mine", "--log", str(log)]
    monkeypatch.setattr("sys.argv", ["evaluate", *given, "--episodes", "2", "--workers", "1"])
    assert main(EvaluateOptions, evaluate_chosen, "", repeated=True) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "These changed while the evaluation ran: policy." in said
    assert [path.name for path in log.parent.iterdir()] == ["eval.jsonl"]
    options = EvaluateOptions(
        policy=(f"{folder}/mine.py:Mine",), episodes=2, workers=1, log=log, resume=True
    )
    with pytest.raises(JournalError, match="these"):
        evaluate(Reach(), PANDA, options, Console(quiet=True))
