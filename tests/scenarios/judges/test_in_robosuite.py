"""Episodes that robosuite itself runs and judges, where its environment is there."""

from pathlib import Path

import pytest

from scenarios import judge_robosuite
from scenarios.judge_robosuite import JudgeOptions, episodes, served

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not judge_robosuite.JUDGE.exists(), reason="robosuite is not here: make judges"
    ),
]


@pytest.mark.parametrize(
    ("task", "seed"),
    [
        ("NutAssemblySquare", 16),  # lost at the peg when the hand turned faster than air lets it
        ("ToolHang", 1),
        ("TwoArmLift", 1),
        ("TwoArmPegInHole", 13),  # the plate scraped along its arm's pedestal before it was known
    ],
)
def test_a_task_is_done_within_what_the_motors_can(task: str, seed: int, tmp_path: Path) -> None:
    options = JudgeOptions(
        tasks=(task,), episodes=1, seed=seed, noise=False, report=tmp_path / "report.json"
    )
    with served() as address:
        (line,) = episodes(address, task, options, noisy=False)
    assert line["success"], line["cause"]
    assert line["saturated"] < 0.01
    assert line["speed"] < 1.0
