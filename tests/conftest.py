"""Fixtures for every test: each robot of the package, its arm, and MuJoCo's own view of it."""

import gc
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

# Before NumPy is loaded: on matrices as small as these, threads of BLAS only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import settings
from hypothesis.internal.conjecture import providers
from hypothesis.internal.constants_ast import Constants

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

# A run in the background ignores Ctrl-C, and the processes that tests start would do so too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Imports and tests make little garbage and much that stays; see `pytest_collection_finish`.
gc.disable()

# The same examples in every run: a failure of the suite is a fact about the code.
settings.register_profile("robo47", deadline=None, derandomize=True, database=None, max_examples=40)
settings.load_profile("robo47")


LONGEST = (
    "test_wipe",
    "test_wiping",
    "test_command",
    "test_broken_off",
    "test_wheel",
    "test_peg_insert",
    "test_feeling_inserter",
    "test_pick_place",
    "test_driven_faults",
    "test_ik_contract",
    "test_constraints",
    "test_carry_tray",
    "test_contact_steps",
    "test_press",
    "test_evaluate",
    "test_compare_ik",
    "test_tasks",
    "test_composition",
    "test_mink",
    "test_compiled",
    "test_audit",
    "test_driven_arm",
    "test_gym_env",
    "test_arm",
    "test_cartesian_impedance",
    "test_detour",
    "test_rerun_log",
    "test_docs",
    "test_video",
    "test_streaming",
    "test_stack",
    "test_sort",
    "test_runner",
    "test_rows",
    "test_conveyor_pick",
    "test_policy_driver",
    "test_composed_motion",
    "test_obstacle_reach",
    "test_output",
    "test_self_collision",
    "test_lin",
    "test_evaluate_several",
    "test_chain",
    "test_perturbation",
    "test_pressing",
    "test_policy_process",
    "test_operational_space",
    "test_collision_ik",
    "test_observer",
    "test_camera",
    "test_plots",
    "test_compare_controllers",
    "test_task_episode",
    "test_gentle_grasp",
    "test_continuous",
    "test_lin_uneven",
    "test_ik_pictures",
    "test_blending",
    "test_reach",
    "test_audit_tool",
    "test_tool_curve",
    "test_objectives",
    "test_clearance",
    "test_follow",
    "test_motion_scenarios",
)
"""Files that take longest come first, so that two workers end together."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Make tests on a robot for those alone whose models are here and that they are meant for."""
    if "robot_name" in metafunc.fixturenames:
        module, test = metafunc.module.__name__.rpartition(".")[2], metafunc.function.__name__
        names = [name for name in MAKERS if is_at_hand(name) and is_meant_for(module, test, name)]
        metafunc.parametrize("robot_name", names, indirect=True, scope="session")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest first."""
    rank = {name: i for i, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path.stem, len(rank)))


def pytest_collection_finish() -> None:
    """Spare the garbage collector the tests themselves: it would walk all of them each time."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What the package keeps between runs goes to a folder of these tests."""
    kept = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        # That of the compiler goes on: to fill it anew takes seconds.
        patch.setenv("ZIG_GLOBAL_CACHE_DIR", str(kept / "zig"))
        yield


@pytest.fixture(scope="session", autouse=True)
def _own_examples() -> Iterator[None]:
    """Draw no numbers from the sources: examples would change with every edit and import."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(providers, "_get_local_constants", Constants)
        yield


@pytest.fixture(scope="session")
def robot_name(request: pytest.FixtureRequest) -> str:
    """See `pytest_generate_tests`; `test_every_robot_is_tested` tells which are left out."""
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
