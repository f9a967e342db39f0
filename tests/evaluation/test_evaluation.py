"""Evaluations: the same results whatever the workers, and whatever interrupts them."""

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

from robo47_qp._core.library import using
from robo47_qp.errors import InvalidValueError, RecordingError
from robo47_qp.evaluation.episode import Episode, EpisodeResult, EpisodeSpec
from robo47_qp.evaluation.evaluation import (
    _CODE,
    Evaluation,
    PolicyEvaluation,
    _sources,
    code_digest,
)
from robo47_qp.evaluation.journal import Journal, JournalError
from robo47_qp.evaluation.policies import PolicyReference
from robo47_qp.evaluation.replay import picked
from robo47_qp.evaluation.report.report import EvaluationReport
from robo47_qp.evaluation.workers.executor import LocalProcesses
from robo47_qp.model.robots import load_robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run import foreign_code
from robo47_qp.run.registry import load_task
from robo47_qp.tasks.handover.handover import Handover
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.runs import Reach
from tests.toy_episodes import SETTINGS, Toy

ROOT = Path(__file__).resolve().parents[2]


@dataclass
class Here:
    """Runs episodes in this process, and is interrupted after some."""

    interrupted_after: int | None = None
    ran: list[int] = field(default_factory=list)
    workers: int = 1

    def run(self, episode: Episode, specs: Sequence[EpisodeSpec]) -> Iterator[EpisodeResult]:
        for spec in reversed(specs):
            if len(self.ran) == self.interrupted_after:
                raise KeyboardInterrupt
            self.ran.append(spec.seed)
            yield episode(spec)


@pytest.fixture(autouse=True)
def _threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "1")


def evaluated(
    path: Path,
    executor: Any,
    *,
    episodes: int = 12,
    seed: int = 40,
    resume: bool = False,
    settings: Mapping[str, Any] = SETTINGS,
) -> EvaluationReport:
    evaluation = Evaluation(episode=Toy(), settings=settings, episodes=episodes, seed=seed)
    return evaluation.run(executor, path, resume=resume)


def figures(done: EvaluationReport) -> dict[str, Any]:
    """All that must not differ."""
    found = done.as_json()
    del found["timing"]
    for entry in found["entries"]:
        del entry["timing"]
    return found


def test_workers_and_their_order_do_not_matter(tmp_path: Path) -> None:
    one = evaluated(tmp_path / "one.jsonl", Here())
    two = evaluated(tmp_path / "two.jsonl", LocalProcesses(workers=2, timeout=60.0))
    assert figures(one) == figures(two)
    assert [r.seed for r in two.results] == list(range(40, 52))
    assert [r.index for r in two.results] == list(range(12))
    assert 0 < figures(one)["successes"] < 12


