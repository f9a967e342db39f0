"""Late signals, measured from outside: by cross-correlation, and sample by sample."""

import numpy as np
import pytest
from numpy.typing import NDArray

from robo47_qp.arrays import Span
from robo47_qp.sim.delay import Delay, Draws, moments

MS = 1e-3


def delayed(span: Span, signal: NDArray[np.float64], seed: int = 1) -> NDArray[np.float64]:
    delay = Delay(span)
    delay.start(signal[:1], np.random.default_rng(seed))
    return np.array([delay.sample(signal[k : k + 1]) for k in range(len(signal))])[:, 0]


def lag(sent: NDArray[np.float64], came: NDArray[np.float64]) -> float:
    """Delay of one signal against another [periods], by the slope of their cross-spectrum."""
    spectrum = np.fft.rfft(came) * np.conj(np.fft.rfft(sent))
    low = slice(1, len(sent) // 40)
    frequency = 2 * np.pi * np.fft.rfftfreq(len(sent))[low]
    phase, weight = np.unwrap(np.angle(spectrum[low])), np.abs(spectrum[low])
    return float(-(weight * phase * frequency).sum() / (weight * frequency**2).sum())


@pytest.mark.parametrize("late", [0.0, 0.4, 1.0, 2.5, 7.0])
def test_a_signal_comes_so_much_later(late: float) -> None:
    rng = np.random.default_rng(0)
    smooth = np.convolve(rng.standard_normal(4000), np.hanning(60), "same")
    assert lag(smooth, delayed(late * MS, smooth)) == pytest.approx(late, abs=0.01)


@pytest.mark.parametrize("late", [0, 1, 3])
def test_whole_periods_are_a_shift_to_the_bit(late: int) -> None:
    sent = np.random.default_rng(0).standard_normal(50)
    came = delayed(late * MS, sent)
    assert came[late:].tolist() == sent[: 50 - late].tolist()
    assert came[:late].tolist() == [sent[0]] * late


def test_a_command_within_a_period_acts_for_the_rest_of_it() -> None:
    """The momentum of an impulse is delivered whole, in two parts."""
    sent = np.zeros(20)
    sent[5] = 1.0
    came = delayed(2.25 * MS, sent)
    assert came[7:9] == pytest.approx([0.75, 0.25])
    assert came.sum() == pytest.approx(1.0)


def test_a_delay_that_varies_fills_its_range_and_never_goes_back() -> None:
    ramp = np.arange(5000.0)
    late = ramp - delayed((1.0 * MS, 4.0 * MS), ramp)
    assert late[10:].min() == pytest.approx(1.0, abs=0.02)
    assert 3.5 < late.max() <= 4.0
    assert np.diff(ramp - late)[10:].min() >= -1e-9
    assert late.std() > 0.4
    assert np.array_equal(late, ramp - delayed((1.0 * MS, 4.0 * MS), ramp))
    assert not np.array_equal(late, ramp - delayed((1.0 * MS, 4.0 * MS), ramp, seed=2))
    short = ramp - delayed((0.5 * MS, 1.0 * MS), ramp)
    assert short[10:].mean() == pytest.approx(0.75, abs=0.01)
    assert short[10:].std() == pytest.approx(0.5 / np.sqrt(12), rel=0.05)


@pytest.mark.parametrize(
    "span", [(0.0, 1.0), (0.5, 1.0), (1.0, 2.0), (0.0, 1.5), (1.0, 4.0), (1.0, 10.0), (0.3, 6.1)]
)
def test_mean_and_deviation_are_those_of_what_arrives(span: tuple[float, float]) -> None:
    """A range wider than a period is not filled evenly: what has arrived stays the newest."""
    low, high = (MS * end for end in span)
    ramp = np.arange(40_000.0)
    late = (ramp - delayed((low, high), ramp))[50:]
    mean, deviation = moments((low, high))
    assert late.mean() == pytest.approx(mean / MS, abs=0.05)
    assert late.std() == pytest.approx(deviation / MS, rel=0.03)


def test_a_range_within_a_period_is_filled_evenly_and_a_delay_that_stays_has_no_range() -> None:
    assert moments((1.0 * MS, 1.8 * MS)) == pytest.approx((1.4 * MS, 0.8 * MS / np.sqrt(12)))
    assert moments(2.5 * MS) == (2.5 * MS, 0.0)
    assert moments((1.0 * MS, 10.0 * MS))[0] == pytest.approx(3.93 * MS, abs=0.01 * MS)


def test_numbers_that_are_drawn_ahead_are_those_of_the_generator() -> None:
    drawn, rng = Draws(3, np.random.default_rng(1).standard_normal), np.random.default_rng(1)
    for k in range(2000):
        if k % 7 == 0:
            drawn.prepare()
        assert drawn.next().tolist() == rng.standard_normal(3).tolist()
