"""What stands close at home, what a check is given, and how far it sees."""

from functools import partial

import mujoco
import numpy as np
import pytest

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.collision_check import Collisions
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from tests.motion.test_collisions import ARM, DT, Oracle


def bar_and_knob(spec: mujoco.MjSpec, *, knob: bool = True) -> None:
    """A bar across the way of the hand as joint 1 turns, and a knob beside the hand at home."""
    x, _, z = ARM.pose(ARM.home).translation()
    box = mujoco.mjtGeom.mjGEOM_BOX
    spec.worldbody.add_geom(name="bar", type=box, pos=[x, 0.2, z + 0.06], size=[0.3, 0.004, 0.004])
    if knob:
        spec.worldbody.add_geom(
            name="knob", type=box, pos=[x + 0.043, 0, z + 0.08], size=[0.01, 0.01, 0.004]
        )


def test_what_is_close_at_home_hides_nothing_else() -> None:
    goal = ARM.home.copy()
    goal[0] = 1.3
    motion = plan_ptp(ARM.home, goal, PANDA.profile, DT)
    alone = Collisions(PANDA, partial(bar_and_knob, knob=False)).first_hit(motion.q, DT)
    assert alone is not None
    assert "bar and hand" in alone.explanation
    both = Collisions(PANDA, bar_and_knob)
    at_home = both.first_hit(motion.q, DT)
    assert at_home is not None
    assert "knob and hand" in at_home.explanation
    assert at_home.rejection.time == 0.0
    left = Collisions(PANDA, bar_and_knob, touched_at_home=True)
    assert left.at(ARM.home) is None
    hit = left.first_hit(motion.q, DT)
    assert hit is not None
    assert "bar and hand" in hit.explanation


def test_what_the_hand_holds_belongs_to_the_robot() -> None:
    """A rod that reaches back to the forearm at home; bars are kept clear of all the same."""
    box = mujoco.mjtGeom.mjGEOM_BOX

    def held(spec: mujoco.MjSpec) -> None:
        bar_and_knob(spec, knob=False)
        hand = spec.body("hand")
        assert hand is not None
        hand.add_geom(name="held", type=box, pos=[0, 0, -0.15], size=[0.05, 0.05, 0.3])

    goal = ARM.home.copy()
    goal[0] = 1.3
    collisions = Collisions(PANDA, held)
    assert collisions.at(ARM.home) is None
    hit = collisions.first_hit(plan_ptp(ARM.home, goal, PANDA.profile, DT).q, DT)
    assert hit is not None
    assert "bar and hand" in hit.explanation


def test_what_it_is_given_is_checked() -> None:
    for clearance in (-1e-3, np.nan, np.inf, [0.005]):
        with pytest.raises(InvalidValueError, match="clearance"):
            Collisions(PANDA, lambda _: None, clearance)  # type: ignore[arg-type]
    collisions = Collisions(PANDA, lambda _: None)
    way = np.tile(ARM.home, (3, 1))
    bad = way.copy()
    bad[1, 2] = np.nan
    for q, told in (
        (bad, "q must be finite numbers"),
        (way[:0], "of one row at least"),
        (way[:, :5], r"q must be of shape \(any, 7\)"),
        (ARM.home, r"q must be of shape \(any, 7\)"),
    ):
        with pytest.raises(InvalidValueError, match=told):
            collisions.first_hit(q, DT)
    with pytest.raises(InvalidValueError, match="q must be finite numbers"):
        collisions.at(bad[1])


def test_a_clearance_beyond_what_is_usually_seen_is_kept() -> None:
    """Twice as much is seen."""
    x, _, z = ARM.pose(ARM.home).translation()

    def ball_below(spec: mujoco.MjSpec) -> None:
        sphere = mujoco.mjtGeom.mjGEOM_SPHERE
        spec.worldbody.add_geom(name="far", type=sphere, pos=[x, 0, z - 0.6], size=[0.1, 0, 0])

    oracle = Oracle(ball_below)
    oracle.place(ARM.home)
    far = oracle.model.geom("far").id
    apart = min(
        distance
        for pair, distance in zip(oracle.pairs, oracle.all(ARM.home), strict=True)
        if far in pair
    )
    for clearance, free in ((apart - 0.01, True), (apart + 0.01, False)):
        found = Collisions(PANDA, ball_below, clearance)
        hit = found.first_hit(np.tile(ARM.home, (2, 1)), DT)
        mine = hit is not None and "far" in hit.explanation
        assert mine is not free