def test_an_interrupted_evaluation_goes_on_where_it_was(tmp_path: Path) -> None:
    path = tmp_path / "eval.jsonl"
    with pytest.raises(KeyboardInterrupt):
        evaluated(path, Here(interrupted_after=5))
    assert len(path.read_text().splitlines()) == 1 + 5
    rest = Here(workers=50)
    done = evaluated(path, rest, resume=True)
    assert sorted(rest.ran) == list(range(40, 47))
    assert done.timing is not None
    # More than there are episodes have nothing to do.
    assert done.timing.episodes == done.timing.workers == len(rest.ran)
    assert [r.seed for r in done.results] == list(range(40, 52))
    assert figures(done) == figures(evaluated(tmp_path / "whole.jsonl", Here()))


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_evaluation_loses_nothing_that_was_finished(
    tmp_path: Path, end: signal.Signals
) -> None:
    """SIGINT goes to the whole group, as Ctrl-C does."""
    path = tmp_path / "eval.jsonl"
    code = (
        "import signal, sys; from pathlib import Path\n"
        # Who runs the tests in the background may have told them to ignore Ctrl-C.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from robo47_qp.evaluation.evaluation import Evaluation\n"
        "from robo47_qp.evaluation.workers.executor import LocalProcesses\n"
        "from tests.toy_episodes import SETTINGS, Toy\n"
        "e = Evaluation(episode=Toy(pause=0.4), settings=SETTINGS, episodes=12, seed=40)\n"
        "e.run(LocalProcesses(workers=2, timeout=60.0), Path(sys.argv[1]), print, resume=False)\n"
    )
    command = [sys.executable, "-c", code, str(path)]
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while not path.exists() or path.read_bytes().count(b"\n") < 4:
        assert process.poll() is None
        time.sleep(0.02)
    if end is signal.SIGINT:
        os.killpg(process.pid, end)
    else:
        process.kill()
    # The workers hold the other end of the pipe: it ends when the last of them has.
    _, said = process.communicate()
    assert process.returncode != 0
    assert said.count("Traceback") == (1 if end is signal.SIGINT else 0)
    kept = path.read_bytes().count(b"\n") - 1
    assert 3 <= kept < 12
    rest = Here()
    done = evaluated(path, rest, resume=True)
    assert len(rest.ran) == 12 - kept
    assert figures(done) == figures(evaluated(tmp_path / "whole.jsonl", Here()))


@pytest.mark.parametrize("torn", [1, 30, -1])
def test_a_torn_last_line_is_run_again(tmp_path: Path, torn: int) -> None:
    path = tmp_path / "eval.jsonl"
    whole = evaluated(path, Here(), episodes=3)
    content = path.read_bytes()
    last = content[: content.rfind(b"\n", 0, -1) + 1]
    path.write_bytes(last + content[len(last) :][:torn])
    rest = Here()
    done = evaluated(path, rest, episodes=3, resume=True)
    assert rest.ran == [40]
    assert figures(done) == figures(whole)
    assert [json.loads(line)["seed"] for line in path.read_text().splitlines()[1:]] == [42, 41, 40]


def test_a_torn_header_is_no_journal_yet(tmp_path: Path) -> None:
    path = tmp_path / "eval.jsonl"
    path.write_bytes(b'{"journal": 1, "ta')
    ran = Here()
    assert len(evaluated(path, ran, episodes=2, resume=True).results) == len(ran.ran) == 2


def test_an_evaluation_can_be_made_longer(tmp_path: Path) -> None:
    path = tmp_path / "eval.jsonl"
    evaluated(path, Here(), episodes=3)
    longer = Here()
    done = evaluated(path, longer, episodes=5, resume=True)
    assert sorted(longer.ran) == [43, 44]
    assert len(done.results) == 5
    shorter = Here()
    assert len(evaluated(path, shorter, episodes=2, resume=True).results) == 2
    assert shorter.ran == []


@pytest.mark.parametrize(("seed", "left"), [(42, [43, 44, 45]), (39, [39]), (60, [60, 61, 62, 63])])
def test_an_evaluation_can_go_on_from_another_seed(
    tmp_path: Path, seed: int, left: list[int]
) -> None:
    """The results are those of an evaluation from that seed: a place belongs to one seed."""
    path = tmp_path / "eval.jsonl"
    evaluated(path, Here(), episodes=3)
    rest = Here()
    done = evaluated(path, rest, episodes=4, seed=seed, resume=True)
    assert sorted(rest.ran) == left
    assert [(r.index, r.seed) for r in done.results] == [(i, seed + i) for i in range(4)]
    assert figures(done) == figures(
        evaluated(tmp_path / "whole.jsonl", Here(), episodes=4, seed=seed)
    )
    again = evaluated(path, Here(), episodes=3, resume=True)
    assert [(r.index, r.seed) for r in again.results] == [(i, 40 + i) for i in range(3)]


