"""What workers and files say is read as plain data, and believed only where it can be."""

import json
import pickle
from dataclasses import replace
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import pytest

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.episode import EpisodeResult, EpisodeSpec, errored
from robo47_qp.evaluation.journal import Journal, JournalError
from robo47_qp.evaluation.report.report import EvaluationReport, compare
from robo47_qp.evaluation.report.words import rate_line
from robo47_qp.evaluation.workers.worker import READY, Worker
from tests.toy_episodes import SETTINGS

_SEPARATORS = "line\u2028paragraph\u2029next\x85feed\x0cunit\x1freturn\r\nend"


def result(seed: int, *, success: bool = True) -> EpisodeResult:
    return EpisodeResult(index=seed, seed=seed, success=success, cause=None if success else "drop")


def heard(*messages: bytes) -> Any:
    """What the parent makes of what comes through the pipe of a worker that runs seed 5."""
    worker = object.__new__(Worker)
    worker.connection, theirs = Pipe()
    worker.ready, worker.spec = True, EpisodeSpec(index=5, seed=5)
    for message in messages:
        theirs.send_bytes(message)
    try:
        return worker.heard()
    finally:
        theirs.close()
        worker.connection.close()


def message(entry: object) -> bytes:
    return json.dumps({"result": entry}).encode()


class Bomb:
    def __reduce__(self) -> tuple[Any, ...]:
        return exec, ("raise SystemError('code ran in the parent')",)


EXEMPT = {
    **{"signal": "LIN measured (tool), exempt", "unit": "m", "exempt": "it presses"},
    **{"extreme": "nan", "limit": 3e-4, "time": 1.5, "share": 0.25, "least": False},
}


@pytest.mark.parametrize(
    "said",
    [
        pickle.dumps(Bomb()),
        pickle.dumps(result(5)),
        b"",
        b"[" * 100_000,
        b"[]",
        json.dumps({"said": READY}).encode(),
        message(result(4).entry()),
        message({**result(5).entry(), "index": 4}),
        message({**result(5).entry(), "success": "no"}),
        message({"success": True}),
    ],
)
def test_what_is_not_the_result_of_the_episode_is_none(said: bytes) -> None:
    assert heard(said) == "it sent something else than the result of its episode"


def test_the_result_of_the_episode_is_believed_once() -> None:
    assert heard(message(result(5).entry())) == result(5)


@pytest.mark.parametrize(
    ("field", "value"),
    [("success", "no"), ("success", 1), ("metrics", 7), ("seed", True), ("time", "late")],
)
def test_fields_of_another_kind_are_refused(field: str, value: object, tmp_path: Path) -> None:
    entry = {**result(3).entry(), field: value}
    with pytest.raises(TypeError, match=field):
        EpisodeResult.of_entry(entry)
    path = tmp_path / "eval.jsonl"
    Journal(path, SETTINGS, resume=False).close()
    with path.open("a") as file:
        file.write(json.dumps(entry) + "\n")
    with pytest.raises(JournalError, match="is not the journal of an evaluation"):
        Journal.read(path, SETTINGS)


@pytest.mark.parametrize("exempt", [[7], [{}], [{**EXEMPT, "share": "much"}], {}, "none"])
def test_findings_of_another_kind_are_refused(exempt: object) -> None:
    entry = result(3).entry()
    told = EpisodeResult.of_entry({**entry, "exempt": [EXEMPT]})
    assert told.exempt == (EXEMPT,)
    assert json.loads(json.dumps(told.entry(), allow_nan=False)) == {**entry, "exempt": [EXEMPT]}
    with pytest.raises((TypeError, KeyError, ValueError)):
        EpisodeResult.of_entry({**entry, "exempt": exempt})


def test_entries_of_before_have_no_such_findings() -> None:
    entry = result(3).entry()
    del entry["exempt"]
    assert EpisodeResult.of_entry(entry) == result(3)


@pytest.mark.parametrize(
    "content",
    [
        {"settings": [], "entries": [result(1).entry()]},
        {"settings": SETTINGS, "entries": []},
        {"settings": SETTINGS | {"task": 7}, "entries": [result(1).entry()]},
        {"settings": SETTINGS, "entries": [result(1).entry(), result(1).entry()]},
    ],
)
def test_a_report_that_is_none_is_refused(content: dict[str, Any]) -> None:
    with pytest.raises((TypeError, KeyError)):
        EvaluationReport.of_json(content)


def test_errors_are_no_failures() -> None:
    """They say nothing about the policy, neither in its rate nor in comparisons."""
    wrong = errored(EpisodeSpec(index=2, seed=2), "no ompl")
    audited = [replace(result(i), audit_ok=ok) for i, ok in enumerate((True, False, True, None))]
    told = EvaluationReport(settings=SETTINGS, results=audited).headline()
    assert (told["judged"], told["broken_audits"], told["audits_kept"]) == (4, 1, 2)
    report = EvaluationReport(
        settings=SETTINGS, results=[result(0), result(1, success=False), wrong]
    )
    assert (report.episodes, report.judged, report.rate) == (3, 2, 0.5)
    assert rate_line(report).startswith("1 of 2 succeeded, 50.0 %")
    other = EvaluationReport(settings=SETTINGS, results=[result(i) for i in range(3)])
    assert compare(report, other).episodes == 2
    alone = EvaluationReport(settings=SETTINGS, results=[wrong])
    assert (alone.rate, alone.interval) == (0.0, (0.0, 1.0))
    with pytest.raises(InvalidValueError, match="no internal error in them"):
        compare(EvaluationReport(settings=SETTINGS, results=[wrong]), other)


def test_errors_are_run_again(tmp_path: Path) -> None:
    path = tmp_path / "eval.jsonl"
    journal = Journal(path, SETTINGS, resume=False)
    journal.add(result(0))
    journal.add(errored(EpisodeSpec(index=1, seed=1), "no ompl"))
    assert list(journal.judged) == [0]
    journal.add(result(1))
    journal.close()
    assert Journal.read(path, SETTINGS)[1].success


def test_a_journal_is_read_whatever_its_texts_hold(tmp_path: Path) -> None:
    """JSON leaves characters as they are at which `str.splitlines` ends a line."""
    path = tmp_path / "eval.jsonl"
    journal = Journal(path, SETTINGS, resume=False)
    told = [replace(result(seed, success=False), evidence=_SEPARATORS) for seed in range(2)]
    for one in told:
        journal.add(one)
    journal.close()
    assert list(Journal.read(path, SETTINGS).values()) == told
