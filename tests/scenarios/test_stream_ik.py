"""The streaming scenario: its run in short, and an audit that sees what it should."""

import json

import numpy as np
import pytest
from rich.console import Console

from robo47_qp.cli import OK
from robo47_qp.collision.clearance import Clearance
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.benchmarks.ik.hostile_targets import DT, OBSTACLES
from robo47_qp.evaluation.benchmarks.ik.stream_audit import audit, clearance_audit
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from scenarios import stream_ik
from scenarios.stream_ik import StreamOptions


def test_a_short_run_keeps_everything_and_tells_it(capsys: pytest.CaptureFixture[str]) -> None:
    options = StreamOptions(ticks=2500, far=0, json=True)
    assert stream_ik.run(options, Console(quiet=True)) == OK
    figures = json.loads(capsys.readouterr().out)
    assert figures["pairs"] >= 30
    for name in ("q", "v", "a", "clearance"):
        assert figures[f"{name}_violations"] == 0
    assert figures["target_jumped"] > 0
    assert figures["circle_error_mm"] < 0.1
    assert 0.0 < figures["ms_median"] <= figures["ms_p99"] <= figures["ms_max"]


def test_the_audit_sees_each_limit_broken_once() -> None:
    arm, profile = Arm(PANDA), PANDA.profile
    still = np.tile(PANDA.home, (10, 1))
    zero = np.zeros_like(still)

    def found(q: object = still, v: object = zero, a: object = zero) -> list[int]:
        told = audit(arm, profile, DT, PANDA.home, np.array(q), np.array(v), np.array(a))
        return [told[f"{name}_violations"] for name in ("q", "v", "a")]

    assert found() == [0, 0, 0]
    out = still.copy()
    out[9, 0] = arm.q_max[0] + 1e-12
    assert found(q=out)[0] == 1
    fast = zero.copy()
    fast[4:, 2] = np.nextafter(profile.v_max[2], 9.0)
    assert found(v=fast)[1] == 6
    hard = zero.copy()
    hard[3, 1] = -1.001 * profile.a_max[1]
    assert found(a=hard)[2] == 1
    # What is told is fine; what the positions do is not.
    moved = still.copy()
    moved[5:, 3] += 1.01 * profile.v_max[3] * DT
    assert found(q=moved)[1] == 1
    moved = still.copy()
    moved[5:, 3] += 1.01 * profile.a_max[3] * DT**2
    assert found(q=moved)[1:] == [0, 2]


def test_the_clearance_audit_agrees_with_the_distances_of_the_package() -> None:
    rng = np.random.default_rng(8)
    arm = Arm(PANDA, obstacles=OBSTACLES)
    clearance = Clearance(arm, 0.02)
    q = rng.uniform(arm.q_min, arm.q_max, (300, arm.n))
    # Contacts are not looked for between a link and the next: leave such cases out.
    cases = [(now, *clearance.nearest(now)) for now in q]
    clear, close = 0, 0
    for now, distance, names in cases:
        told = clearance_audit(PANDA, OBSTACLES, now[None], 0.02)
        if distance >= 0.02:
            assert told["clearance_violations"] == 0
            clear += 1
        elif distance > 0.0 and names[1] in {o.name for o in OBSTACLES}:
            assert told["clearance_lacking_mm"] == pytest.approx(1e3 * (0.02 - distance), abs=1e-3)
            close += 1
    assert clear > 5
    assert close > 2


@pytest.mark.parametrize(("name", "value"), [("ticks", 0), ("far", -1), ("seed", -1)])
def test_options_without_sense_are_refused(name: str, value: int) -> None:
    with pytest.raises(InvalidValueError, match=f"--{name} must be"):
        StreamOptions(**{name: value})  # type: ignore[arg-type]
