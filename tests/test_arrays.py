from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from robo47_qp.arrays import (
    Checked,
    CheckedOptions,
    Count,
    CountOrZero,
    NotNegative,
    Positive,
    Range,
    Ratio,
    Size,
    Suffix,
    Vector,
    check_once,
    checked_vector,
    frozen_vector,
)
from robo47_qp.errors import InvalidValueError

Check = Callable[[str, ArrayLike, int], Vector]
BOTH = pytest.mark.parametrize("check", [checked_vector, frozen_vector])


@BOTH
@given(numbers=st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=8))
def test_finite_numbers_pass_unchanged(check: Check, numbers: list[float]) -> None:
    for value in (numbers, tuple(numbers), np.array(numbers, dtype=np.float64)):
        vector = check("q", value, len(numbers))
        assert vector.dtype == np.float64
        assert vector.tolist() == numbers


@BOTH
def test_integers_and_single_precision_become_doubles(check: Check) -> None:
    for value in ([1, 2], np.array([1, 2]), np.array([1.0, 2.0], dtype=np.float32)):
        vector = check("q", value, 2)
        assert vector.dtype == np.float64
        assert vector.tolist() == [1.0, 2.0]


@BOTH
def test_the_result_is_a_copy(check: Check) -> None:
    given_array = np.array([1.0, 2.0, 3.0])
    vector = check("q", given_array, 3)
    given_array[:] = 9.0
    assert vector.tolist() == [1.0, 2.0, 3.0]


def test_a_checked_vector_can_be_written_to_and_leaves_its_source_alone() -> None:
    given_array = np.array([1.0, 2.0])
    given_array.setflags(write=False)
    vector = checked_vector("q", given_array, 2)
    vector[0] = 5.0
    assert given_array.tolist() == [1.0, 2.0]


def test_a_frozen_vector_cannot_be_written_to_and_leaves_its_source_writable() -> None:
    given_array = np.array([1.0, 2.0])
    vector = frozen_vector("q", given_array, 2)
    with pytest.raises(ValueError, match="read-only"):
        vector[0] = 5.0
    given_array[0] = 5.0


@BOTH
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, None])
@pytest.mark.parametrize("where", [0, 2])
def test_what_is_not_finite_is_refused(check: Check, bad: float, where: int) -> None:
    value = [0.0, 1.0, 2.0]
    value[where] = bad
    with pytest.raises(InvalidValueError, match=r"^knee must be a vector of 3 finite numbers;"):
        check("knee", value, 3)


@BOTH
def test_the_message_shows_the_numbers_found(check: Check) -> None:
    with pytest.raises(InvalidValueError, match=r"found \[1\.0, nan\]\.$") as caught:
        check("knee", [1.0, np.nan], 2)
    assert caught.value.name == "knee"
    assert caught.value.expected == "a vector of 2 finite numbers"


@BOTH
@pytest.mark.parametrize(
    ("value", "shape"),
    [
        ([1.0, 2.0], r"\(2,\)"),
        ([1.0, 2.0, 3.0, 4.0], r"\(4,\)"),
        ([], r"\(0,\)"),
        (1.0, r"\(\)"),
        ([[1.0, 2.0, 3.0]], r"\(1, 3\)"),
        ([[1.0], [2.0], [3.0]], r"\(3, 1\)"),
    ],
)
def test_a_wrong_shape_is_refused(check: Check, value: ArrayLike, shape: str) -> None:
    with pytest.raises(InvalidValueError, match=rf"3 finite numbers; found shape {shape}\.$"):
        check("q", value, 3)


@BOTH
@pytest.mark.parametrize("value", [["a", "b"], [[1.0], [1.0, 2.0]], object(), [1j, 2.0], "ab"])
def test_what_is_no_number_is_refused(check: Check, value: ArrayLike) -> None:
    with pytest.raises(InvalidValueError, match="q must be a vector of 2 finite numbers; found"):
        check("q", value, 2)


class Mode(Enum):
    SLOW = "slow"
    FAST = "fast"


@dataclass(frozen=True, kw_only=True)
class Part(Checked):
    pass


