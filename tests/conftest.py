"""Fixtures for every test: each robot of the package, its arm, and MuJoCo's own view of it."""

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import settings

from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import Robot
from tests.plain_arm import PlainArm
from tests.robots import MAKERS, is_meant_for, robot_or_skip

# The same examples in every run: a failure of the suite is a fact about the code.
settings.register_profile("robo47", deadline=None, derandomize=True, database=None, max_examples=40)
settings.load_profile("robo47")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out tests on robots that they are not meant for."""
    kept: list[pytest.Item] = []
    left_out: list[pytest.Item] = []
    for item in items:
        name = item.callspec.params.get("robot") if hasattr(item, "callspec") else None
        test = getattr(item, "originalname", item.name)
        fits = name is None or is_meant_for(item.path.stem, test, name)
        (kept if fits else left_out).append(item)
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = kept


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What the package keeps between runs goes to a folder of these tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session", params=list(MAKERS))
def robot(request: pytest.FixtureRequest) -> Robot:
    return robot_or_skip(request.param)


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
