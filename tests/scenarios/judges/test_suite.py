"""Programs for robosuite against a stand-in that moves as told; robosuite judges elsewhere."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm
from scenarios.judges.suite.cell import FINGERTIPS, HOME, Cell, panda
from scenarios.judges.suite.grasping import block_grasp
from scenarios.judges.suite.programs import PROGRAMS, Programs
from scenarios.judges.suite.sensing import NOISE, Noise, measured

RATE, KP = 50.0, 150.0
BASE = np.array([-0.56, 0.0, 0.912, 1.0, 0.0, 0.0, 0.0])
FK = (
    (
        [0.7669854, -0.7827252, -2.5705483, -2.9520699, 1.7543133, 3.3771956, 0.5971603],
        [-0.57194, -0.042864, 0.890472],
    ),
    (
        [1.2851807, 0.148325, 2.4364056, -0.6340247, -2.7846644, 3.1723958, -2.6119208],
        [-0.870876, -0.150303, 2.071966],
    ),
    (
        [1.2860705, -1.1027709, 2.033802, -1.4297625, -1.1216134, 1.5639427, -2.6414098],
        [-1.215006, -0.196016, 1.342515],
    ),
    (
        [-2.1040137, 0.580123, 0.8242613, -1.2153832, -0.6514057, 3.6896768, 2.6926779],
        [-0.492285, -0.730255, 1.700124],
    ),
)
"""Joint positions, and where robosuite 1.5.2 has the grip site of its Panda at them."""


class StandIn:
    """A Panda as robosuite's controller moves it without errors, and one thing to hold."""

    def __init__(self, task: str, name: str, at: SE3, size: float) -> None:
        self.arm, self.policy = Arm(panda()), Programs()
        self.q, self.v, self.width = HOME.copy(), np.zeros(7), 0.08
        self.name, self.thing, self.size = name, at, size
        self.held: SE3 | None = None
        self.setup = {"task": task, "bases": BASE[None], "rate": RATE, "kp": KP, "reset": True}

    @property
    def tool(self) -> SE3:
        base = SE3.from_rotation_and_translation(SO3(BASE[3:].copy()), BASE[:3])
        beyond = 0.1065 + FINGERTIPS - 0.107 - 0.1034
        return base @ self.arm.pose(self.q) @ SE3.from_translation(np.array([0.0, 0.0, beyond]))

    def observation(self) -> dict[str, Any]:
        w, x, y, z = self.thing.rotation().wxyz
        return {
            "robot0_joint_pos": self.q,
            "robot0_gripper_qpos": np.array([0.5, -0.5]) * self.width,
            f"{self.name}_pos": self.thing.translation(),
            f"{self.name}_quat": np.array([x, y, z, w]),
        }

    def step(self, answer: Mapping[str, Any]) -> None:
        """One period of robosuite's controller: v' = kp (goal - q) - 2 sqrt(kp) v, at 500 Hz."""
        goal, grip = answer["actions"][:7], answer["actions"][7]
        for _ in range(10):
            self.v += 0.002 * (KP * (goal - self.q) - 2.0 * np.sqrt(KP) * self.v)
            self.q = self.q + 0.002 * self.v
        near = np.linalg.norm(self.tool.translation() - self.grasped) < 0.01
        least = self.size if near or self.held is not None else 0.0
        self.width = float(np.clip(self.width - 0.004 * grip, least, 0.08))
        if self.width <= self.size and grip > 0.0 and near and self.held is None:
            self.held = self.tool.inverse() @ self.thing
        if self.width > self.size + 0.001:
            self.held = None
        if self.held is not None:
            self.thing = self.tool @ self.held

    grasped = np.zeros(3)
    """Where the thing can be held."""

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


def flat(x: float, y: float, z: float, yaw: float) -> SE3:
    return SE3.from_rotation_and_translation(SO3.from_z_radians(yaw), np.array([x, y, z]))


def test_a_block_is_lifted() -> None:
    world = StandIn("Lift", "cube", flat(0.02, -0.03, 0.83, 2.0), 0.04)
    world.grasped = world.thing.translation()
    assert world.run() == ""
    assert world.thing.translation()[2] > 0.83 + 0.07
    np.testing.assert_allclose(world.thing.translation()[:2], [0.02, -0.03], atol=2e-3)


@pytest.mark.parametrize("yaw", [0.0, 0.7, 0.9, 2.0, 3.1, -1.2])
def test_a_block_is_held_by_its_faces_with_the_least_turn(yaw: float) -> None:
    across = block_grasp(flat(0.5, 0.1, 0.02, yaw)).rotation().as_matrix()[:, 1]
    np.testing.assert_allclose(
        np.sin(2.0 * (np.arctan2(across[1], across[0]) - yaw)), 0.0, atol=1e-9
    )
    assert abs(across[1]) > np.cos(np.pi / 4) - 1e-9


