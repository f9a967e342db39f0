"""The client in robosuite's environment, against a world whose verdict is given."""

import sys
from collections.abc import Iterator
from importlib import import_module
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

CLIENT = "scenarios.judges.suite.client"
GIVEN: dict[str, dict[str, Any]] = {
    "robosuite": {},
    "robosuite.environments.manipulation.wipe": {"DEFAULT_WIPE_CONFIG": {}},
    "robosuite.utils.log_utils": {"ROBOSUITE_DEFAULT_LOGGER": None},
    "openpi_client.websocket_client_policy": {"WebsocketClientPolicy": None},
}
SEEN = {"robot0_joint_pos": np.zeros(7), "robot0_gripper_qpos": np.zeros(2)}


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The module, with names in place of the packages of its own environment."""
    for name, content in GIVEN.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    yield import_module(CLIENT)
    sys.modules.pop(CLIENT)


class World:
    """A world that counts its periods, and whose verdict is that of the last one."""

    def __init__(self, verdicts: list[bool], ends_after: int | None = None) -> None:
        self.verdicts, self.ends_after, self.periods = verdicts, ends_after, 0
        data = SimpleNamespace(ctrl=np.full(7, -6.0), qvel=np.full(7, 0.5), body_xpos=[np.zeros(3)])
        data.body_xquat = [np.array([1.0, 0.0, 0.0, 0.0])]
        model = SimpleNamespace(
            actuator_ctrlrange=np.tile([-12.0, 12.0], (7, 1)), body_name2id=lambda _: 0
        )
        self.sim = SimpleNamespace(data=data, model=model)
        self.robots = [
            SimpleNamespace(
                control=self.control,
                sim=self.sim,
                robot_model=SimpleNamespace(root_body="base"),
                _ref_arm_joint_actuator_indexes=np.arange(7),
                _ref_joint_vel_indexes=np.arange(7),
            )
        ]

    def control(self, action: Any, policy_step: bool) -> None:
        """What robosuite does with an action is not of interest here."""

    def reset(self) -> dict[str, Any]:
        return dict(SEEN)

    def step(self, action: Any) -> tuple[dict[str, Any], float, bool, dict[str, Any]]:
        self.periods += 1
        self.robots[0].control(action)
        return dict(SEEN), 0.0, self.periods == self.ends_after, {}

    def _check_success(self) -> bool:
        return self.verdicts[min(self.periods, len(self.verdicts)) - 1]


class Program:
    """A policy that ends at a decision."""

    def __init__(self, ends_at: int | None, told: str = "") -> None:
        self.ends_at, self.told, self.asked = ends_at, told, 0

    def infer(self, message: dict[str, Any]) -> dict[str, Any]:
        assert bool(message.get("reset")) == (self.asked == 0)
        self.asked += 1
        done = self.ends_at is not None and self.asked >= self.ends_at
        return {"actions": np.zeros(8), "done": done, "told": self.told if done else ""}


@pytest.mark.parametrize(
    ("world", "program", "success", "cause", "seconds"),
    [
        (World([True]), Program(10), True, "", 0.2),
        # The verdict counts half a second after the program's end, and not before.
        (World([True] * 30 + [False]), Program(10), False, "verdict", 0.2),
        (World([False] * 30 + [True]), Program(10), True, "", 0.2),
        # What has never ended has not succeeded, whatever lies where it should.
        (World([True]), Program(None), False, "timeout", 60.0),
        (World([True], ends_after=5), Program(None), False, "robosuite ended the episode", 0.1),
        (World([False]), Program(10, "grasp: it slipped"), False, "grasp: it slipped", 0.2),
    ],
)
def test_an_episode_is_judged_at_its_end(
    client: Any, world: World, program: Program, success: bool, cause: str, seconds: float
) -> None:
    told = client.judged(world, program, "Lift", 3, None)
    assert (told["success"], told["cause"]) == (success, cause)
    assert told["seconds"] == pytest.approx(seconds)
    assert told["ever"] == any(world.verdicts)
    assert told["torque"] == pytest.approx(0.5)
    assert told["speed"] == pytest.approx(0.5 / 2.175)
    assert told["saturated"] == 0.0
    ended = program.ends_at is not None
    assert world.periods == (10 + 24 if ended else round(50 * seconds))


def test_motors_at_their_limit_are_counted(client: Any) -> None:
    world = World([True])
    world.sim.data.ctrl[3] = 12.0
    assert client.judged(world, Program(10), "Lift", 3, None)["saturated"] == 1.0
