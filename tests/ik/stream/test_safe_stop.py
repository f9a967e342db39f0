"""Safe stops of streams: what is told to be clear is, and the arm brakes where nothing else is."""

import numpy as np
import pytest

from robo47_qp.arrays import Vector
from robo47_qp.collision.clearance import Clearance
from robo47_qp.evaluation.benchmarks.ik.hostile_targets import OBSTACLES, PAIR_OBSTACLES
from robo47_qp.evaluation.benchmarks.ik.hostile_targets import targets as hostile
from robo47_qp.ik.stream.joint_bounds import JointBounds, braked
from robo47_qp.ik.stream.safe_stop import CompiledStop, SafeStop
from robo47_qp.ik.stream.settings import Event
from robo47_qp.ik.stream.stream import StreamIk
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots import load_robot

DT, KEEP = 1e-3, 0.02
each = pytest.mark.parametrize("kind", [SafeStop, CompiledStop])


@pytest.fixture(scope="module")
def among() -> Arm:
    return Arm(load_robot("panda"), obstacles=OBSTACLES)


def made(kind: type[SafeStop], arm: Arm) -> tuple[SafeStop, JointBounds]:
    bounds = JointBounds(arm.q_min, arm.q_max, arm.robot.rated, DT, 1e-6)
    return kind(arm.model, arm.derived(Clearance, KEEP).pairs.kept, bounds, KEEP), bounds


def states(arm: Arm, rng: np.random.Generator, count: int) -> list[tuple[Vector, Vector]]:
    """Configurations that keep their distance, and velocities after which they soon would not."""
    clearance, found = arm.derived(Clearance, KEEP), list[tuple[Vector, Vector]]()
    while len(found) < count:
        q = rng.uniform(0.9 * arm.q_min, 0.9 * arm.q_max)
        v = 0.8 * rng.uniform(-1.0, 1.0, arm.n) * arm.robot.rated.v_max
        if clearance.nearest(q)[0] > KEEP > clearance.nearest(q + 0.08 * v)[0]:
            found.append((q, v))
    return found


def to_rest(q: Vector, v: Vector, a: Vector, *, together: bool) -> list[Vector]:
    """Configurations of a stop, integrated in steps of a tick."""
    way, rate = [q], a if not together else np.abs(v) / (np.abs(v) / a).max()
    while np.abs(v).max() > 0.0:
        slower = np.sign(v) * np.maximum(np.abs(v) - rate * DT, 0.0)
        q, v = q + 0.5 * DT * (v + slower), slower
        way.append(q)
    return way


@each
def test_a_stop_is_clear_where_every_instant_of_it_is(
    among: Arm, rng: np.random.Generator, kind: type[SafeStop]
) -> None:
    stop, bounds = made(kind, among)
    clearance, told = among.derived(Clearance, KEEP), {True: 0, False: 0}
    for q, v in states(among, rng, 16):
        for together in (False, True):
            # The bounds of the state before are far off: everything near is measured.
            clear = stop._is_clear(int(together), q, v)
            way = to_rest(q, v, bounds.a_max, together=together)
            least = min(clearance.nearest(now)[0] for now in [*way[::5], way[-1]])
            # A dip between samples is not seen; MuJoCo's distance is not sure in a crossing.
            assert least > KEEP - 1.5e-3 if clear else least < KEEP + 1.5e-3
            told[clear] += 1
    assert min(told.values()) > 6


def test_what_is_remembered_of_a_way_holds_for_the_next(
    among: Arm, rng: np.random.Generator
) -> None:
    """Along a path that speeds up and brakes; another that remembers nothing judges anew."""
    stop, bounds = made(CompiledStop, among)
    anew, _ = made(CompiledStop, among)
    clear = kept = 0
    for start in states(among, rng, 6):
        q, v = start
        stop.reset(q, v)
        a = bounds.a_max * rng.uniform(-1.0, 1.0, among.n)
        for k in range(80):
            after = v + DT * a if k % 20 < 10 else braked(v, bounds.a_max, DT)
            q, v = bounds.moved(q, v, after), after
            for together in (0, 1):
                told = stop._is_clear(together, q, v)
                if k % 4 == 0:
                    anew._bound[:] = -np.inf
                    assert told <= anew._is_clear(together, q, v)
                    if told:
                        shorter = stop._bound[together] < anew._bound[together] - 1e-9
                        assert (stop._bound[together] <= anew._bound[together] + 1e-3).all()
                        clear, kept = clear + 1, kept + int(shorter.sum())
    assert clear > 20
    assert kept > 1000