@dataclass(frozen=True, kw_only=True)
class Settings(Checked):
    mode: Mode = Mode.SLOW
    part: Part | None = None
    parts: Sequence[Part] = ()
    modes: tuple[Mode, ...] = ()
    mass: Positive = 1.0
    gain: NotNegative = 0.0
    pace: Ratio = 1.0
    margin: Annotated[float, Range(at_least=0.0, below=0.5)] = 0.0
    seconds: Annotated[float, Range(above=0.0, infinite=True)] = np.inf
    count: Count = 1
    retries: CountOrZero = 0
    frame: Literal["world", "tool"] = "world"
    clearance: NotNegative | None = None
    force: Annotated[ArrayLike, Size(3), Range(at_least=0.0)] = (0.0, 1.0, 2.0)


@dataclass(frozen=True, kw_only=True)
class Options(CheckedOptions):
    time_limit: Positive = 1.0
    log: Annotated[Path, Suffix(".rrd")] | None = None


@pytest.mark.parametrize(
    ("field", "good", "bad", "expected"),
    [
        ("mode", [Mode.FAST], ["fast", None, Mode], "Mode.SLOW or Mode.FAST"),
        ("part", [None, Part()], [3, Part, "part", Mode.SLOW], "a Part or None"),
        (
            "parts",
            [[Part()], (Part(),) * 2],
            [Part(), (1,), (None,), "a"],
            "a sequence, each a Part",
        ),
        (
            "modes",
            [(Mode.FAST,)],
            [Mode.FAST, ("fast",)],
            "a sequence, each Mode.SLOW or Mode.FAST",
        ),
        ("mass", [1e-9, 3], [0.0, -1.0, np.nan, np.inf, "a", "1", ["1"]], "above 0 and finite"),
        ("gain", [0.0, np.array(2.0)], [-1e-9, np.nan, np.inf, [0.0, 2.0]], "0 or more and finite"),
        ("pace", [1e-9, 1.0], [0.0, 1.0 + 1e-9, np.nan], "above 0 and at most 1"),
        ("margin", [0.0, 0.4], [-1e-9, 0.5, np.nan], "at least 0 and below 0.5"),
        ("seconds", [1.0, np.inf], [0.0, np.nan], "above 0"),
        ("count", [1, np.int64(2)], [0, 1.5, np.nan, None], "a whole number, 1 or more"),
        ("retries", [0], [-1, "0"], "a whole number, 0 or more"),
        ("frame", ["tool"], ["base", None], "'world' or 'tool'"),
        ("clearance", [None, 0.0], [-1.0, np.inf], "0 or more and finite"),
        ("force", [[0.0, 0.0, 3.0]], [[0.0, 0.0, -3.0]], "0 or more and finite"),
        ("force", [], [[0.0, 3.0], [0.0, np.nan, 1.0], None], "a vector of 3 finite numbers"),
    ],
)
def test_a_field_that_breaks_its_rule_is_refused(
    field: str, good: list[Any], bad: list[Any], expected: str
) -> None:
    for value in good:
        Settings(**{field: value})
    for value in bad:
        with pytest.raises(InvalidValueError, match=f"^{field} must be {expected}; found ") as told:
            Settings(**{field: value})
        assert told.value.name == field


def test_a_vector_of_a_stated_size_is_frozen() -> None:
    force = np.ones(3)
    settings = Settings(force=force)
    force[0] = 5.0
    assert settings.force.tolist() == [1.0, 1.0, 1.0]  # type: ignore[union-attr]
    with pytest.raises(ValueError, match="read-only"):
        settings.force[0] = 5.0  # type: ignore[index]


def test_options_are_called_as_they_are_typed() -> None:
    assert Options().log is None
    assert Options(log=Path("a.rrd")).log == Path("a.rrd")
    with pytest.raises(InvalidValueError, match=r"^--time-limit must be above 0 and finite; found"):
        Options(time_limit=0.0)
    with pytest.raises(InvalidValueError, match=r"^--log must be a file that ends with \.rrd;"):
        Options(log=Path("a.png"))


@dataclass(frozen=True)
class _Several:
    some_names: tuple[str, ...] = ()
    count: int = 1


@pytest.mark.parametrize(
    "words",
    [
        ["--some-names", "a", "--some-names", "b"],
        ["--some_names=a", "--count", "2", "--some-names", "b"],
    ],
)
def test_an_option_of_several_values_is_given_once(words: list[str]) -> None:
    with pytest.raises(InvalidValueError, match="--some-names must be given once"):
        check_once(_Several, words)
    check_once(_Several, ["--some-names", "a", "b", "--count", "1", "--count", "2"])
