"""Fixtures for every test: each robot of the package, its arm, and MuJoCo's own view of it."""

import gc
import os
import sys
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import settings

from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import Robot
from tests.plain_arm import PlainArm
from tests.robots import (
    MAKERS,
    arm_of,
    is_at_hand,
    is_meant_for,
    plain_arm_of,
    robot_named,
)

# Compiled once, not again by every worker and by every process that a test starts.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# The same examples in every run: a failure of the suite is a fact about the code.
settings.register_profile("robo47", deadline=None, derandomize=True, database=None, max_examples=40)
settings.load_profile("robo47")


LONGEST = (
    "test_wheel",
    "test_wipe",
    "test_command",
    "test_pick_place",
    "test_ik_contract",
    "test_runner",
    "test_tasks",
    "test_motion_scenarios",
    "test_self_collision",
    "test_detour",
    "test_rerun_log",
    "test_obstacle_reach",
    "test_stack",
    "test_peg_insert",
    "test_joint_targets",
    "test_policy_driver",
    "test_sort",
    "test_streaming",
    "test_compare_ik",
)
"""Files that take longest come first, so that two workers end together."""


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out tests on robots that they are not meant for; put the longest first."""
    rank = {name: i for i, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path.stem, len(rank)))
    kept: list[pytest.Item] = []
    left_out: list[pytest.Item] = []
    for item in items:
        name = item.callspec.params.get("robot_name") if hasattr(item, "callspec") else None
        test = getattr(item, "originalname", item.name)
        fits = name is None or is_meant_for(item.path.stem, test, name)
        (kept if fits else left_out).append(item)
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = kept


def pytest_collection_finish() -> None:
    """Spare the garbage collector the tests themselves: it would walk all of them each time."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What the package keeps between runs goes to a folder of these tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session", params=[name for name in MAKERS if is_at_hand(name)])
def robot_name(request: pytest.FixtureRequest) -> str:
    """Robots whose models are missing are left out; `test_every_robot_is_tested` tells."""
    name: str = request.param
    return name


@pytest.fixture(scope="session")
def robot(robot_name: str) -> Robot:
    return robot_named(robot_name)


@pytest.fixture(scope="session")
def arm(robot_name: str) -> Arm:
    return arm_of(robot_name)


@pytest.fixture(scope="session")
def plain(robot_name: str) -> PlainArm:
    """The same robot, compiled by MuJoCo without any code of the package."""
    return plain_arm_of(robot_name)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240607)