def test_a_block_that_is_not_there_is_told() -> None:
    world = StandIn("Lift", "cube", flat(0.02, -0.03, 0.83, 2.0), 0.04)
    world.grasped = np.array([0.0, 0.0, -1.0])
    assert world.run().startswith("grasp: the fingers closed to 0.0 mm")


@pytest.mark.parametrize("yaw", [0.4, -2.5])
def test_a_square_nut_fits_around_its_peg(yaw: float) -> None:
    world = StandIn("NutAssemblySquare", "SquareNut", flat(-0.11, 0.15, 0.83, yaw), 0.032)
    handle = 0.062 * np.array([np.cos(yaw), np.sin(yaw), 0.0]) + [0.0, 0.0, 0.003]
    world.grasped = world.thing.translation() + handle
    low: list[SE3] = []
    step = world.step

    def watched(answer: Mapping[str, Any]) -> None:
        was = world.held is not None
        step(answer)
        if was and world.held is None:
            low.append(world.thing)
            world.thing = flat(0.23, 0.1, 0.83, yaw)  # it falls

    world.step = watched  # type: ignore[method-assign]
    assert world.run() == ""
    (let_go,) = low
    np.testing.assert_allclose(let_go.translation(), [0.23, 0.1, 0.885], atol=3e-3)
    x, y, _ = let_go.rotation().as_matrix()[:, 0]
    assert abs(np.sin(2.0 * np.arctan2(y, x))) < 0.03  # square to the peg


def test_what_it_cannot_answer_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="one with it"):
        Programs().infer({})
    with pytest.raises(InvalidValueError, match="one of Lift, Stack"):
        Programs().infer({"reset": True, "task": "Fold"})
    assert set(Programs.metadata["tasks"]) == set(PROGRAMS)


@pytest.mark.parametrize(("q", "site"), FK)
def test_kinematics_are_those_of_robosuite(q: list[float], site: list[float]) -> None:
    """Figures of robosuite 1.5.2: joint positions, and its site grip_site at them."""
    seen = {"bases": BASE[None], "rate": RATE, "kp": KP, "robot0_joint_pos": np.array(q)}
    cell = Cell(seen)
    found = cell.T_suite_base @ cell.measured_tool
    np.testing.assert_allclose(found.translation(), site, atol=1e-5)


def test_noise_is_the_same_in_all_of_an_episode_and_as_large_as_told() -> None:
    seen = {"cube_pos": np.zeros(3), "cube_quat": np.array([0.0, 0.0, 0.0, 1.0])}
    first = Noise(7, NOISE)
    once, again = measured(seen, first), measured(seen, first)
    np.testing.assert_array_equal(once["cube_pos"], again["cube_pos"])
    drawn = [measured(seen, Noise(seed, NOISE)) for seed in range(400)]
    assert np.std([one["cube_pos"] for one in drawn]) == pytest.approx(0.002, rel=0.1)
    angles = [2.0 * one["cube_quat"][:3] for one in drawn]
    assert np.std(angles) == pytest.approx(np.deg2rad(2.0), rel=0.1)
    for one in drawn:
        assert np.linalg.norm(one["cube_quat"]) == pytest.approx(1.0)


def test_noise_turns_about_the_axes_of_the_world() -> None:
    half = np.sqrt(0.5)
    turned = Noise(3, NOISE).added("cube_quat", np.array([half, 0.0, 0.0, half]))
    error = Noise(3, NOISE).added("cube_quat", np.array([0.0, 0.0, 0.0, 1.0]))
    x, y, z, w = turned
    R = SO3(np.array([w, x, y, z])).as_matrix()
    x, y, z, w = error
    expected = SO3(np.array([w, x, y, z])).as_matrix() @ SO3.from_x_radians(np.pi / 2).as_matrix()
    np.testing.assert_allclose(R, expected, atol=1e-12)


def test_what_robosuite_derives_is_not_told() -> None:
    names = ["robot0_joint_pos", "robot0_joint_pos_cos", "gripper_to_cube_pos", "object-state"]
    seen = {name: np.ones(3) for name in [*names, "cube_pos", "hinge_qpos"]}
    told = measured(seen, Noise(0, NOISE))
    assert set(told) == {"robot0_joint_pos", "cube_pos"}
    np.testing.assert_array_equal(told["robot0_joint_pos"], np.ones(3))
