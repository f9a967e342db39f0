"""What tests of runs share."""

import pytest

from robo47_qp.run.scenario import Run
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.run.witnesses import Eyewitness, Keeper
from tests.runs import Witness, carry_out


@pytest.fixture(scope="module")
def witnessed() -> tuple[Run, Witness, Eyewitness, Keeper]:
    witness, eyes, keeper = Witness(), Eyewitness(), Keeper()
    run = carry_out(PickPlace(), sinks=[keeper], observers=[witness, eyes])
    return run, witness, eyes, keeper