def test_without_resume_the_journal_is_put_aside(tmp_path: Path) -> None:
    path = tmp_path / "eval.jsonl"
    names, before = ("eval.jsonl.old", "eval.2.jsonl.old", "eval.3.jsonl.old"), []
    for episodes in (3, 1, 4):
        evaluated(path, Here(), episodes=episodes)
        before.append(path.read_bytes())
    evaluated(path, Here(), episodes=2)
    assert [path.with_name(name).read_bytes() for name in names] == before
    assert len(path.read_text().splitlines()) == 3


def test_a_journal_of_something_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "eval.jsonl"
    evaluated(path, Here(), episodes=2)
    before = path.read_bytes()
    other = {**SETTINGS, "robot": "hinge6", "code": "abc"}
    with pytest.raises(JournalError, match=r"these differ: robot, code\. Ask for the"):
        evaluated(path, Here(), settings=other, resume=True)
    assert path.read_bytes() == before
    for content in (b"[1]\n", b"hello\n", before + b'{"seed": 3}\n', b"\xff\xfe\n"):
        path.write_bytes(content)
        with pytest.raises(JournalError, match=r"not the journal of an evaluation|its form"):
            evaluated(path, Here(), resume=True)
        assert path.read_bytes() == content


def test_a_journal_that_cannot_be_written_is_told_before_anything_runs(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    ran = Here()
    with pytest.raises(RecordingError, match="cannot be written"):
        evaluated(tmp_path / "file" / "eval.jsonl", ran)
    assert ran.ran == []


def test_every_line_is_on_the_disk_before_the_next_episode_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, synced = tmp_path / "eval.jsonl", []

    def fsync(descriptor: int) -> None:
        assert os.fstat(descriptor).st_ino == path.stat().st_ino
        synced.append(path.read_bytes().count(b"\n"))

    monkeypatch.setattr(os, "fsync", fsync)
    journal = Journal(path, SETTINGS, resume=False)
    for i in range(2):
        journal.add(Toy()(EpisodeSpec(index=i, seed=i)))
    assert synced == [1, 2, 3]
    journal.close()


@pytest.mark.skipif(sys.platform == "win32", reason="limits of POSIX")
def test_a_full_disk_is_told_once_and_what_was_written_is_kept(tmp_path: Path) -> None:
    import resource

    path = tmp_path / "eval.jsonl"
    evaluated(path, Here(), episodes=2)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 50, hard))
    try:
        with pytest.raises(
            RecordingError, match=r"File too large\. It holds 2 episodes; make room"
        ):
            evaluated(path, Here(), episodes=4, resume=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    rest = Here()
    evaluated(path, rest, episodes=4, resume=True)
    assert len(rest.ran) == 2


def test_the_progress_is_shown_from_the_start(tmp_path: Path) -> None:
    path, shown = tmp_path / "eval.jsonl", []
    evaluated(path, Here(), episodes=2)
    evaluation = Evaluation(episode=Toy(), settings=SETTINGS, episodes=4, seed=40)
    evaluation.run(Here(), path, lambda results: shown.append(len(results)), resume=True)
    assert shown == [2, 3, 4]


def test_nothing_to_evaluate_is_refused() -> None:
    for episodes, seed, found in ((0, 0, "--episodes"), (1, -1, "--seed")):
        with pytest.raises(InvalidValueError, match=found):
            Evaluation(episode=Toy(), settings={}, episodes=episodes, seed=seed)


def test_two_results_are_the_same_but_for_their_times() -> None:
    a = Toy()(EpisodeSpec(index=0, seed=1))
    assert a.is_same(replace(a, timing={"wall_s": 9.0}))
    assert not a.is_same(replace(a, sha256="0"))
    assert EpisodeResult.of_entry(json.loads(json.dumps(a.entry()))) == a


def test_of_many_failures_each_cause_is_looked_at() -> None:
    causes = ["drop", "drop", "drop", None, "slip", "drop", "ik"]
    results = [
        EpisodeResult(index=i, seed=i, success=cause is None, cause=cause)
        for i, cause in enumerate(causes)
    ]
    results.append(EpisodeResult(index=7, seed=7, success=False, error="ours"))
    assert [r.index for r in picked(results, 3)] == [0, 4, 6]
    assert [r.index for r in picked(results, 4)] == [0, 1, 4, 6]
    assert len(picked(results, 99)) == 6
    assert picked(results, 0) == []


def test_other_code_has_another_digest(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a.py").write_text("x = 1")
    before = code_digest([tmp_path])
    (tmp_path / "notes.txt").write_text("nothing that runs")
    assert code_digest([tmp_path]) == before
    (tmp_path / "sub" / "a.py").write_text("x = 2")
    assert code_digest([tmp_path]) != before
    one = tmp_path / "sub" / "a.py"
    alone = code_digest([one])
    one.write_text("x = 3")
    assert code_digest([one]) != alone


@pytest.mark.parametrize("name", ["friction.c", "friction.h", "arm.xml"])
def test_the_compiled_core_and_models_are_code(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("one law")
    before = code_digest([tmp_path])
    (tmp_path / name).write_text("another law")
    assert code_digest([tmp_path]) != before


def test_all_that_the_package_ships_is_code() -> None:
    """What a wheel holds beside Python: its patterns are those of the digest."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    shipped = project["tool"]["setuptools"]["package-data"].values()
    endings = {Path(pattern).suffix for patterns in shipped for pattern in patterns}
    assert endings - {".typed"} <= set(_CODE)
    assert ".py" in _CODE


def test_another_backend_is_another_evaluation(tmp_path: Path) -> None:
    with using("compiled"):
        before = PolicyEvaluation(task=Reach(), robot=PANDA).evaluation.settings
    with using("numpy"):
        after = PolicyEvaluation(task=Reach(), robot=PANDA).evaluation.settings
    evaluated(tmp_path / "eval.jsonl", Here(), episodes=1, settings=before)
    with pytest.raises(JournalError, match=r"these differ: versions\."):
        evaluated(tmp_path / "eval.jsonl", Here(), episodes=1, settings=after, resume=True)


def test_code_behind_a_link_counts(tmp_path: Path) -> None:
    """As the tasks of a checkout do, which the package holds as a link."""
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    inside.mkdir()
    outside.mkdir()
    (inside / "linked").symlink_to(outside)
    before = code_digest([inside])
    (outside / "task.py").write_text("x = 1")
    assert code_digest([inside]) != before


def test_the_code_of_a_task_of_a_file_is_its_file_and_what_it_loads_from_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    # Workers of later tests do not find what is beside it.
    monkeypatch.setattr(foreign_code, "_FILES", [])
    (tmp_path / "places_beside.py").write_text("HERE = 1")
    (tmp_path / "unrelated.py").write_text("HERE = 2")
    text = "import places_beside\nfrom tests.runs import Reach\nclass Mine(Reach):\n    pass\n"
    (tmp_path / "mine.py").write_text(text)
    task = load_task(f"{tmp_path}/mine.py:Mine")()
    found = [path.name for path in _sources(task) if path.parent == tmp_path]
    assert found == ["mine.py", "places_beside.py"]


def test_the_code_of_a_task_is_that_of_its_whole_package() -> None:
    (folder,) = _sources(PickPlace())
    assert (folder / "stack.py").is_file()
    assert (folder / "tasks" / "item.py").is_file()
    package, tests = _sources(Reach())
    assert (package, tests) == (folder, ROOT / "tests")


def test_policies_are_refused_where_a_task_needs_two_tools() -> None:
    policy = PolicyReference(text="nobody:Policy")
    evaluation = PolicyEvaluation(task=Handover(), robot=load_robot("panda_pair"), policy=policy)
    with pytest.raises(
        InvalidValueError, match=r"task must be one that a single tool does.*'handov"
    ):
        evaluation.evaluation  # noqa: B018
