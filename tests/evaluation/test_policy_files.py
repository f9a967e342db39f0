"""What a policy depends on: code and weights in its folder, not what evaluations leave there."""

import os
import subprocess
import sys
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from rich.console import Console

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation import evaluation, policy_files
from robo47_qp.evaluation.evaluate import evaluate
from robo47_qp.evaluation.evaluation import PolicyEvaluation
from robo47_qp.evaluation.journal import JournalError
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.evaluation.policies import PolicyReference
from robo47_qp.evaluation.policy_files import digest_of, files_in, package_folder
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.foreign_code import ClassLoadError
from robo47_qp.tasks.reach.reach import Reach
from tests.evaluation.odd_episodes import InProcess

MINE = "class Mine:\n    def reset(self, o): pass\n    def act(self, o): return None\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "policy"
    made.mkdir()
    (made / "mine.py").write_text(MINE)
    (made / "weights.npy").write_bytes(b"first")
    return made


def digest(folder: Path) -> str | None:
    return PolicyReference(text=f"{folder}/mine.py:Mine").digest


def put(folder: Path, name: str, content: bytes = b"x") -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def linked(folder: Path, elsewhere: Path) -> Path:
    """A file elsewhere, of a folder that a link names; another link leads back."""
    (folder / "net").symlink_to(elsewhere)
    (elsewhere / "back").symlink_to(folder)
    return put(elsewhere, "weights.bin")


@pytest.mark.parametrize(
    "where",
    [
        lambda folder: folder / "weights.npy",
        lambda folder: put(folder, "checkpoints/last/net.safetensors"),
        lambda folder: put(folder, "net/layers.py"),
        lambda folder: put(folder, "prompts.jsonl", b'{"say": "pick"}\n'),
        lambda folder: put(folder, "config.json"),
        lambda folder: linked(folder, put(folder.parent, "far/readme").parent),
    ],
)
def test_what_lies_in_its_folder_is_part_of_a_policy(
    where: Callable[[Path], Path], folder: Path
) -> None:
    path = where(folder)
    before = digest(folder)
    assert before == digest(folder)
    path.write_bytes(b"other")
    changed = digest(folder)
    assert changed != before
    path.rename(path.with_name(f"renamed{path.suffix}"))
    assert digest(folder) not in (before, changed)


@pytest.mark.parametrize(
    "name",
    [
        ".git/index",
        ".hidden",
        "__pycache__/mine.cpython-311.pyc",
        "logs/eval.json",
        "net/logs/eval.json",
        "venv/lib/six.py",
    ],
)
def test_what_is_hidden_or_made_by_others_is_not(name: str, folder: Path) -> None:
    put(folder, "venv/pyvenv.cfg")
    before = digest(folder)
    path = put(folder, name)
    assert digest(folder) == before
    path.write_bytes(b"y")
    assert digest(folder) == before


def test_what_evaluations_and_runs_write_beside_a_policy_is_not(folder: Path) -> None:
    put(folder, "prompts.json")
    own = {folder / name for name in ("mine.py", "weights.npy", "prompts.json")}
    for name in ("eval.json", "eval.md", "eval.png", "eval.lock", "eval.mine-py-Mine.json"):
        put(folder, name)
    assert set(files_in(folder)) > own
    put(folder, "eval.jsonl.old")
    put(folder, "eval.2.jsonl.old")
    put(folder, "eval.mine-py-Mine.jsonl", b'{"journal": 1, "task": {}}\n')
    for ending in ("rrd", "json", "rows"):
        put(folder, f"eval-reach-5.{ending}")
    assert set(files_in(folder)) == own


def test_where_the_output_is_redirected_to_is_not(folder: Path) -> None:
    code = "from robo47_qp.evaluation.policy_files import files_in; from pathlib import Path; "
    code += "print(*(path.name for path in files_in(Path())), flush=True)"
    before = [path.name for path in files_in(folder)]
    out, err = folder / "out.txt", folder / "err.txt"
    with out.open("w") as told, err.open("w") as errors:
        command = [sys.executable, "-c", code]
        subprocess.run(command, cwd=folder, stdout=told, stderr=errors, check=True)
    assert out.read_text().split() == before
    assert folder / "out.txt" in files_in(folder)


def test_a_file_that_nobody_can_read_does_not_stand_in_the_way(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = digest(folder)
    (folder / "gone").symlink_to("nowhere")
    assert digest(folder) == before
    # As between the look into the folder and the look into the file.
    found = files_in(folder)
    monkeypatch.setattr(
        "robo47_qp.evaluation.policies.files_in", lambda _: [*found, folder / "gone"]
    )
    assert digest(folder) == before


def test_a_pipe_that_a_policy_tells_for_a_file_is_not_waited_for(folder: Path) -> None:
    os.mkfifo(folder / "fifo")
    told, found = [folder / "fifo", Path("nul\0"), folder / "mine.py"], list[str]()
    reading = Thread(target=lambda: found.append(digest_of(told, folder)), daemon=True)
    reading.start()
    reading.join(20.0)
    assert found == [digest_of([folder / "mine.py"], folder)]


def test_a_policy_is_loaded_within_the_time_of_an_episode(folder: Path) -> None:
    (folder / "mine.py").write_text("import time; time.sleep(600.0)")
    policy = PolicyReference(text=f"{folder}/mine.py:Mine")
    slow = PolicyEvaluation(task=Reach(count=1), robot=PANDA, policy=policy, timeout=0.5)
    with pytest.raises(ClassLoadError, match="gave no answer while it was loaded"):
        slow.evaluation  # noqa: B018


def test_a_folder_of_too_many_files_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(policy_files, "MOST", 5)
    for i in range(3):
        put(folder, f"data/{i}")
    assert digest(folder) is not None
    put(folder, "data/3")
    with pytest.raises(InvalidValueError, match=r"in a folder of its own, .* \(at most 5 files\)"):
        digest(folder)


def test_the_files_of_a_module_are_those_of_its_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    module = put(tmp_path, "learned_net/heads/mine.py", MINE.encode())
    assert package_folder(module) is None

    put(tmp_path, "learned_net/__init__.py", b"")
    put(tmp_path, "learned_net/heads/__init__.py", b"")
    assert package_folder(module) == tmp_path / "learned_net"
    weights, beside = put(tmp_path, "learned_net/weights/net.npy"), put(tmp_path, "notes.txt")

    def now() -> str | None:
        return PolicyReference(text="learned_net.heads.mine:Mine").digest

    before = now()
    beside.write_bytes(b"y")
    assert now() == before
    weights.write_bytes(b"y")
    assert now() != before


def test_an_evaluation_with_other_weights_is_not_gone_on_with(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its files lie beside the policy, where the first half of it has left them."""
    monkeypatch.setattr(evaluation, "LocalProcesses", InProcess)
    screen = StringIO()

    def run(**chosen: Any) -> int:
        options = EvaluateOptions(
            policy=(f"{folder}/mine.py:Mine",),
            workers=1,
            log=folder / "eval.rrd",
            resume=True,
            **chosen,
        )
        return evaluate(Reach(count=1), PANDA, options, Console(file=screen, width=200))

    assert run(episodes=1) == 0
    assert (folder / "eval.rrd").exists()
    assert run(episodes=2, failures=0) == 0
    assert len((folder / "eval.jsonl").read_text().splitlines()) == 3
    (folder / "weights.npy").write_bytes(b"second")
    with pytest.raises(JournalError, match=r"these differ: policy\."):
        run(episodes=3)
