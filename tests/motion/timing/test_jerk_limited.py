import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.motion.timing.rest_to_rest import rest_to_rest
from robo47_qp.motion.timing.state_to_state import s_curve, to_state
from robo47_qp.motion.trajectory import Trajectory

DT = 1e-3
ONE = np.ones(1)

Bounds = tuple[float, float, float]

bounds = st.tuples(st.floats(0.1, 3.0), st.floats(0.5, 10.0), st.floats(2.0, 200.0))
distances = st.floats(1e-4, 4.0) | st.floats(-4.0, -1e-4)
dts = st.sampled_from([1e-3, 2e-3, 5e-3, 1 / 300])


def move(distance: float, limits: Bounds, dt: float = DT) -> Trajectory:
    v, a, j = limits
    return rest_to_rest(0.0 * ONE, distance * ONE, v * ONE, a * ONE, j * ONE, dt)


def shortest(distance: float, limits: Bounds) -> float:
    """Duration of the time-optimal motion, by the cases of its seven phases."""
    d, (v, a, j) = abs(distance), limits
    a = min(a, np.sqrt(v * j))
    rise = v / a + a / j
    if d >= v * rise:
        return float(d / v + rise)
    if d >= 2 * a**3 / j**2:
        return float(a / j + np.sqrt((a / j) ** 2 + 4 * d / a))
    return float(4 * np.cbrt(d / (2 * j)))


def check_bounds(samples: Trajectory, v: Vector, a: Vector, j: Vector, dt: float) -> None:
    """Differences of the positions alone: mean values over samples, so bounded as well."""
    for order, bound in enumerate((v, a, j), start=1):
        derivative = np.abs(np.diff(samples.q, order, axis=0)) / dt**order
        rounding = 1e-15 * (1.0 + np.abs(samples.q).max()) * 2**order / dt**order
        assert (derivative <= bound * (1 + 1e-6) + rounding).all(), order


@given(distance=distances, limits=bounds, dt=dts)
def test_the_duration_is_the_shortest_possible_rounded_up_to_whole_periods(
    distance: float, limits: Bounds, dt: float
) -> None:
    duration = (len(move(distance, limits, dt).q) - 1) * dt
    best = shortest(distance, limits)
    assert best - 1e-9 <= duration <= best + dt + 1e-9


@given(distance=distances, limits=bounds, dt=dts)
def test_the_position_keeps_all_bounds(distance: float, limits: Bounds, dt: float) -> None:
    samples = move(distance, limits, dt)
    v, a, j = (bound * ONE for bound in limits)
    check_bounds(samples, v, a, j, dt)
    assert (np.abs(samples.v) <= v * (1 + 1e-9)).all()
    assert (np.abs(samples.a) <= a * (1 + 1e-9)).all()


@settings(max_examples=20)
@given(distance=distances, limits=bounds)
def test_velocity_and_acceleration_are_those_of_the_position(
    distance: float, limits: Bounds
) -> None:
    motion = move(distance, limits)
    x, v, a = motion.q, motion.v, motion.a
    j = limits[2]
    # Trapezoids of a piecewise linear acceleration: wrong by j dt³ / 12 where it bends.
    v_integrated = np.cumsum((a[1:] + a[:-1]) * DT / 2, axis=0)
    np.testing.assert_allclose(v[1:], v_integrated, rtol=0.0, atol=20 * j * DT**2)
    x_integrated = np.cumsum((v[1:] + v[:-1]) * DT / 2 - (a[1:] - a[:-1]) * DT**2 / 12, axis=0)
    np.testing.assert_allclose(x[1:], x_integrated, rtol=0.0, atol=20 * j * DT**3)
    assert (np.abs(v[1:] - v[:-1] - (a[1:] + a[:-1]) * DT / 2) <= j * DT**2).all()


