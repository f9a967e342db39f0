"""Tasks as environments: spaces, rewards at the end, the same worlds as everywhere else."""

import importlib
import os
import sys
from typing import Any

import numpy as np
import pytest

from robo47_qp.errors import (
    InvalidValueError,
    MissingExtraError,
    RenderingError,
    UnknownNameError,
)
from robo47_qp.evaluation.perturbation import PRESETS, Perturbation
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.files import plain
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import tool_down
from robo47_qp.run.failure import Cause
from robo47_qp.run.policy.cell import PolicyCell
from robo47_qp.run.policy.drivers import PolicyTiming, StepwiseDriver
from robo47_qp.run.policy.policy import vector_of
from robo47_qp.run.registry import task_names
from robo47_qp.run.runner import Runner
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from robo47_qp.tasks.reach import reach as judged_reach
from robo47_qp.tasks.reach.obstacle_reach import ObstacleReach
from tests.robots import robot_named
from tests.runs import Reach

gymnasium = pytest.importorskip("gymnasium", reason="the extra gym is not installed")
from gymnasium.utils.env_checker import check_env  # noqa: E402

from robo47_qp.evaluation.gym import register  # noqa: E402
from robo47_qp.evaluation.gym.env import TaskEnv  # noqa: E402
from robo47_qp.evaluation.gym.spaces import (  # noqa: E402
    numbers_of,
    observation_space,
)
from tests.evaluation.gym.environments import (  # noqa: E402
    ARM,
    HOME,
    NAMES,
    TURNED,
    Turn,
    env,
    made_or_skip,
    until_the_end,
)


def test_every_task_is_an_environment() -> None:
    assert {f"robo47/{name}-v0" for name in task_names()} == set(register())
    assert "robo47/pick_place-v0" in NAMES
    assert set(NAMES) < set(register()) <= set(gymnasium.registry)
    assert len(NAMES) == 8


def test_a_task_of_two_arms_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="task must be one that a single tool does"):
        gymnasium.make("robo47/handover-v0")


def test_a_task_that_is_done_before_it_is_begun_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="task must be one whose verdict is no success bef"):
        env(task=Reach())


