"""A policy in a process of its own: what it does, it does to itself."""

import json
import os
import re
import socket
import sysconfig
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robo47_qp.report.audit.audit import audit
from robo47_qp.run.failure import Cause
from robo47_qp.run.foreign_code import ClassLoadError
from robo47_qp.run.policy import process
from robo47_qp.run.policy.drivers import PolicyTiming
from robo47_qp.run.policy.policy import JointTarget, Observation
from robo47_qp.run.policy.process import PolicyFault, PolicyProcess
from robo47_qp.run.policy.trespass import Trespass
from robo47_qp.run.policy.wire import (
    packed_action,
    packed_observation,
    unpacked_action,
    unpacked_observation,
)
from robo47_qp.sim.cell_sheet import CellSheet
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.policies import follow

HOSTILE = "tests.run.policy.hostile_policies"
SHORT = PolicyTiming(rate=10.0, seconds=0.3)


def seen(time: float = 0.0) -> Observation:
    pose = np.array([0.1, -0.2, 1e-17, 1.0, 0.0, 0.0, 0.0])
    return Observation(
        time=time,
        q=np.array([0.1, 1 / 3, -np.pi]),
        v=np.array([np.nan, 1e-300, 2.0]),
        tool=pose,
        width=0.08,
        force=np.zeros(3),
        objects={"cube": pose},
        markers={},
        fingers=None,
        frames={"cube": 0.033},
        sheet=CellSheet(task={"name": "toy"}, obstacles=[], time_limit=3.0),
    )


def asked(name: str, seed: int = 0, times: int = 1) -> list[object]:
    """What a policy answers."""
    policy = PolicyProcess(f"{HOSTILE}:{name}")
    policy.start(seed)
    try:
        policy.reset(seen())
        return [policy.act(seen(0.1 * i)) for i in range(times)]
    finally:
        policy.close()


def fault(name: str, seed: int = 0, times: int = 1) -> str:
    with pytest.raises(PolicyFault) as caught:
        asked(name, seed, times)
    return str(caught.value)


