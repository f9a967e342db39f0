"""Fixtures for every test: each robot of the package, its arm, and MuJoCo's own view of it."""

import importlib
import pkgutil
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import settings

from robo47_qp import robots
from robo47_qp.arm import Arm
from robo47_qp.robot import Robot
from tests.plain_arm import PlainArm

# The same examples in every run: a failure of the suite is a fact about the code.
settings.register_profile("robo47", deadline=None, derandomize=True, database=None, max_examples=40)
settings.load_profile("robo47")


def _discovered() -> Iterator[Robot]:
    for module in pkgutil.iter_modules(robots.__path__, f"{robots.__name__}."):
        members = vars(importlib.import_module(module.name)).values()
        yield from (member for member in members if isinstance(member, Robot))


ROBOTS = list(_discovered())


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What the package keeps between runs goes to a folder of these tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session", params=ROBOTS, ids=lambda robot: robot.name)
def robot(request: pytest.FixtureRequest) -> Robot:
    found: Robot = request.param
    return found


@pytest.fixture(scope="session")
def arm(robot: Robot) -> Arm:
    return Arm(robot)


@pytest.fixture(scope="session")
def plain(robot: Robot) -> PlainArm:
    """The same robot, compiled by MuJoCo without any code of the package."""
    return PlainArm(robot)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240607)