@pytest.mark.parametrize("name", NAMES)
def test_every_environment_is_as_gymnasium_wants_it(name: str) -> None:
    made = made_or_skip(name)
    check_env(made.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("mode", ["tool", "torques"])
def test_every_kind_of_action_is_as_gymnasium_wants_it(mode: str) -> None:
    made = gymnasium.make("robo47/pick_place-v0", mode=mode)
    check_env(made.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("name", NAMES)
def test_standing_still_is_no_success(name: str) -> None:
    made = made_or_skip(name, timing=PolicyTiming(seconds=0.5))
    made.reset(seed=0)
    still = made.unwrapped.scale.numbers(HOME)
    for _ in range(14):
        _, reward, terminated, truncated, _ = made.step(still)
        assert (reward, terminated, truncated) == (0.0, False, False)
    _, reward, terminated, truncated, info = made.step(still)
    assert (reward, terminated, truncated) == (0.0, False, True)
    assert info["cause"] in {cause.value for cause in Cause}


def test_success_is_rewarded_once_it_lasts() -> None:
    made = env()
    made.reset(seed=0)
    steps, reward, terminated, truncated, info = until_the_end(made, made.scale.numbers(TURNED))
    assert (reward, terminated, truncated) == (1.0, True, False)
    assert info == {
        "success": True,
        "cause": None,
        "evidence": None,
        "measures": {"rise_m": 0.02},
        "audit_ok": True,
        "broken_promises": [],
        "process": "that of the world",
    }
    # 0.1 rad at 10 rad/s³ take about 0.7 s, then 0.3 s of success.
    assert 25 <= steps <= 40
    with pytest.raises(gymnasium.error.ResetNeeded, match="The episode is over: call reset"):
        made.step(made.scale.numbers(HOME))
    made.reset(seed=0)
    made.step(made.scale.numbers(HOME))


def test_success_in_passing_is_none() -> None:
    made = env(seconds=2.0)
    made.reset(seed=0)
    there, back = made.scale.numbers(TURNED), made.scale.numbers(HOME)
    passed, rewards, terminated, truncated = 0, 0.0, False, False
    info: dict[str, Any] = {}
    for _ in range(60):
        assert made._episode is not None
        passed += made._episode.done
        _, reward, terminated, truncated, info = made.step(back if passed else there)
        rewards += reward
    assert passed > 2
    assert (rewards, terminated, truncated, info["success"]) == (0.0, False, True, False)
    assert "joint1 is at 0.00" in info["evidence"]


@pytest.mark.parametrize("instants", [1, 2])
def test_success_at_one_instant_is_none_however_long_a_decision_lasts(
    instants: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At two decisions per second, one of them lasts longer than what success must last."""
    looks: list[bool] = []

    def done(_: StepwiseDriver) -> bool:
        looks.append(True)
        return len(looks) <= instants

    monkeypatch.setattr(StepwiseDriver, "done", property(done))
    made = TaskEnv(Turn(), mode="joints", timing=PolicyTiming(rate=2.0, seconds=2.0))
    made.reset(seed=0)
    ends = [made.step(made.scale.numbers(HOME))[2] for _ in range(2)]
    assert ends == [False, instants == 2]


def test_what_is_right_when_time_is_over_is_rewarded() -> None:
    made = env(seconds=0.8)
    made.reset(seed=0)
    steps, reward, terminated, truncated, info = until_the_end(made, made.scale.numbers(TURNED))
    assert (steps, reward, terminated, truncated) == (24, 1.0, False, True)
    assert info["success"]


def test_what_counts_is_where_it_comes_to_rest() -> None:
    made = env(seconds=0.3)
    made.reset(seed=0)
    far = HOME + np.array([0.5, 0, 0, 0, 0, 0, 0, 0])
    for _ in range(8):
        made.step(made.scale.numbers(far))
    assert made._episode is not None
    assert made._episode.observe().q[0] < 0.08
    seen, reward, _, truncated, _ = made.step(made.scale.numbers(far))
    assert (reward, truncated) == (1.0, True)
    assert seen["q"][0] > 0.09
    assert np.abs(seen["v"]).max() < 1e-3


@pytest.mark.parametrize(
    ("index", "value", "evidence"),
    [
        (2, np.nan, "q of the action must be a vector of 7 finite numbers"),
        (3, 1.1, "q[3] of the action must be from -3.0718 to -0.0698"),
        (7, 1.1, "width of the action must be from 0 to 0.08"),
    ],
)
def test_an_action_that_cannot_be_carried_out_ends_the_episode(
    index: int, value: float, evidence: str
) -> None:
    made = env()
    made.reset(seed=0)
    numbers = made.scale.numbers(HOME)
    numbers[index] = value
    steps, reward, terminated, truncated, info = until_the_end(made, numbers)
    assert (steps, reward, terminated, truncated) == (1, 0.0, True, False)
    assert info["cause"] == "limit"
    assert evidence in info["evidence"]


def test_the_watch_ends_the_episode() -> None:
    made = env(mode="tool", seconds=4.0)
    made.reset(seed=0)
    down = vector_of(tool_down([0.45, 0.0, -0.05]))
    _, reward, terminated, _, info = until_the_end(made, made.scale.numbers([*down, 0.08]))
    assert (reward, terminated) == (0.0, True)
    assert info["cause"] == "collision"


def test_torques_move_the_arm() -> None:
    made = env(mode="torques", seconds=1.0)
    seen, _ = made.reset(seed=0)
    still = np.zeros(7)
    for _ in range(3):
        tau = ARM.inverse_dynamics(seen["q"].astype(float), still, still)
        tau[0] += 5.0
        seen, *_ = made.step(made.scale.numbers([*tau, 0.04]))
    assert seen["q"][0] > 0.01
    assert np.abs(seen["q"][1:] - ARM.home[1:]).max() < 0.05
    assert seen["width"][0] < 0.075


def test_what_was_held_on_the_way_counts_at_the_end_and_is_forgotten_at_the_next_start() -> None:
    made = env(task=judged_reach.Reach(count=1), seconds=10.0)
    joints = ARM.home + np.array([0.3, 0.2, 0.1, 0.2, 0.1, 0.2, 0.3])
    there, home = (made.scale.numbers([*q, 0.08]) for q in (joints, ARM.home))
    for _ in range(2):
        seen, _ = made.reset(seed=0)
        made._simulation.place_marker("pose 1", ARM.pose(joints))
        for _ in range(90):
            seen, *_, terminated, _, _ = made.step(there)
            assert not terminated
        assert seen["markers"][0, 2] == -1.0
        _, reward, terminated, _, info = until_the_end(made, home)
        assert (reward, terminated) == (1.0, True)
        assert info["measures"]["poses_left"] == 0.0


def test_home_without_the_poses_is_no_success() -> None:
    made = env(task=judged_reach.Reach(count=1), seconds=0.5)
    made.reset(seed=0)
    _, reward, _, truncated, info = until_the_end(made, made.scale.numbers(HOME))
    assert (reward, truncated, info["cause"]) == (0.0, True, "place")
    assert "1 of 1 poses are left, pose 1 the first" in info["evidence"]


def test_the_seed_is_that_of_the_world_everywhere() -> None:
    made = gymnasium.make("robo47/pick_place-v0")
    seen, info = made.reset(seed=5)
    task = PickPlace()
    world = Simulation(PANDA, task.build_scene)
    task.reset(world, np.random.default_rng(5))
    assert info["seed"] == 5
    cube, goal = vector_of(world.object_pose("cube")), vector_of(world.marker_pose("goal"))
    np.testing.assert_allclose(seen["objects"], cube[None], atol=1e-6)
    np.testing.assert_allclose(seen["markers"], goal[None], atol=1e-6)
    np.testing.assert_allclose(seen["q"], ARM.home, atol=1e-6)


def test_seeds_that_are_not_given_are_drawn_and_told() -> None:
    made = env(task=PickPlace())
    made.reset(seed=1)
    drawn = [made.reset()[1]["seed"] for _ in range(3)]
    assert len(set(drawn)) == 3
    made.reset(seed=1)
    assert [made.reset()[1]["seed"] for _ in range(3)] == drawn
    first, _ = made.reset(seed=drawn[0])
    other, _ = made.reset(seed=drawn[1])
    assert not np.array_equal(first["objects"], other["objects"])


def test_the_same_seed_and_actions_give_the_same_bits() -> None:
    rng = np.random.default_rng(0)
    made, actions = env(task=PickPlace()), []
    for _ in range(5):
        actions.append(made.scale.numbers(HOME - 0.05 * rng.uniform(0, 1, 8)))
    runs = []
    for _ in range(2):
        made.reset(seed=3)
        runs.append([made.step(action)[0] for action in actions])
    for first, second in zip(*runs, strict=True):
        for name in first:
            np.testing.assert_array_equal(first[name], second[name])


def test_scenes_vary_if_they_are_to() -> None:
    made = env(task=PickPlace(), vary=True)
    heights = []
    for seed in range(3):
        seen, _ = made.reset(seed=seed)
        heights.append(float(seen["objects"][0, 2]))
        task = PickPlace().variant(np.random.default_rng([seed, 2]))
        assert heights[-1] == pytest.approx(0.5 * task.item.height, abs=1e-6)
    assert len(set(heights)) == 3


def test_an_environment_knows_what_a_policy_knows() -> None:
    made = env(task=ObstacleReach())
    seen, info = made.reset(seed=0)
    assert info["sheet"]["obstacles"] == [plain(one) for one in ObstacleReach().obstacles]
    assert len(info["sheet"]["obstacles"]) > 0
    assert {"fingers", "ages", "width", "force"} <= set(seen)
    assert seen["ages"].shape == (len(seen["markers"]),)


@pytest.mark.parametrize("perturbation", ["severe", PRESETS["severe"]])
def test_a_perturbed_world_is_that_of_an_evaluation(perturbation: Any) -> None:
    made = env(task=PickPlace(), vary=True, perturbation=perturbation)
    seen, info = made.reset(seed=4)
    episode = TaskEpisode(robot=PANDA, task=PickPlace(), perturbation=PRESETS["severe"])
    scenario = episode.scenario(4)
    world = episode.simulation(scenario, 4)
    there = PolicyCell(Runner(scenario, world).loop).observe()
    (name,) = there.objects
    np.testing.assert_array_equal(seen["objects"][0], there.objects[name].astype(np.float32))
    assert info["sheet"]["noise"] == world.noise_figures
    moved = float(np.linalg.norm(seen["objects"][0, :3] - world.object_pose(name).translation()))
    assert 1e-4 < moved < 0.05
    again, _ = made.reset(seed=5)
    assert not np.array_equal(seen["objects"], again["objects"])


def test_frames_of_a_camera_that_is_late_have_an_age() -> None:
    made = env(task=PickPlace(), perturbation=Perturbation(camera_latency=0.05))
    seen, _ = made.reset(seed=0)
    for _ in range(10):
        seen, *_ = made.step(made.scale.numbers(HOME))
    assert (seen["ages"] >= 0.05 - 1e-6).all()
    assert (seen["ages"] < 0.15).all()


def test_a_robot_without_a_gripper_has_no_width() -> None:
    robot = robot_named("hinge6")
    made = env(robot=robot)
    seen, _ = made.reset(seed=0)
    assert "width" not in seen
    assert made.action_space.shape == (6,)
    made.step(np.zeros(6, dtype=np.float32))


def test_what_makes_no_sense_is_refused() -> None:
    with pytest.raises(
        InvalidValueError, match="mode must be one of joints, tool, torques; found 'x'"
    ):
        env(mode="x")  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match=r"'gentle'.*none, moderate, severe"):
        env(perturbation="gentle")
    with pytest.raises(InvalidValueError, match="render_mode must be None or 'rgb_array'"):
        env(render_mode="human")
    made = env()
    made.reset(seed=0)
    with pytest.raises(InvalidValueError, match=r"shape of an action must be \(8,\); found \(3,\)"):
        made.step(np.zeros(3, dtype=np.float32))
    two = observation_space(ARM, 2, 0, 3.0)
    assert made._episode is not None
    with pytest.raises(InvalidValueError, match=r"shape of objects must be \(2, 7\) always"):
        numbers_of(made._episode.observe(), two)


def test_before_the_first_reset_there_is_nothing_to_move() -> None:
    with pytest.raises(gymnasium.error.ResetNeeded):
        env().step(np.zeros(8, dtype=np.float32))


def test_without_gymnasium_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    package = "robo47_qp.evaluation.gym"
    for name in (package, f"{package}.env", f"{package}.spaces"):
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    for name in (package, f"{package}.env", f"{package}.spaces"):
        with pytest.raises(MissingExtraError, match=r"needs the package gymnasium.*'\.\[gym\]"):
            importlib.import_module(name)


def test_pictures_show_the_scene() -> None:
    made = env(task=PickPlace(), render_mode="rgb_array")
    made.reset(seed=0)
    try:
        picture = made.render()
    except RenderingError as error:
        if os.environ.get("CI"):
            raise
        pytest.skip(str(error))
    assert picture is not None
    assert picture.shape == (480, 640, 3)
    # The red cube is in it.
    red = (picture[:, :, 0] > 120) & (picture[:, :, 1:].max(axis=2) < 80)
    assert red.sum() > 20
    made.close()
    assert env().render() is None
