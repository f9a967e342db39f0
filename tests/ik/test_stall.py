import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk


@pytest.mark.parametrize("steps", [1, 3, 5])
def test_nothing_is_stuck_before_there_is_something_to_compare_with(steps: int) -> None:
    stall = Stall(steps=steps, fall=0.5)
    for count in range(steps + 1):
        assert not stall.stuck([1.0] * count)
    assert stall.stuck([1.0] * (steps + 1))


@pytest.mark.parametrize("steps", [1, 2, 4])
@pytest.mark.parametrize("fall", [0.19, 0.5, 0.9])
def test_the_last_error_is_compared_with_the_one_so_many_steps_before(
    steps: int, fall: float
) -> None:
    stall = Stall(steps=steps, fall=fall)
    # What lies before and between does not matter.
    for before, between in (([], 7.0), ([1e-6, 1e-9], 1e-9), ([100.0], 2.0)):
        history = [*before, 2.0, *[between] * (steps - 1)]
        assert stall.stuck([*history, 2.0 * (1.0 - fall) + 1e-9])
        assert not stall.stuck([*history, 2.0 * (1.0 - fall) - 1e-9])


def test_a_fall_of_just_that_share_is_enough() -> None:
    assert not Stall(steps=1, fall=0.5).stuck([1.0, 0.5])
    assert not Stall(steps=2, fall=0.25).stuck([4.0, 9.0, 3.0])


@given(st.lists(st.floats(1e-12, 10.0), max_size=12), st.integers(1, 5), st.floats(0.01, 0.99))
def test_a_rise_is_stuck_and_an_end_is_not(history: list[float], steps: int, fall: float) -> None:
    stall = Stall(steps=steps, fall=fall)
    if len(history) >= steps:
        assert stall.stuck([*history, 1.01 * history[-steps]])
        assert not stall.stuck([*history, 0.0])


def test_by_default_a_fall_of_a_fifth_in_three_steps_is_asked_for() -> None:
    assert (Stall().steps, Stall().fall) == (3, 0.19)
    assert not Stall().stuck([1.0, 1.0, 1.0, 0.80])
    assert Stall().stuck([1.0, 1.0, 1.0, 0.82])


@pytest.mark.parametrize("steps", [0, -1])
def test_there_must_be_a_step(steps: int) -> None:
    with pytest.raises(InvalidValueError, match=r"stall steps must be a whole number, 1 or more;"):
        Stall(steps=steps)


@pytest.mark.parametrize("fall", [0.0, 1.0, -0.1, 1.5, float("nan"), float("inf")])
def test_the_fall_is_a_share(fall: float) -> None:
    with pytest.raises(
        InvalidValueError, match=rf"stall fall must be above 0 and below 1; found {fall}"
    ):
        Stall(fall=fall)


def test_a_patient_search_has_more_steps_never_fewer() -> None:
    assert LmIk(max_iterations=20, stall=Stall()).thorough().max_iterations == 100
    assert LmIk(max_iterations=300, stall=Stall()).thorough().max_iterations == 300