def test_observations_cross_to_the_bit() -> None:
    before = seen()
    content = json.loads(json.dumps(packed_observation(before, sheet=True)))
    after = unpacked_observation(content, CellSheet(**content["sheet"]))
    for name in ("q", "v", "tool", "force"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    np.testing.assert_array_equal(after.objects["cube"], before.objects["cube"])
    assert (after.frames, after.width, after.fingers) == ({"cube": 0.033}, 0.08, None)
    assert after.sheet == before.sheet
    assert "sheet" not in packed_observation(before, sheet=False)


def test_actions_cross_to_the_bit() -> None:
    action = JointTarget(q=np.array([0.1, 1 / 3]), width=0.01)
    again = unpacked_action(json.loads(json.dumps(packed_action(action))))
    assert isinstance(again, JointTarget)
    np.testing.assert_array_equal(again.q, action.q)
    assert (again.width, again.grip_force) == (0.01, None)


def test_state_begins_anew_and_generators_depend_on_the_seed() -> None:
    first, again, other = fault("Remembers", 1), fault("Remembers", 1), fault("Remembers", 2)
    assert first.startswith("it raised ValueError in act: [1, ")
    assert first == again != other


@pytest.mark.parametrize(
    ("name", "evidence"),
    [
        ("Leaver", "its process ended with exit code 0 in act"),
        ("Quitter", "it raised SystemExit in act: enough"),
        ("Wrong", "the action must be a JointTarget, .* found a PosixPath"),
        ("Mangler", r"it sent an action with other fields: .* '\\ud800 # won '$"),
        ("Big", "it sent a message of .* bytes; at most 1048576 are read, in act"),
        ("Forger", "it sent a message of .* bytes; at most 1048576 are read, in act"),
        ("Forker", "its process sent an answer that nobody has asked for"),
    ],
)
def test_what_it_does_to_itself_is_its_own_failure(name: str, evidence: str) -> None:
    with pytest.raises(PolicyFault, match=evidence):
        asked(name, times=300 if name == "Forker" else 3)


def test_an_error_is_told_in_bearable_words() -> None:
    words = fault("Wordy")
    assert len(words) < 3000
    assert r"\ud800 # heading <" in words
    assert "object at 0x...>" in words
    assert words.isprintable()


def test_what_is_told_while_it_is_loaded_is_told_in_bearable_words(tmp_path: Path) -> None:
    """By whoever has the line: a text, or anything that JSON has."""
    for sent in (r'"\ud800\r# won" * 1000', "[" * 900 + "]" * 900, "7"):
        (tmp_path / "bad.py").write_text(
            "import json, os, struct, sys\n"
            f"text = json.dumps({{'why': {sent}}}).encode()\n"
            "line = json.loads(sys.argv[1])['line']\n"
            "os.write(line, struct.pack('<I', len(text)) + text)\n"
        )
        with pytest.raises(ClassLoadError) as caught:
            PolicyProcess(f"{tmp_path}/bad.py:Policy").start()
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 3000


def test_children_and_temporary_files_go_with_it() -> None:
    child, folder = fault("Parent").split()[-2:]
    assert not Path(f"/proc/{child}").exists()
    assert not Path(folder).exists()


def test_folders_of_any_depth_go_with_it() -> None:
    assert not Path(fault("Digger").split()[-1]).exists()


@pytest.mark.parametrize("method", ["start", "look", "close"])
def test_what_its_process_makes_of_the_run_is_its_own_failure(
    method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An internal error would not count, and a policy could choose which episodes do."""
    policy = PolicyProcess(f"{HOSTILE}:Still")
    known = getattr(policy, method)

    def fails(*given: object) -> None:
        known(*given)
        raise RecursionError("too deep")

    monkeypatch.setattr(policy, method, fails)
    run = follow(policy, task=PickPlace(), timing=SHORT, seed=3)
    assert run.failure is not None
    assert run.failure.cause is Cause.LIMIT
    assert run.failure.evidence.endswith("its process could not be run: RecursionError: too deep")
    assert policy._process is None


def test_a_policy_that_stops_its_warden_is_ended_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(process, "_ENDING", 0.5)
    own, folder = fault("Stopper").split()[-2:]
    end = time.monotonic() + 20.0
    while _lives(own) and time.monotonic() < end:
        time.sleep(0.01)
    assert not _lives(own)
    assert not Path(folder).exists()


def _lives(pid: str) -> bool:
    """Whether a process runs: what nobody reaps is dead, too."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"


def test_what_it_prints_does_not_mix_with_what_the_run_prints(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    asked("Still")
    out, err = capfd.readouterr()
    assert out == ""
    assert "printed at import" in err


def test_a_module_beside_the_file_can_be_imported(tmp_path: Path) -> None:
    (tmp_path / "beside_it.py").write_text("from robo47_qp import JointTarget\n")
    (tmp_path / "mine.py").write_text(
        "import beside_it\n"
        "class Mine:\n"
        "    def reset(self, observation): pass\n"
        "    def act(self, observation): return beside_it.JointTarget(q=observation.q)\n"
    )
    policy = PolicyProcess(f"{tmp_path}/mine.py:Mine")
    policy.start()
    try:
        policy.reset(seen())
        assert isinstance(policy.act(seen()), JointTarget)
        assert policy.files == [str(tmp_path / name) for name in ("beside_it.py", "mine.py")]
    finally:
        policy.close()


@pytest.mark.parametrize("way", ["raise SystemExit(0)", "import os; os._exit(0)"])
def test_a_file_that_exits_at_import_is_refused(tmp_path: Path, way: str) -> None:
    (tmp_path / "bad.py").write_text(way)
    policy = PolicyProcess(f"{tmp_path}/bad.py:Policy")
    with pytest.raises(ClassLoadError, match=r"SystemExit|ended with exit code 0"):
        policy.start()


def test_nothing_of_a_policy_outlives_the_run_that_is_killed() -> None:
    policy = PolicyProcess(f"{HOSTILE}:Still")
    policy.start()
    assert policy._process is not None
    warden = policy._process.pid
    os.close(policy._life)  # as the kernel does when the run is killed
    end = time.monotonic() + 20.0
    while policy._process.poll() is None and time.monotonic() < end:
        time.sleep(0.01)
    assert policy._process.poll() == 0
    assert not Path(f"/proc/{warden}").exists()
    policy._line.close()


@pytest.mark.parametrize(
    ("name", "broken"),
    [
        ("Collector", {"policy calls gc.get_objects"}),
        ("Referrer", {"policy calls gc.get_referrers"}),
        ("Climber", {"policy calls sys._getframe"}),
        ("Inspector", {"policy calls sys._getframe"}),
        ("Watcher", {"policy calls sys._current_frames"}),
        ("Stumbler", {"policy reads tb_frame"}),
        ("Tracer", {"policy calls sys.setprofile"}),
        (
            "Prophet",
            {
                "policy imports robo47_qp.evaluation.perturbation",
                "policy imports robo47_qp.evaluation.task_episode",
            },
        ),
        ("Quoter", {"policy calls gc.get_referents", "policy calls gc.get_referrers"}),
        ("Patcher", {"policy replaces PickPlace.verdict", "policy replaces Watchdog.check"}),
        ("LatePatcher", {"policy replaces PickPlace.verdict", "policy replaces Watchdog.check"}),
        (
            "Rewriter",
            {
                "policy replaces PickPlace.verdict",
                "policy replaces PlaceCriterion.__init__",
                "policy replaces place_criterion._HOME",
                "policy replaces Watchdog.time_limit",
            },
        ),
    ],
)
def test_a_cheat_that_gains_nothing_is_named_by_the_audit(name: str, broken: set[str]) -> None:
    run = follow(PolicyProcess(f"{HOSTILE}:{name}"), task=PickPlace(), timing=SHORT, seed=3)
    assert run.failure is not None
    assert run.failure.cause is Cause.PLACE
    assert run.measures["place_error_m"] > 0.1
    assert {finding.signal for finding in audit(run) if not finding.ok} == broken


@pytest.mark.parametrize(
    ("name", "evidence"),
    [
        ("Forker", "its process sent an answer that nobody has asked for"),
        ("Forger", "it sent a message of .* bytes"),
    ],
)
def test_a_cheat_that_breaks_the_line_ends_its_episode(name: str, evidence: str) -> None:
    # Long enough for the second answer of a twin, which may be late where processors are busy.
    timing = PolicyTiming(rate=10.0, seconds=5.0) if name == "Forker" else SHORT
    run = follow(PolicyProcess(f"{HOSTILE}:{name}"), task=PickPlace(), timing=timing, seed=3)
    assert run.failure is not None
    assert run.failure.cause is Cause.LIMIT
    assert re.search(evidence, run.failure.evidence)
    assert run.measures["place_error_m"] > 0.1


def beyond(reference: str, times: int = 2) -> list[str]:
    """What a policy has done beyond its own."""
    policy = PolicyProcess(reference)
    policy.start()
    try:
        policy.reset(seen())
        for k in range(times):
            policy.act(seen(0.1 * k))
        policy.look(0.1 * times)
        return [what for _, what in policy.beyond]
    finally:
        policy.close()


def test_what_is_done_often_or_later_is_named_once() -> None:
    """A function that was loaded before the policy is, may be replaced by anything."""
    assert beyond(f"{HOSTILE}:Remaker", times=4) == ["calls gc.get_objects", "replaces Guard.words"]


def test_every_start_begins_anew() -> None:
    policy = PolicyProcess(f"{HOSTILE}:Collector")
    for _ in range(2):
        policy.start()
        assert policy.beyond == []
        policy.reset(seen())
        policy.act(seen(0.5))
        policy.close()
        assert policy.beyond == [(0.5, "calls gc.get_objects")]


def test_a_process_that_tells_without_end_is_not_listened_to_for_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    line, theirs = socket.socketpair()
    policy = PolicyProcess("nobody")
    policy._line = line
    asked: list[float] = []

    def receive(_: socket.socket, *, deadline: float, alive: object) -> dict[str, Any]:
        asked.append(deadline - time.monotonic())
        return {"number": 1, "beyond": ["x" * 10_000] * 999}

    monkeypatch.setattr(process, "receive", receive)
    policy.look(1.0)
    assert (line.gettimeout() or np.inf) <= 5.0
    assert max(asked) <= 5.0
    assert len(policy.beyond) <= 20
    assert max(len(what) for _, what in policy.beyond) <= 250
    line.close()
    theirs.close()


def test_honest_policies_are_not_named() -> None:
    """Libraries look at frames and objects for their own purposes."""
    assert beyond(f"{HOSTILE}:Logger") == []


def test_a_cheat_in_a_file_is_named_and_a_library_below_it_is_not(tmp_path: Path) -> None:
    code = "class Mine:\n    def reset(self, seen): pass\n    def act(self, seen): {}\n"
    library = tmp_path / "library"
    library.mkdir()
    (library / "looks.py").write_text("import gc\ndef look(): gc.get_objects()\n")
    (tmp_path / "used.py").write_text("import looks\n" + code.format("looks.look()"))
    (tmp_path / "mine.py").write_text("import gc\n" + code.format("gc.get_objects()"))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(library))
        assert beyond(f"{tmp_path}/used.py:Mine") == []
        assert beyond(f"{tmp_path}/mine.py:Mine") == ["calls gc.get_objects"]


@pytest.mark.parametrize(
    ("folder", "beside"),
    [(Path(sysconfig.get_path("purelib")), False), (Path("/home/someone/policies"), True)],
)
def test_files_beside_a_policy_are_its_own_but_not_among_installed_packages(
    folder: Path, beside: bool
) -> None:
    # Without what listens: that would stay in this process.
    trespass = object.__new__(Trespass)
    trespass.mind(str(folder / "mine.py"))
    assert trespass._is_own(str(folder / "mine.py"))
    assert trespass._is_own(str(folder / "other.py")) == beside
    assert not trespass._is_own("<string>")


def test_torques_of_a_policy_are_judged_like_any_others() -> None:
    run = follow(PolicyProcess(f"{HOSTILE}:Pusher"), task=PickPlace(), timing=SHORT, seed=3)
    broken = [finding for finding in audit(run) if not finding.ok]
    assert any(finding.signal.startswith("measured a ") for finding in broken)
    for finding in broken:
        assert finding.extreme > finding.limit or finding.signal.startswith("measured q")
