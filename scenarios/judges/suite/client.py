"""Episodes of robosuite for a policy server: what runs in the judge's own environment.

    .judges/robosuite/bin/python -m scenarios.judges.suite.client ws://127.0.0.1:8000 \
        --task Lift --seed 80000 --episodes 10

Each finished episode is a line of JSON on the standard output. The server is asked 50 times a
second of simulated time, and answers with the goals of robosuite's JOINT_POSITION controller. It
gets poses of bodies, and readings of the robot; nothing that robosuite derives from both.
"""

import argparse
import json
import logging
import sys
import time
import traceback
import warnings
from contextlib import closing
from typing import Any

import numpy as np
import robosuite
from openpi_client.websocket_client_policy import WebsocketClientPolicy
from robosuite.environments.manipulation.wipe import DEFAULT_WIPE_CONFIG
from robosuite.utils.log_utils import ROBOSUITE_DEFAULT_LOGGER

from scenarios.judges.suite.sensing import NOISE, Noise, measured

RATE = 50
"""Decisions per second [1/s]."""
KP = 150.0
"""Gain of robosuite's controller, in which the joints' inertias are decoupled [1/s²]."""
SECONDS = 60.0
"""Longest simulated time of an episode [s]."""
VERDICT = 0.5
"""Time after the program's end at which the verdict counts [s]."""
RATED = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
"""Rated speeds of the Panda's joints [rad/s] (Franka Robotics, robot and interface limits)."""


def controller() -> dict[str, Any]:
    """The part controllers: joint positions for the arms, and the grippers' own."""
    arm = {
        "type": "JOINT_POSITION",
        "input_type": "absolute",
        "input_max": 1,
        "input_min": -1,
        "output_max": 1,
        "output_min": -1,
        "kp": KP,
        "damping_ratio": 1,
        "impedance_mode": "fixed",
        "kp_limits": [0, 1000],
        "damping_ratio_limits": [0, 10],
        "qpos_limits": None,
        "interpolation": None,
        "gripper": {"type": "GRIP"},
    }
    return {"type": "BASIC", "body_parts": {"right": arm}}


def world(task: str, seed: int) -> Any:
    """Robosuite's environment."""
    more: dict[str, Any] = {}
    if task == "Wipe":
        # The positions of all markers, in place of a summary; a collision does not end it.
        more["task_config"] = DEFAULT_WIPE_CONFIG | {"use_condensed_obj_obs": False}
    two = task.startswith("TwoArm")
    if two:
        more["env_configuration"] = "opposed"
    return robosuite.make(
        task,
        robots=["Panda", "Panda"] if two else "Panda",
        controller_configs=controller(),
        has_renderer=False,
        has_offscreen_renderer=False,
        use_camera_obs=False,
        control_freq=RATE,
        hard_reset=False,
        horizon=10**9,
        seed=seed,
        **more,
    )


def setup(env: Any, task: str) -> dict[str, Any]:
    """What holds during an episode: the task, the robots' bases, and the controller's gains."""
    bases = []
    for robot in env.robots:
        body = env.sim.model.body_name2id(robot.robot_model.root_body)
        bases.append(np.concatenate([env.sim.data.body_xpos[body], env.sim.data.body_xquat[body]]))
    return {"task": task, "bases": np.array(bases), "rate": RATE, "kp": KP}


def episode(policy: Any, task: str, seed: int, noise: Noise | None) -> dict[str, Any]:
    """One episode, and how it went."""
    # Robosuite's world is not freed with its last name: 100 of them take 8 GB.
    with closing(world(task, seed)) as env:
        return judged(env, policy, task, seed, noise)


def judged(env: Any, policy: Any, task: str, seed: int, noise: Noise | None) -> dict[str, Any]:
    """One episode in robosuite's environment, and how it went."""
    started = time.perf_counter()
    seen = env.reset()
    message = {"reset": True, **setup(env, task), **measured(seen, noise)}
    loads = [Load(robot) for robot in env.robots]
    ever, left, told, periods = False, round(VERDICT * RATE), "", 0
    done_at = None
    while periods < SECONDS * RATE and left:
        answer = policy.infer(message)
        seen, _, ended, _ = env.step(np.asarray(answer["actions"], float))
        periods += 1
        message = measured(seen, noise)
        ever = ever or bool(env._check_success())
        if answer["done"] and done_at is None:
            done_at, told = periods / RATE, str(answer["told"])
        left -= done_at is not None
        if ended:
            told = told or "robosuite ended the episode"
            break
    success = done_at is not None and bool(env._check_success())
    return {
        "task": task,
        "seed": seed,
        "noisy": noise is not None,
        "success": success,
        "ever": ever,
        "cause": "" if success else told or ("timeout" if done_at is None else "verdict"),
        "seconds": done_at if done_at is not None else periods / RATE,
        "speed": max(load.speed for load in loads),
        "torque": max(load.torque for load in loads),
        "saturated": max(load.saturated / load.steps for load in loads),
        "wall": time.perf_counter() - started,
    }


class Load:
    """The largest shares of rated speeds and motors' torques, from every simulated step."""

    def __init__(self, robot: Any) -> None:
        self.speed = self.torque = 0.0
        self.steps = self.saturated = 0
        control, data = robot.control, robot.sim.data
        motors, joints = robot._ref_arm_joint_actuator_indexes, robot._ref_joint_vel_indexes
        high = robot.sim.model.actuator_ctrlrange[motors, 1]

        def watched(action: np.ndarray, policy_step: bool = False) -> None:
            control(action, policy_step=policy_step)
            share = ratio(data.ctrl[motors], high)
            self.torque = max(self.torque, share)
            self.steps += 1
            self.saturated += share >= 1.0
            self.speed = max(self.speed, ratio(data.qvel[joints], RATED))

        robot.control = watched


def ratio(values: np.ndarray, limits: np.ndarray) -> float:
    """The largest share of a limit."""
    return float(np.max(np.abs(values) / limits))


def main() -> int:
    """Run the episodes; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("address", help="of the policy server: ws://host:port")
    parser.add_argument("--task", required=True)
    parser.add_argument("--seed", type=int, required=True, help="of the first episode")
    parser.add_argument("--episodes", type=int, default=1)
    parser.add_argument("--noise", action="store_true", help="2 mm and 2 degrees on all poses")
    options = parser.parse_args()
    ROBOSUITE_DEFAULT_LOGGER.setLevel(logging.ERROR)
    warnings.simplefilter("ignore")
    policy = None
    for seed in range(options.seed, options.seed + options.episodes):
        noise = Noise(seed, NOISE) if options.noise else None
        try:
            # One connection for all: this client has no way to close one.
            policy = policy or WebsocketClientPolicy(options.address)
            line = episode(policy, options.task, seed, noise)
        except (RuntimeError, ValueError, OSError) as error:
            traceback.print_exc()
            policy = None
            line = {
                "task": options.task,
                "seed": seed,
                "noisy": options.noise,
                "success": False,
                "error": str(error),
            }
        print(json.dumps(line), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
