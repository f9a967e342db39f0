import re
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from robo47_qp.cli import OK
from robo47_qp.control.identification import Identification, Identified
from robo47_qp.errors import InvalidValueError
from robo47_qp.files import read_json
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.disturbance import Disturbance
from scenarios.identify import IdentifyOptions, identified, run
from tests.controlled import LOAD


def found_in(wrong: Disturbance) -> Identified:
    return identified(wrong, np.random.default_rng(2))


def test_a_payload_and_dry_friction_are_found() -> None:
    found = found_in(Disturbance(payload=LOAD, dry_friction=0.5))
    assert found.payload_mass == pytest.approx(LOAD.mass, rel=0.06)
    assert found.payload_com == pytest.approx(LOAD.T_tcp_com.translation(), abs=0.015)
    assert found.friction == pytest.approx([0.5] * 4 + [0.3] * 3, rel=0.15)
    assert found.link_mass == pytest.approx(0.0, abs=0.01)


def test_heavier_links_are_found_under_noise() -> None:
    found = found_in(Disturbance(link_mass_factor=1.05, noise_q=5e-5))
    assert found.link_mass == pytest.approx(0.05, abs=0.01)
    assert found.friction == pytest.approx(0.0, abs=0.1)


def test_of_an_exact_model_there_is_nothing_to_find() -> None:
    found = found_in(Disturbance())
    assert found.link_mass == pytest.approx(0.0, abs=2e-3)
    assert found.payload_mass == pytest.approx(0.0, abs=0.02)
    assert found.deviation < 0.05


def test_what_is_found_is_told_beside_what_the_world_has(tmp_path: Path) -> None:
    out = StringIO()
    options = IdentifyOptions(report=tmp_path / "found.json", payload=0.3, joint_friction=0.4)
    assert run(options, Console(file=out, width=80)) == OK
    told = read_json(options.report, "")
    assert told["world"]["friction_Nm"] == pytest.approx([0.4] * 4 + [0.24] * 3)
    assert told["found"]["friction_Nm"] == pytest.approx(told["world"]["friction_Nm"], rel=0.15)
    assert told["found"]["payload_kg"] == pytest.approx(0.3, rel=0.06)
    assert re.search(r"payload, kg +0\.300 +0\.(29|30)", out.getvalue())


def test_an_arm_that_rests_tells_nothing() -> None:
    arm = Arm(PANDA)
    found, still = Identification(arm), np.zeros(arm.n)
    for _ in range(50):
        found.add(arm.home, still, still, still)
    with pytest.raises(InvalidValueError, match="one that tells the parameters apart"):
        found.solve()
    with pytest.raises(InvalidValueError, match="one that bears none"):
        Identification(arm.with_payload(LOAD))
