"""The comparison: what it lets through and what it flags."""

from math import inf, nan, nextafter

import pytest

from scenarios.reproduce.comparison import Agreement, Compared, compare


def judge(
    kept: float | None, measured: float | None, *, same: bool = False, judged: bool = True
) -> Compared:
    def named(value: float | None) -> dict[str, float]:
        return {} if value is None else {"x": value}

    unjudged = () if judged else ("x",)
    (entry,) = compare(named(kept), named(measured), same_machine=same, unjudged=unjudged)
    assert (entry.name, entry.kept, entry.measured) == ("x", kept, measured)
    return entry


@pytest.mark.parametrize("kept", [1.0, -2.5, 3e-5, 4e6])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_change_of_a_little_more_than_a_percent_is_flagged_and_a_little_less_is_not(
    kept: float, sign: int
) -> None:
    beyond = judge(kept, kept * (1 + sign * 0.011))
    assert beyond.agreement is Agreement.BEYOND
    assert not beyond.agreement.good
    assert beyond.difference == pytest.approx(sign * 0.011 * (1 if kept > 0 else -1))
    within = judge(kept, kept * (1 + sign * 0.009))
    assert within.agreement is Agreement.WITHIN
    assert within.agreement.good


def test_where_the_machine_is_the_same_only_the_same_bits_will_do() -> None:
    assert judge(0.3, 0.3, same=True).agreement is Agreement.IDENTICAL
    changed = judge(0.3, nextafter(0.3, 1.0), same=True).agreement
    assert changed is Agreement.CHANGED
    assert not changed.good
    assert judge(0.3, nextafter(0.3, 1.0)).agreement is Agreement.WITHIN
    assert judge(0.3, 0.3).agreement is Agreement.IDENTICAL
    assert judge(0.3, 0.3 * 1.011, same=True).agreement is Agreement.BEYOND


def test_beside_nothing_only_rounding_is_forgiven() -> None:
    assert judge(0.0, 0.9e-9).agreement is Agreement.WITHIN
    assert judge(0.0, 1.1e-9).agreement is Agreement.BEYOND
    assert judge(0.0, -1.0).agreement is Agreement.BEYOND
    assert judge(0.0, 1.0).difference is None
    assert judge(0.0, 0.0).difference == 0.0
    assert judge(5e-9, 5.9e-9).agreement is Agreement.WITHIN
    assert judge(5e-9, 6.1e-9).agreement is Agreement.BEYOND


@pytest.mark.parametrize("bad", [nan, inf, -inf])
@pytest.mark.parametrize("judged", [True, False])
def test_what_is_no_number_is_never_good(bad: float, judged: bool) -> None:
    for kept, measured in ((1.0, bad), (bad, 1.0), (bad, bad)):
        entry = judge(kept, measured, judged=judged)
        assert entry.agreement is Agreement.NOT_A_NUMBER
        assert not entry.agreement.good
        assert entry.difference is None or entry.difference != 0.0 or kept == measured


@pytest.mark.parametrize("judged", [True, False])
def test_a_figure_on_one_side_only_is_flagged(judged: bool) -> None:
    missing, new = judge(1.0, None, judged=judged), judge(None, 1.0, judged=judged)
    assert (missing.agreement, new.agreement) == (Agreement.MISSING, Agreement.NEW)
    for entry in (missing, new):
        assert not entry.agreement.good
        assert entry.difference is None


def test_what_is_not_judged_may_be_anything() -> None:
    entry = judge(1.0, 50.0, judged=False, same=True)
    assert entry.agreement is Agreement.UNJUDGED
    assert entry.agreement.good
    assert entry.difference == pytest.approx(49.0)


def test_every_name_of_either_side_has_its_line() -> None:
    entries = compare({"a": 1.0, "b": 2.0}, {"c": 3.0, "a": 1.0}, same_machine=True)
    assert [entry.name for entry in entries] == ["c", "a", "b"]
    assert [entry.agreement for entry in entries] == [
        Agreement.NEW,
        Agreement.IDENTICAL,
        Agreement.MISSING,
    ]
