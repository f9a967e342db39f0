"""Failures recorded: whether they came out the same."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from robo47_qp.evaluation.episode import (
    Episode,
    EpisodeResult,
    EpisodeSpec,
    errored,
    failed,
    overdue,
)
from robo47_qp.evaluation.evaluate import _print_unsound
from robo47_qp.evaluation.evaluation import Evaluation
from robo47_qp.evaluation.replay import record_failures, replay
from robo47_qp.evaluation.report.report import EvaluationReport
from robo47_qp.run.failure import Cause, Failure
from tests.toy_episodes import SETTINGS, Toy

SPEC = EpisodeSpec(index=0, seed=5)
LATE = overdue(SPEC, 6.0)
SLIPPED = failed(SPEC, Failure(cause=Cause.SLIP, evidence="7 mm", time=1.0))
BUGGY = errored(SPEC, "a bug")
WAITED = failed(SPEC, Failure(cause=Cause.TIMEOUT, evidence="nothing came", time=9.0))


@dataclass(frozen=True)
class Answers:
    """An executor that has known what comes out."""

    result: EpisodeResult
    workers: int = 1

    def run(self, episode: Episode, specs: Sequence[EpisodeSpec]) -> Iterator[EpisodeResult]:
        yield from [self.result for _ in specs]


@pytest.mark.parametrize(
    ("before", "again", "same"),
    [
        (SLIPPED, SLIPPED, True),
        (SLIPPED, WAITED, False),
        (SLIPPED, LATE, None),
        (WAITED, LATE, None),
        (LATE, LATE, True),
        (LATE, SLIPPED, None),
        (LATE, BUGGY, False),
    ],
)
def test_where_one_of_two_runs_is_not_over_in_time_nothing_is_told(
    tmp_path: Path, before: EpisodeResult, again: EpisodeResult, same: bool | None
) -> None:
    replayed = record_failures(Toy(), Answers(again), [before], tmp_path / "eval.rrd")
    assert replayed == {5: same}
    report = EvaluationReport(settings=SETTINGS, results=[before], replayed=replayed)
    assert report.sound is (same is not False)
    evaluation = Evaluation(episode=Toy(), settings=SETTINGS, episodes=1, seed=5)
    alone = replay(evaluation, 5, Answers(again), before, tmp_path / "eval.rrd")
    assert alone == (again, same)
    screen = StringIO()
    _print_unsound(report, tmp_path / "eval.jsonl", Console(file=screen, width=200))
    words = {None: "were not compared: [5]; one of the two runs was ended", False: "differed: [5]"}
    assert words.get(same, "") in screen.getvalue()
    assert (screen.getvalue() == "") is (same is True)
