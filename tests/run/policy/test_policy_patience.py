"""How long a policy is waited for: as long as was said, whatever comes meanwhile."""

import time
from pathlib import Path

import pytest

from robo47_qp.run.foreign_code import ClassLoadError
from robo47_qp.run.policy import process
from robo47_qp.run.policy.process import PolicyFault, PolicyProcess
from tests.run.policy.test_policy_process import HOSTILE, seen


def waited(policy: PolicyProcess, evidence: str) -> float:
    """How long it takes until the fault is told [s]."""
    policy.start()
    try:
        policy.reset(seen())
        policy._patience, started = 0.3, time.monotonic()
        with pytest.raises(PolicyFault, match=evidence):
            policy.act(seen())
        return time.monotonic() - started
    finally:
        policy.close()


@pytest.fixture
def _short_grace(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "_GRACE", 0.1)


@pytest.mark.usefixtures("_short_grace")
@pytest.mark.parametrize("name", ["Sleeper", "Dripper"])
def test_a_policy_that_gives_no_whole_answer_is_not_waited_for(name: str) -> None:
    """Not even where a byte of it comes now and then."""
    policy = PolicyProcess(f"{HOSTILE}:{name}")
    assert waited(policy, r"^its process gave no answer in act$") < 5.0


@pytest.mark.usefixtures("_short_grace")
def test_a_policy_that_is_never_loaded_is_not_waited_for(tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text("import time; time.sleep(600.0)")
    policy = PolicyProcess(f"{tmp_path}/slow.py:Policy", patience=0.3)
    with pytest.raises(ClassLoadError, match="its process gave no answer while it was loaded"):
        policy.start()


def test_a_policy_may_be_waited_for_longer_than_any_system_call() -> None:
    policy = PolicyProcess(f"{HOSTILE}:Still", patience=1e300)
    policy.start()
    policy.reset(seen())
    policy.close()


def test_the_end_of_a_warden_is_noticed_though_its_line_is_held() -> None:
    """By a process that the policy has left: it may never give an answer."""
    policy = PolicyProcess(f"{HOSTILE}:Heir", patience=20.0)
    policy.start()
    try:
        policy.reset(seen())
        started = time.monotonic()
        with pytest.raises(PolicyFault, match=r"^its process ended with signal 9 in act$"):
            policy.act(seen())
        assert time.monotonic() - started < 10.0
    finally:
        policy.close()
