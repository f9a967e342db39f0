"""Bins: what is inside, and which slot is free."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from robo47_qp.errors import InvalidValueError
from robo47_qp.tasks.sort.bin import Bin

BIN = Bin(name="bin", centre=(0.4, 0.3), rgba=(1.0, 0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("where", "inside"),
    [
        ((0.4, 0.3, 0.02), True),
        ((0.4 - 0.104, 0.3 + 0.074, 0.039), True),
        ((0.4 - 0.106, 0.3, 0.02), False),
        ((0.4 + 0.106, 0.3, 0.02), False),
        ((0.4, 0.3 - 0.076, 0.02), False),
        ((0.4, 0.3 + 0.076, 0.02), False),
        ((0.4, 0.3, 0.041), False),
    ],
)
def test_inside_is_between_the_walls_and_below_the_rim(
    where: tuple[float, float, float], inside: bool
) -> None:
    assert BIN.holds(np.array(where)) is inside


def test_slots_lie_inside_with_room_on_both_sides() -> None:
    slots = np.array(BIN.slots)
    assert slots.shape == (3, 2)
    np.testing.assert_allclose(slots.mean(axis=0), BIN.centre)
    np.testing.assert_allclose(np.diff(slots[:, 0]), BIN.pitch)
    assert np.abs(slots[:, 0] - 0.4).max() + 0.5 * BIN.pitch <= 0.5 * BIN.size[0]


def test_a_free_slot_is_taken_before_others() -> None:
    one, two, three = BIN.slots
    assert BIN.free_slot([]) == one
    assert BIN.free_slot([one]) in (two, three)
    assert BIN.free_slot([one, (three[0] + 0.01, three[1])]) == two
    assert BIN.free_slot([two, three, (0.0, 0.0)]) == one
    # With something in each, the one with most room.
    assert BIN.free_slot([one, two, (three[0] + 0.02, three[1])]) == three


def test_balls_stay_between_its_walls() -> None:
    """The walls have no gaps: what rolls in any direction stays inside."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2, 2, 0.1])
    BIN.add(spec)
    for i in range(8):
        ball = spec.worldbody.add_body(name=f"ball{i}", pos=[0.4, 0.3, 0.01])
        ball.add_freejoint()
        ball.add_geom(size=[0.01, 0, 0], mass=0.01, contype=2, conaffinity=1)
    spec.option.timestep = 2e-3
    model = spec.compile()
    data = mujoco.MjData(model)
    for i in range(8):
        turn = 2 * np.pi * i / 8 + 0.1
        data.joint(model.body(f"ball{i}").jntadr[0]).qvel[:2] = [np.cos(turn), np.sin(turn)]
    farthest = np.zeros(2)
    for _ in range(1000):
        mujoco.mj_step(model, data)
        for i in range(8):
            position = data.body(f"ball{i}").xpos
            assert BIN.holds(position)
            farthest = np.maximum(farthest, np.abs(position[:2] - BIN.centre))
    # They have been at all four walls, into which they sink a little.
    np.testing.assert_allclose(farthest, np.array(BIN.size) / 2 - 0.01, atol=6e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": (0.0, 0.1)}, r"size of 'bin' must be two numbers, each above 0 and"),
        ({"height": -1.0}, r"height of 'bin' must be above 0"),
        ({"pitch": np.nan}, r"pitch of 'bin' must be above 0"),
        ({"pitch": 0.3}, r"pitch of 'bin' must be at most its length; found 0.3"),
    ],
)
def test_impossible_bins_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        replace(BIN, **change)  # type: ignore[arg-type]