def run_into(
    stops: list[SafeStop], bounds: JointBounds, start: Vector, wanted: Vector, ticks: int
) -> list[tuple[Vector, bool]]:
    """From rest towards a velocity; configurations, and whether the arm braked for its stop."""
    q, v, told = start, np.zeros_like(start), list[tuple[Vector, bool]]()
    for stop in stops:
        stop.reset(q, v)
    for _ in range(ticks):
        box = bounds.box(q, v)
        (taken, braking), *others = (
            stop.step(q, v, np.clip(wanted, box.low, box.high), box) for stop in stops
        )
        assert (taken >= box.low).all()
        assert (taken <= box.high).all()
        for other, stop in zip(others, stops[1:], strict=True):
            assert other[1] == braking
            np.testing.assert_allclose(other[0], taken, rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(stop._bound, stops[0]._bound, rtol=0.0, atol=1e-9)
        q, v = bounds.moved(q, v, taken), taken
        told.append((q, braking))
    return told


@pytest.mark.parametrize("name", ["panda", "panda_pair"])
def test_the_core_decides_as_the_reference(name: str) -> None:
    arm = Arm(load_robot(name), obstacles=OBSTACLES if name == "panda" else PAIR_OBSTACLES)
    (one, bounds), (other, _) = (made(kind, arm) for kind in (SafeStop, CompiledStop))
    told = [
        braking
        for q, v in states(arm, np.random.default_rng(3), 4)
        for _, braking in run_into([one, other], bounds, q, v, 60)
    ]
    assert min(told.count(True), told.count(False)) > 20


def test_an_arm_that_could_not_stop_brakes_in_time(among: Arm) -> None:
    """Whatever is asked for from rest, straight into what is near."""
    stop, bounds = made(CompiledStop, among)
    clearance, braking = among.derived(Clearance, KEEP), 0
    for start, wanted in states(among, np.random.default_rng(5), 8):
        told = run_into([stop], bounds, start, wanted, 300)
        assert min(clearance.nearest(q)[0] for q, _ in told[::3]) > KEEP - 3e-4
        braking += any(stopping for _, stopping in told)
    assert braking > 3


def test_from_a_start_without_a_safe_stop_what_is_asked_for_is_done(among: Arm) -> None:
    stop, bounds = made(CompiledStop, among)
    too_near, q, rest = (
        SafeStop(among.model, stop._ends, bounds, 1.0),
        among.home,
        np.zeros(among.n),
    )
    too_near.reset(q, rest)
    box = bounds.box(q, rest)
    v, braking = too_near.step(q, rest, box.high, box)
    assert not braking
    assert (v == box.high).all()


def test_a_stream_counts_its_stops_and_keeps_its_clearance(among: Arm) -> None:
    stream = StreamIk(profile=among.robot.rated, clearance=KEEP).build(among)
    target = hostile(among, np.random.default_rng(2))
    ticks = [stream.tick(next(target)) for _ in range(2700)]
    told = sum(Event.STOPPING in tick.events for tick in ticks)
    assert told == stream.counts[Event.STOPPING] > 0
    assert stream.counts[Event.TOO_CLOSE] == 0


def test_a_reset_forgets_and_a_stop_beyond_the_end_of_a_joint_is_none(among: Arm) -> None:
    stop, _ = made(CompiledStop, among)
    q, v = among.home.copy(), np.zeros(among.n)
    q[0] = among.q_max[0] - 0.05
    # In proportion to the slow second joint the first one would go 0.14 rad.
    v[:2] = 1.0, 2.0
    for together in (0, 1):
        stop._together = together
        assert stop._is_safe(q, v)
        assert stop._together == 0
    fresh, _ = made(CompiledStop, among)
    for one in (stop, fresh):
        one.reset(among.home, np.zeros(among.n))
    assert (stop._bound == fresh._bound).all()
