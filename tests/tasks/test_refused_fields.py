"""Fields that no task can do anything with are refused as a task is made, by name."""

from collections.abc import Callable
from dataclasses import replace
from math import inf, nan
from typing import Any

import pytest

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.tasks.carry_tray.carry_tray import CarryTray
from robo47_qp.tasks.carry_tray.tray import Tray
from robo47_qp.tasks.conveyor_pick.conveyor_pick import ConveyorPick
from robo47_qp.tasks.item import BLUE, RED, Item
from robo47_qp.tasks.peg_insert.peg import Peg
from robo47_qp.tasks.peg_insert.peg_insert import PegInsert
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from robo47_qp.tasks.reach.reach import Reach
from robo47_qp.tasks.sort.bin import Bin
from robo47_qp.tasks.sort.sort import Sort
from robo47_qp.tasks.stack.stack import Stack
from robo47_qp.tasks.wipe.wipe import Wipe

EDGE = (0.04, 0.04, 0.04)


def item(**fields: Any) -> Item:
    return Item(**{"name": "x", "size": EDGE, **fields})


@pytest.mark.parametrize("task", [PickPlace, ConveyorPick, Sort, Stack, Reach, PegInsert])
@pytest.mark.parametrize("force", [nan, 0.0, -1.0, "60"])
def test_a_force_that_nothing_exceeds_is_refused(task: Callable[..., Any], force: Any) -> None:
    with pytest.raises(InvalidValueError, match="force_max must be above 0"):
        task(force_max=force)


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"com": (nan, 0.0, 0.0)}, "com of 'x' must be three finite numbers"),
        ({"com": (0.02, 0.0, 0.0)}, "centre of mass of 'x' must be inside of it"),
        ({"size": (0.04, 0.04)}, "size of 'x' must be three numbers, each above 0"),
        ({"size": ("a", 0.04, 0.04)}, "size of 'x' must be three numbers, each above 0"),
        ({"size": (0.04, inf, 0.04)}, "size of 'x' must be three numbers, each above 0"),
        ({"friction": (0.5,)}, "friction of 'x' must be two numbers, each above 0"),
        ({"friction": (0.9, 0.5)}, "friction of 'x' must be two positive numbers, the least first"),
        ({"mass": 0.0}, "mass of 'x' must be above 0 and finite"),
        ({"name": 5}, "name must be a str; found 5"),
    ],
)
def test_an_item_that_cannot_be_is_refused(fields: dict[str, Any], told: str) -> None:
    with pytest.raises(InvalidValueError, match=told):
        item(**fields)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Tray(mass=-1.0), "mass must be above 0"),
        (lambda: CarryTray(wall=(nan, 0.01, 0.08)), "wall must be three finite numbers"),
        (lambda: CarryTray(wall=(0.5, 0.01, -1.0)), "wall must be a place, and a thickness"),
        (
            lambda: Bin(name="b", centre=(0.4, nan), rgba=RED),
            "centre of 'b' must be two finite numbers",
        ),
        (
            lambda: Bin(name="b", centre=(0.4, 0.3), size=(0.2, 0.0), rgba=RED),
            "size of 'b' must be",
        ),
        (lambda: PickPlace(pick=(nan, 0.2)), "pick must be two finite numbers"),
        (lambda: Stack(cubes=(item(), item())), r"names of items must be each another one; found"),
        (lambda: Sort(items=(item(rgba=RED), item(rgba=BLUE))), "names of items must be each"),
        (lambda: Wipe(force=4.9), "force must be at least 5 N; found 4.9"),
        (lambda: PegInsert(peg=Peg(name="peg", size=(0.05, 0.05, 0.2), round=True)), "as its hole"),
        (lambda: PegInsert(peg=Peg(name="peg", size=(0.02, 0.02, 0.06))), "size of the peg must"),
    ],
)
def test_a_task_that_cannot_be_done_is_refused(make: Callable[[], Any], told: str) -> None:
    with pytest.raises(InvalidValueError, match=told):
        make()


def test_an_item_wider_than_the_gripper_is_refused_with_the_robot() -> None:
    wide = Item(name="slab", size=(0.2, 0.2, 0.04))
    narrow = replace(wide, size=(0.2, 0.07, 0.04))
    for task in (PickPlace(item=wide), ConveyorPick(item=wide)):
        with pytest.raises(InvalidValueError, match="opens at least 201 mm for"):
            task.check_robot(PANDA)
    PickPlace(item=narrow).check_robot(PANDA)
    cubes = tuple(Item(name=name, size=(0.09, 0.09, 0.09)) for name in "ab")
    with pytest.raises(InvalidValueError, match="opens at least 91 mm for stack"):
        Stack(cubes=cubes).check_robot(PANDA)
    with pytest.raises(InvalidValueError, match="opens at least 91 mm for sort"):
        Sort(items=(replace(cubes[0], rgba=RED),)).check_robot(PANDA)
