"""The page: both columns, the verdicts, and the one sentence on top."""

import pytest

from scenarios.reproduce.comparison import compare
from scenarios.reproduce.page import comparison_page, outcome, row

HERE = {"processor": "x", "numpy": "2"}


def test_both_columns_stand_beside_difference_and_agreement() -> None:
    (entry,) = compare({"a_s": 0.25}, {"a_s": 0.248}, same_machine=False)
    assert row(entry) == "a_s | 0.25 | 0.248 | -0.8 % | within the bar"
    (entry,) = compare({"a_s": 0.25}, {}, same_machine=False)
    assert row(entry) == "a_s | 0.25 | none | none | NOT MEASURED"
    (entry,) = compare({"a_s": 0.25}, {"a_s": 0.25}, same_machine=False)
    assert row(entry) == "a_s | 0.25 | 0.25 | 0 | identical"


@pytest.mark.parametrize(
    ("measured", "answer"),
    [
        ({"a": 1.0, "b": 2.0, "clock": 9.0}, "Yes: all 2 figures are identical to the bit."),
        ({"a": 1.0, "b": 2.01, "clock": 9.0}, "Yes: 1 of 2 figures are identical, the others"),
        ({"a": 1.0, "b": 2.1, "clock": 9.0}, "No: 1 of 2 figures were not reproduced."),
        ({"a": 1.0, "b": 2.0}, "No: 1 of 3 figures were not reproduced."),
    ],
)
def test_the_outcome_counts_what_is_judged(measured: dict[str, float], answer: str) -> None:
    kept = {"a": 1.0, "b": 2.0, "clock": 5.0}
    compared = compare(kept, measured, same_machine=False, unjudged=["clock"])
    assert outcome(compared).startswith(answer)
    page = comparison_page(compared, HERE, HERE, [])
    assert f"**{outcome(compared)}**" in page


def test_what_is_not_judged_stands_apart_and_notes_come_first() -> None:
    kept = {"a": 1.0, "clock": 5.0}
    compared = compare(kept, {"a": 1.0, "clock": 9.0}, same_machine=True, unjudged=["clock"])
    page = comparison_page(compared, HERE, HERE, ["Run: yesterday."])
    judged, told = page.split("## Told, not judged")
    assert judged.index("Run: yesterday.") < judged.index("| a | 1 | 1 | 0 | identical |")
    assert "| clock |" not in judged
    assert "| clock | 5 | 9 | +80 % | not judged |" in told


def test_what_differs_between_the_machines_is_named() -> None:
    compared = compare({"a": 1.0}, {"a": 1.0}, same_machine=False)
    page = comparison_page(compared, HERE, {"processor": "y", "numpy": "2", "scipy": "1"}, [])
    assert "from elsewhere (another: processor, scipy)" in page
    assert "| processor | x | y |" in page
    assert "| scipy |  | 1 |" in page
    assert "nothing but the same bits" not in page
    assert "nothing but the same bits" in comparison_page(compared, HERE, HERE, [])
