"""Items: how they are held, what looks alike, and how they lie."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.heading import heading, upright
from robo47_qp.tasks.item import Item, upright_item
from robo47_qp.tasks.table import TABLE_TOP, add_table
from tests.runs import Holder

ANGLES = st.floats(-np.pi, np.pi)
BAR = Item(name="bar", size=(0.03, 0.05, 0.04), mass=0.2)
LONG = Item(name="long", size=(0.03, 0.12, 0.04))
ROD = Item(name="rod", size=(0.04, 0.04, 0.06), round=True)
CUBE = Item(name="cube", size=(0.04, 0.04, 0.04))
WIDTH_MAX = 0.08


def corners(item: Item) -> np.ndarray:
    """Of the box around it (8, 3) [m]."""
    signs = np.array(np.meshgrid(*3 * [[-1, 1]])).reshape(3, -1).T
    found: np.ndarray = 0.5 * signs * np.array(item.size)
    return found


@pytest.mark.parametrize("item", [BAR, LONG, ROD, CUBE], ids=lambda item: item.name)
@given(turn=ANGLES)
@settings(max_examples=10)
def test_the_fingers_close_across_a_side_that_fits(item: Item, turn: float) -> None:
    T_world_item = upright([0.4, 0.1, 0.5 * item.height], turn)
    grasp = item.grasp(T_world_item, WIDTH_MAX)
    closing = grasp.rotation().as_matrix()[:, 1]
    across = T_world_item.rotation().as_matrix().T @ closing
    if not item.round:
        assert np.abs(across).max() == pytest.approx(1.0, abs=1e-9)
    width = item.width(grasp, T_world_item)
    assert width < WIDTH_MAX
    # The extent of its corners along the line on which the fingers close.
    extent = np.ptp(corners(item) @ across) if not item.round else item.size[0]
    assert width == pytest.approx(extent, abs=1e-9)
    assert abs(heading(grasp)) <= np.pi / 2 + 1e-9


@pytest.mark.parametrize("item", [BAR, ROD, CUBE], ids=lambda item: item.name)
def test_the_payload_is_what_mujoco_computes(item: Item) -> None:
    spec = mujoco.MjSpec()
    item.add(spec, (0.0, 0.0, 1.0))
    model = spec.compile()
    payload = item.payload(SE3.identity())
    body = model.body(item.name)
    assert payload.mass == pytest.approx(body.mass[0])
    turned = SO3(body.iquat).as_matrix()
    inertia = turned @ np.diag(body.inertia) @ turned.T
    np.testing.assert_allclose(np.diag(payload.inertia), inertia, atol=1e-12)


@pytest.mark.parametrize("item", [BAR, ROD, CUBE], ids=lambda item: item.name)
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (1, 1, 0)])
@pytest.mark.parametrize("quarters", range(4))
@given(turn=ANGLES)
@settings(max_examples=10)
def test_an_item_that_tipped_over_stands_by_other_names(
    item: Item, axis: tuple[int, int, int], quarters: int, turn: float
) -> None:
    tip = np.array(axis) / np.linalg.norm(axis) * quarters * np.pi / 2
    if axis == (1, 1, 0) and quarters % 2:
        return  # On a corner: no side is down.
    T_world_item = SE3.from_rotation(SO3.from_z_radians(turn) @ SO3.exp(tip))
    found, T_item_standing = upright_item(item, T_world_item)
    T_world_standing = T_world_item @ T_item_standing
    np.testing.assert_allclose(T_world_standing.rotation().as_matrix()[:, 2], [0, 0, 1], atol=1e-9)
    # The same corners in the world: nothing but the names of the axes has changed.
    before = T_world_item.rotation().as_matrix() @ corners(item).T
    after = T_world_standing.rotation().as_matrix() @ corners(found).T
    order = [np.linalg.norm(after.T - corner, axis=1).argmin() for corner in before.T]
    assert sorted(order) == list(range(8))
    np.testing.assert_allclose(after[:, order], before, atol=1e-9)
    assert found.round == (item.round and quarters % 2 == 0)
    assert (found.name, found.mass, found.rgba) == (item.name, item.mass, item.rgba)


def test_an_item_that_stands_is_left_as_it_is() -> None:
    found, T_item_standing = upright_item(BAR, upright([0.1, 0.2, 0.3], 2.0))
    assert found is BAR
    np.testing.assert_array_equal(T_item_standing.wxyz_xyz, SE3.identity().wxyz_xyz)


@pytest.mark.parametrize(
    ("size", "round_", "mass", "message"),
    [
        (
            (0.0, 0.1, 0.1),
            False,
            0.1,
            r"size of 'x' must be three numbers, each above 0 and",
        ),
        ((0.1, 0.1, 0.1), False, np.nan, r"mass of 'x' must be above 0 and finite; found nan"),
        ((0.1, 0.2, 0.1), True, 0.1, r"diameter of 'x' must be one number twice"),
    ],
)
def test_what_is_no_item_is_refused(
    size: tuple[float, float, float], round_: bool, mass: float, message: str
) -> None:
    with pytest.raises(InvalidValueError, match=message):
        Item(name="x", size=size, round=round_, mass=mass)


def test_the_grip_follows_the_data_sheet_between_what_is_gentle_and_what_is_most() -> None:
    item = Item(name="it", size=(0.04, 0.04, 0.04), mass=0.5, friction=(0.3, 0.8))
    # 1.5 times its weight, lifted with 2 m/s², on two fingers of the least friction.
    assert item.grip_force(70.0, 0.0) == pytest.approx(1.5 * 0.5 * 11.81 / 0.6)
    assert item.grip_force(70.0, 5.0) == pytest.approx(1.5 * 0.5 * np.hypot(11.81, 5.0) / 0.6)
    usual = item.grip_force(70.0, 0.0)
    assert replace(item, mass=1.0).grip_force(70.0, 0.0) == pytest.approx(2.0 * usual)
    assert replace(item, friction=(0.6, 0.8), mass=0.1).grip_force(70.0, 0.0) == 10.0
    assert replace(item, mass=2.0).grip_force(30.0, 0.0) == 30.0
    off = replace(item, com=(0.004, 0.003, 0.01))
    assert off.grip_force(70.0, 0.0) == pytest.approx(np.hypot(1.0, 5.0 / 7.0) * usual)
    # What a world has drawn is in no data sheet: the largest friction does not count.
    assert replace(item, friction=(0.3, 0.3)).grip_force(70.0, 0.0) == usual


@pytest.mark.parametrize("item", [BAR, ROD], ids=lambda item: item.name)
def test_a_centre_of_mass_off_the_middle_is_in_the_world_and_in_the_payload(item: Item) -> None:
    item = replace(item, com=(0.004, -0.003, 0.002))
    spec = mujoco.MjSpec()
    item.add(spec, (0.0, 0.0, 1.0))
    body = spec.compile().body(item.name)
    np.testing.assert_allclose(body.ipos, item.com)
    T_tcp_item = upright([0.1, 0.2, 0.3], 0.5)
    payload = item.payload(T_tcp_item)
    np.testing.assert_allclose(
        payload.T_tcp_com.translation(), T_tcp_item.apply(np.array(item.com))
    )
    assert body.mass[0] == payload.mass
    np.testing.assert_allclose(np.sort(payload.inertia), np.sort(body.inertia))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"friction": (0.9, 0.3)}, "the least first"),
        ({"friction": (0.0, 0.3)}, "two numbers, each above 0"),
        ({"com": (0.02, 0.0, 0.0)}, "inside of it"),
    ],
)
def test_frictions_and_centres_of_mass_without_sense_are_refused(
    change: dict[str, tuple[float, ...]], told: str
) -> None:
    with pytest.raises(InvalidValueError, match=told):
        replace(BAR, **change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("size", "across"),
    [((0.06, 0.072, 0.04), 0), ((0.072, 0.06, 0.04), 1), ((0.072, 0.072, 0.04), 2)],
)
def test_of_wide_sides_the_one_with_room_is_taken(size: tuple[float, ...], across: int) -> None:
    item = Item(name="wide", size=(size[0], size[1], size[2]))
    pose = upright([0.4, 0.0, 0.02], 0.0)
    width = item.width(item.grasp(pose, WIDTH_MAX), pose)
    assert width == (size[across] if across < 2 else 0.072)


def test_a_cylinder_with_its_mass_off_the_middle_stands_still() -> None:
    """It rocked, as MuJoCo found other contacts of cylinder and box in every period."""
    com = (0.0044, 0.0048, 0.0017)
    item = Item(name="cylinder", size=(0.025, 0.025, 0.058), round=True, mass=0.33, com=com)

    def build(spec: mujoco.MjSpec) -> None:
        add_table(spec)
        item.add(spec, (0.45, 0.0, TABLE_TOP + 0.5 * item.height))

    simulation = Simulation(PANDA, build)
    simulation.reset()
    Holder(simulation).hold(400)
    before = simulation.object_pose("cylinder")
    speeds: list[float] = []

    def look() -> None:
        speeds.append(float(np.abs(simulation.object_twist("cylinder")).max()))

    Holder(simulation).hold(400, look)
    assert max(speeds) < 1e-4
    assert before.translation()[2] == pytest.approx(TABLE_TOP + 0.5 * item.height, abs=2e-4)
    moved = simulation.object_pose("cylinder").translation() - before.translation()
    assert np.abs(moved).max() < 1e-5
