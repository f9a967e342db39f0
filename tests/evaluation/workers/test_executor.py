"""Workers: every episode ends, whatever it does, and the others do not notice."""

import os
import pickle
import platform
import subprocess
import sys
import time
from pathlib import Path

import pytest

from robo47_qp._core.library import BACKENDS, using
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.episode import EpisodeResult, EpisodeSpec, died
from robo47_qp.evaluation.evaluation import PolicyEvaluation
from robo47_qp.evaluation.policies import PolicyReference
from robo47_qp.evaluation.workers import executor as executor_module
from robo47_qp.evaluation.workers.executor import LocalProcesses, cores
from robo47_qp.evaluation.workers.worker import Worker, WorkerError, wait_for, worker_environment
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.foreign_code import file_module
from robo47_qp.run.policy.drivers import PolicyTiming
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.toy_episodes import Toy, Unloadable

ROOT = Path(__file__).resolve().parents[3]


def specs(n: int) -> list[EpisodeSpec]:
    return [EpisodeSpec(index=i, seed=100 + i) for i in range(n)]


def test_every_episode_ends_whatever_it_does() -> None:
    toy = Toy(does={101: "raise", 102: "hang", 103: "exit"}, foreign=True)
    results = {r.seed: r for r in LocalProcesses(workers=2, timeout=1.0).run(toy, specs(6))}
    assert sorted(results) == list(range(100, 106))
    raised, hung, gone = (results[seed] for seed in (101, 102, 103))
    assert raised.error is not None
    assert raised.error.endswith("ZeroDivisionError: a bug of ours")
    assert "toy_episodes.py" in raised.error
    assert (raised.success, raised.cause) == (False, None)
    assert (hung.success, hung.cause, hung.error) == (False, "timeout", None)
    assert hung.evidence == "the episode took more than 1 s of wall time; its process was stopped"
    assert (gone.success, gone.cause, gone.error) == (False, "limit", None)
    assert gone.evidence == "the process of the episode died: exit code 7"
    for seed in (100, 104, 105):
        assert results[seed].error is None
        assert results[seed].metrics["threads"] == 1
        assert results[seed].index == seed - 100


def test_a_time_limit_longer_than_any_system_call_waits() -> None:
    (result,) = LocalProcesses(workers=1, timeout=1e300).run(Toy(), specs(1))
    assert (result.error, result.cause) == (None, "grasp")  # drawn from the seed


def test_a_death_under_our_own_code_is_our_error() -> None:
    spec = EpisodeSpec(index=0, seed=3)
    assert died(spec, "signal SIGSEGV", foreign=True).error is None
    ours = died(spec, "signal SIGSEGV", foreign=False)
    assert (ours.cause, ours.error) == (None, "the process of the episode died: signal SIGSEGV")


def test_what_a_worker_cannot_load_is_told() -> None:
    with pytest.raises(WorkerError, match=r"cannot start: (.|\n)*nothing like it here"):
        list(LocalProcesses(workers=1, timeout=1.0).run(Unloadable(), specs(1)))


def test_an_episode_of_a_class_in_a_file_runs_in_a_worker(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "from tests.toy_episodes import Toy\n\n\nclass Mine(Toy):\n    pass\n"
    )
    mine = file_module(tmp_path / "mine.py").Mine(does={100: "raise"}, foreign=True)
    failed, done = LocalProcesses(workers=1, timeout=5.0).run(mine, specs(2))
    assert "a bug of ours" in str(failed.error)
    assert done.error is None


def test_a_worker_that_does_not_get_ready_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(executor_module, "_START_TIMEOUT", 0.0)
    with pytest.raises(WorkerError, match="not ready after 0 s"):
        list(LocalProcesses(workers=1, timeout=1.0).run(Toy(), specs(1)))