@given(distance=distances, limits=bounds, dt=dts)
def test_it_starts_and_ends_at_rest_at_the_asked_places(
    distance: float, limits: Bounds, dt: float
) -> None:
    samples = move(distance, limits, dt)
    assert samples.q[0] == 0.0
    assert samples.q[-1] == distance
    for end in (0, -1):
        assert samples.v[end] == pytest.approx(0.0, abs=1e-12)
        assert samples.a[end] == pytest.approx(0.0, abs=1e-12)
    # It comes to rest, too: the last sample is not a jump to the goal.
    assert abs(samples.q[-2] - distance) <= limits[2] * dt**3
    assert abs(samples.v[-2]) <= 2 * limits[2] * dt**2


@given(distance=distances, limits=bounds)
def test_it_never_turns_back(distance: float, limits: Bounds) -> None:
    samples = move(distance, limits)
    assert (samples.v * np.sign(distance) >= -1e-9).all()
    assert (np.diff(samples.q, axis=0) * np.sign(distance) >= -1e-12).all()


@given(
    start=arrays(np.float64, 7, elements=st.floats(-2.0, 2.0)),
    goal=arrays(np.float64, 7, elements=st.floats(-2.0, 2.0)),
    same=bounds,
)
def test_coordinates_with_equal_bounds_move_in_proportion(
    start: Vector, goal: Vector, same: Bounds
) -> None:
    v, a, j = (np.full(7, bound) for bound in same)
    check_straight(start, goal, v, a, j)


@given(
    start=arrays(np.float64, 3, elements=st.floats(-2.0, 2.0)),
    goal=arrays(np.float64, 3, elements=st.floats(-2.0, 2.0)),
    v=arrays(np.float64, 3, elements=st.floats(0.1, 3.0)),
    a=arrays(np.float64, 3, elements=st.floats(0.5, 10.0)),
    j=arrays(np.float64, 3, elements=st.floats(2.0, 200.0)),
)
def test_coordinates_with_different_bounds_move_in_proportion(
    start: Vector, goal: Vector, v: Vector, a: Vector, j: Vector
) -> None:
    check_straight(start, goal, v, a, j)


def test_the_shortest_of_different_bounds_is_not_always_that_of_one_coordinate() -> None:
    """The one is slow but quick to start, the other sluggish: both bind on the line."""
    v, a, j = np.array([0.5, 5.0]), np.array([50.0, 1.0]), np.array([1e4, 1e4])
    check_straight(np.zeros(2), np.ones(2), v, a, j)


def check_straight(start: Vector, goal: Vector, v: Vector, a: Vector, j: Vector) -> None:
    """On the line from start to goal, within all bounds, as fast as these allow on a line."""
    way = goal - start
    if np.abs(way).max() < 1e-3:
        return
    samples = rest_to_rest(start, goal, v, a, j, DT)
    s = (samples.q - start) @ way / (way @ way)
    assert np.abs(samples.q - start - s[:, None] * way).max() < 1e-9
    assert samples.q[-1].tolist() == goal.tolist()
    check_bounds(samples, v, a, j, DT)
    moving = np.abs(way) > 1e-9
    on_line = [float((bound[moving] / np.abs(way[moving])).min()) for bound in (v, a, j)]
    best = shortest(1.0, (on_line[0], on_line[1], on_line[2]))
    assert best - 1e-6 <= (len(s) - 1) * DT <= best + DT + 1e-6


@pytest.mark.parametrize("n", [1, 7])
def test_no_way_takes_no_time(n: int) -> None:
    here = np.linspace(-1.0, 1.0, n)
    bound = np.ones(n)
    samples = rest_to_rest(here, here, bound, bound, bound, DT)
    assert samples.q.tolist() == [here.tolist()]
    assert samples.v.tolist() == samples.a.tolist() == [[0.0] * n]
    samples.v[:] = 1.0
    assert not samples.a.any()


@pytest.mark.parametrize("way", [1e-11, 1e-13, 1e-16, 1e-20, 1e-100, 1e-300, 5e-324])
@pytest.mark.parametrize("beside", [0.0, 1.0])
def test_a_tiny_way_is_gone_all_the_same(way: float, beside: float) -> None:
    """Rounding makes them: a goal that is the start but for the last bit."""
    goal, one = np.array([way, beside]), np.ones(2)
    samples = rest_to_rest(np.zeros(2), goal, one, one, one, DT)
    assert samples.q[-1].tolist() == goal.tolist()
    assert len(samples.q) <= 2 if beside == 0.0 else len(samples.q) > 1000
    assert (samples.q[:, 0] <= way).all()


