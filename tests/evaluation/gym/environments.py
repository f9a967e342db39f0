"""Environments of the tests, and how they are run."""

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from robo47_qp.evaluation.gym import register
from robo47_qp.evaluation.gym.env import TaskEnv
from robo47_qp.evaluation.gym.spaces import Mode
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.policy.drivers import PolicyTiming
from robo47_qp.run.registry import load_task
from robo47_qp.sim.simulation import Simulation
from tests.runs import Reach

NAMES = [name for name in register() if load_task(name[7:-3]).tools_needed == 1]


ARM = Arm(PANDA)


HOME = np.append(ARM.home, 0.08)


TURNED = HOME + np.array([0.1, 0, 0, 0, 0, 0, 0, 0])


@dataclass(frozen=True, kw_only=True)
class Turn(Reach):
    """Turn the first joint a little."""

    def verdict(self, simulation: Simulation) -> Failure | None:
        q = simulation.state().q[0]
        return None if q > 0.09 else Failure(cause=Cause.PLACE, evidence=f"joint1 is at {q:.2f}")


def env(seconds: float = 3.0, mode: Mode = "joints", **more: Any) -> TaskEnv:
    return TaskEnv(
        more.pop("task", Turn()), mode=mode, timing=PolicyTiming(seconds=seconds), **more
    )


def made_or_skip(name: str, **more: Any) -> Any:
    return gymnasium.make(name, **more)


def until_the_end(made: TaskEnv, action: Any) -> tuple[int, float, bool, bool, dict[str, Any]]:
    rewards = 0.0
    for steps in range(1, 1000):
        seen, reward, terminated, truncated, info = made.step(action)
        rewards += reward
        assert made.observation_space.contains(seen)
        if terminated or truncated:
            return steps, rewards, terminated, truncated, info
        assert info == {"success": False}
    raise AssertionError("the episode does not end")