def test_a_worker_ends_with_its_parent_and_keeps_quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    """A killed parent leaves no process behind, not even one that hangs."""
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    code = (
        "import os, pickle, sys, time\n"
        "from robo47_qp.evaluation.episode import EpisodeSpec\n"
        "from robo47_qp.evaluation.workers.worker import Worker, wait_for\n"
        "from tests.toy_episodes import Toy\n"
        "w = Worker(pickle.dumps(Toy(does={1: 'print', 2: 'hang'})), 60.0)\n"
        "while not w.ready:\n    wait_for([w]); w.heard()\n"
        "w.begin(EpisodeSpec(index=0, seed=1), 60.0)\n"
        "while w.spec:\n    wait_for([w]); w.heard()\n"
        "w.begin(EpisodeSpec(index=0, seed=2), 60.0)\n"
        "print(w._process.pid, flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False
    )
    pid = int(done.stdout)
    assert "not JSON" in done.stderr
    for _ in range(100):
        if not _alive(pid):
            return
        time.sleep(0.05)
    os.kill(pid, 9)
    pytest.fail("the worker outlived its parent")


def _alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


def test_the_environment_is_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "5")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    worker = Worker(pickle.dumps(Toy()), 60.0)
    worker.begin(EpisodeSpec(index=0, seed=4), 60.0)
    heard = None
    while heard is None:
        wait_for([worker])
        heard = worker.heard()
    worker.stop()
    assert isinstance(heard, EpisodeResult)
    assert heard.metrics["threads"] == 1
    assert os.environ["OMP_NUM_THREADS"] == "5"
    assert "MKL_NUM_THREADS" not in os.environ


@pytest.mark.parametrize("chosen", BACKENDS)
def test_workers_have_the_backend_that_reports_name(chosen: str) -> None:
    with using(chosen):
        assert worker_environment()["ROBO47_BACKEND"] == chosen  # for Ray, too
        toy = Toy(does={100: "backend"})
        (result,) = LocalProcesses(workers=1, timeout=60.0).run(toy, specs(1))
    assert result.metrics == {"backend": chosen}


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="tunes the allocator of glibc")
def test_large_blocks_are_given_back() -> None:
    (result,) = LocalProcesses(workers=1, timeout=60.0).run(Toy(does={100: "litter"}), specs(1))
    assert result.metrics["grown"] < 10e6


def test_numbers_out_of_range_are_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"--workers must be (.*), 1 or more; found 0"):
        LocalProcesses(workers=0, timeout=1.0)
    with pytest.raises(InvalidValueError, match="--timeout must be above 0 and finite; found 0"):
        LocalProcesses(workers=1, timeout=0.0)
    assert 1 <= cores() <= (os.cpu_count() or 1)


def test_what_a_policy_leaves_that_has_killed_its_warden_ends_with_its_episode() -> None:
    policy = PolicyReference(
        text="tests.run.policy.hostile_policies:Orphan", timing=PolicyTiming(seconds=0.3)
    )
    evaluation = PolicyEvaluation(
        task=PickPlace(), robot=PANDA, policy=policy, episodes=2, workers=1
    )
    results = evaluation.evaluation.run(evaluation.executor).results
    assert [result.cause for result in results] == ["limit", "limit"]
    for result in results:
        assert result.evidence is not None
        assert "its process ended with signal 9 in act" in result.evidence
    lines = [path.read_bytes() for path in Path("/proc").glob("[0-9]*/cmdline")]
    assert not [line for line in lines if b"sleep(600)\0/" in line]


def test_what_a_policy_leaves_that_has_stopped_its_warden_ends_with_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    policy = PolicyReference(text="tests.run.policy.hostile_policies:Holder")
    evaluation = PolicyEvaluation(
        task=PickPlace(), robot=PANDA, policy=policy, episodes=1, workers=1, timeout=8.0
    )
    (result,) = evaluation.evaluation.run(evaluation.executor).results
    assert result.cause == "timeout"
    lines = [path.read_bytes() for path in Path("/proc").glob("[0-9]*/cmdline")]
    assert not [line for line in lines if b"sleep(601)" in line or os.fsencode(tmp_path) in line]
    assert list(tmp_path.glob("robo47-policy-*")) == []


def test_half_a_module_is_loaded_anew_once_it_is_mended(tmp_path: Path) -> None:
    file = tmp_path / "policy.py"
    file.write_text("x = 1\nimport nothing_of_this_name")
    for _ in range(2):
        with pytest.raises(ImportError, match="nothing_of_this_name"):
            file_module(file)
    file.write_text("x = 2")
    assert file_module(file).x == 2
