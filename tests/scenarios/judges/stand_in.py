"""A stand-in for robosuite: a Panda that moves as told, and things that it can hold."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.model.arm import Arm
from scenarios.judges.suite.cell import FINGERTIPS, HOME, panda
from scenarios.judges.suite.programs import Programs

RATE, KP = 50.0, 150.0
BASE = np.array([-0.56, 0.0, 0.912, 1.0, 0.0, 0.0, 0.0])
"""Where the robot stands: position and quaternion."""


@dataclass(eq=False)
class Thing:
    """A thing that is seen, and may be held."""

    name: str
    pose: SE3
    size: float
    """Its width between the fingers [m]."""
    spot: Vector = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    """Where the fingers must close to hold it; nowhere at first [m]."""
    held: SE3 | None = None
    """T_grip_thing while it is held."""


class StandIn:
    """A Panda as robosuite's controller moves it without errors, and things to hold."""

    def __init__(self, task: str, things: Sequence[Thing]) -> None:
        self.arm, self.policy = Arm(panda()), Programs()
        self.q, self.v, self.width = HOME.copy(), np.zeros(7), 0.08
        self.things, self.stuck = list(things), False
        self.setup = {"task": task, "bases": BASE[None], "rate": RATE, "kp": KP, "reset": True}

    @property
    def tool(self) -> SE3:
        base = SE3.from_rotation_and_translation(SO3(BASE[3:].copy()), BASE[:3])
        beyond = 0.1065 + FINGERTIPS - 0.107 - 0.1034
        return base @ self.arm.pose(self.q) @ SE3.from_translation(np.array([0.0, 0.0, beyond]))

    def observation(self) -> dict[str, Any]:
        found: dict[str, Any] = {
            "robot0_joint_pos": self.q,
            "robot0_gripper_qpos": np.array([0.5, -0.5]) * self.width,
        }
        for thing in self.things:
            w, x, y, z = thing.pose.rotation().wxyz
            found[f"{thing.name}_pos"] = thing.pose.translation()
            found[f"{thing.name}_quat"] = np.array([x, y, z, w])
        return found

    def step(self, answer: Mapping[str, Any]) -> None:
        """One period of robosuite's controller: v' = kp (goal - q) - 2 sqrt(kp) v, at 500 Hz."""
        goal, grip = answer["actions"][:7], answer["actions"][7]
        for _ in range(0 if self.stuck else 10):
            self.v += 0.002 * (KP * (goal - self.q) - 2.0 * np.sqrt(KP) * self.v)
            self.q = self.q + 0.002 * self.v
        tool, least = self.tool, 0.0
        between = [
            thing
            for thing in self.things
            if thing.held is not None or np.linalg.norm(tool.translation() - thing.spot) < 0.01
        ]
        if between:
            least = between[0].size
        self.width = float(np.clip(self.width - 0.004 * grip, least, 0.08))
        for thing in between:
            if self.width <= thing.size and grip > 0.0 and thing.held is None:
                thing.held = tool.inverse() @ thing.pose
            if self.width > thing.size + 0.001:
                thing.held = None
            if thing.held is not None:
                thing.pose = tool @ thing.held
                thing.spot = tool.translation()

    def run(self) -> str:
        """Run the program; returns what it told at its end."""
        message = self.setup | self.observation()
        for _ in range(3000):
            answer = self.policy.infer(message)
            if answer["done"]:
                return str(answer["told"])
            self.step(answer)
            message = self.observation()
        raise AssertionError("the program does not end")