def test_one_bit_is_a_way(rng: np.random.Generator) -> None:
    start, one = rng.uniform(-2.0, 2.0, 7), np.ones(7)
    goal = np.nextafter(start, 9.0)
    assert rest_to_rest(start, goal, one, one, one, DT).q[-1].tolist() == goal.tolist()


def test_the_same_motion_is_the_same_bit_by_bit() -> None:
    first, again = (move(1.3, (1.0, 2.0, 10.0)) for _ in range(2))
    kept = [part.tobytes() for part in (first.q, first.v, first.a)]
    move(-0.4, (0.3, 1.0, 3.0))
    for name, before in zip("qva", kept, strict=True):
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes() == before


def test_arguments_are_left_alone_and_samples_are_the_callers() -> None:
    arguments: list[Matrix] = [np.full(2, x) for x in (0.0, 1.0, 1.0, 2.0, 10.0)]
    kept = [argument.copy() for argument in arguments]
    samples = rest_to_rest(*arguments, DT)  # type: ignore[call-arg, arg-type]
    samples.q[:] = samples.v[:] = samples.a[:] = 7.0
    for argument, before in zip(arguments, kept, strict=True):
        assert argument.tolist() == before.tolist()


BAD = {
    "start": (0, "start position must be finite; found", (np.nan, np.inf, -np.inf)),
    "goal": (1, "goal position must be finite; found", (np.nan, np.inf, -np.inf)),
    "velocity": (2, "velocity bound must be positive; found", (np.nan, 0.0, -1.0)),
    "acceleration": (3, "acceleration bound must be positive; found", (np.nan, 0.0, -1.0)),
    "jerk": (4, "jerk bound must be positive; found", (np.nan, 0.0, -1.0)),
}


@pytest.mark.parametrize(("which", "message", "values"), BAD.values(), ids=BAD.keys())
def test_what_is_no_motion_is_refused_and_the_fault_named(
    which: int, message: str, values: tuple[float, ...]
) -> None:
    for value in values:
        arguments = [np.zeros(2), np.ones(2), np.ones(2), np.ones(2), np.ones(2)]
        arguments[which][1] = value
        with pytest.raises(InvalidValueError, match=message):
            rest_to_rest(*arguments, DT)  # type: ignore[call-arg, arg-type]


def test_a_bad_bound_is_refused_also_where_nothing_moves() -> None:
    with pytest.raises(InvalidValueError, match="velocity bound must be positive; found"):
        rest_to_rest(ONE, ONE, -ONE, ONE, ONE, DT)


@pytest.mark.parametrize("dt", [0.0, -1e-3, np.nan, np.inf])
def test_a_period_that_is_none_is_refused(dt: float) -> None:
    with pytest.raises(InvalidValueError, match=r"dt must be positive and finite \[s\]; found"):
        move(1.0, (1.0, 1.0, 1.0), dt)


def test_a_motion_of_years_is_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"motion must be one that Ruckig can plan; found"):
        move(1e12, (1.0, 1.0, 1.0))


@given(st.floats(1e-3, 4.0), bounds, dts)
def test_samples_of_one_coordinate_are_those_of_ruckig_to_the_bit(
    length: float, limits: Bounds, dt: float
) -> None:
    goal = np.array([[length], [0.0], [0.0]])
    v, a, j = np.array(limits)[:, None]
    motion = to_state(np.zeros((3, 1)), goal, v, a, j, dt)
    samples = s_curve(length, np.array(limits), dt)
    assert len(samples) == round(motion.duration / dt) + 1
    there = np.array([motion.at(k * dt) for k in range(len(samples) - 1)])
    np.testing.assert_array_equal(samples[:-1], there.reshape(samples[:-1].shape))
    np.testing.assert_array_equal(samples[-1], goal[:, 0])
