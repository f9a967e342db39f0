"""Programs for robosuite against a stand-in that moves as told; robosuite judges elsewhere."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError
from robo47_qp.motion.waypoint import Motion, Waypoint
from scenarios.judges.suite import nuts
from scenarios.judges.suite.cell import HOME, LATE, TURN, Cell
from scenarios.judges.suite.grasping import block_grasp
from scenarios.judges.suite.programs import FALL, PROGRAMS, Programs
from scenarios.judges.suite.sensing import NOISE, Noise, measured
from tests.scenarios.judges.stand_in import BASE, KP, RATE, StandIn, Thing

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


def flat(x: float, y: float, z: float, yaw: float) -> SE3:
    return SE3.from_rotation_and_translation(SO3.from_z_radians(yaw), np.array([x, y, z]))


def cube() -> Thing:
    thing = Thing("cube", flat(0.02, -0.03, 0.83, 2.0), 0.04)
    thing.spot = thing.pose.translation()
    return thing


def test_a_block_is_lifted() -> None:
    thing = cube()
    assert StandIn("Lift", [thing]).run() == ""
    assert thing.pose.translation()[2] > 0.83 + 0.07
    np.testing.assert_allclose(thing.pose.translation()[:2], [0.02, -0.03], atol=2e-3)


def test_things_that_fall_at_first_are_looked_at_when_they_lie() -> None:
    world, policy = StandIn("Lift", [cube()]), Programs()
    falling = {"cube_pos": np.array([0.02, -0.03, 0.9])}
    message = world.setup | world.observation() | falling
    for _ in range(round(FALL * RATE)):
        np.testing.assert_array_equal(policy.infer(message)["actions"][:7], HOME)
        message = world.observation() | falling
    assert world.run() == ""


def test_an_arm_that_does_not_come_where_it_is_led_is_told() -> None:
    world = StandIn("Lift", [cube()])
    world.stuck = True
    assert world.run().startswith("track: ")
    assert LATE > 0.5


def seen(q: np.ndarray = HOME, **more: Any) -> dict[str, Any]:
    return {"bases": BASE[None], "rate": RATE, "kp": KP, "robot0_joint_pos": q, **more}


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("pace", [1.0, 0.4])
def test_the_hand_turns_as_fast_as_it_may_in_joint_space(seed: int, pace: float) -> None:
    cell, rng = Cell(seen()), np.random.default_rng(seed)
    goal = HOME + rng.uniform(-0.6, 0.6, 7) + np.array([0, 0, 0, 0, 0, 0, 1.5])
    target = cell.arm.pose(goal)
    waypoint = Waypoint(name="there", target=target, motion=Motion.PTP, pace=pace)
    motion = cell.planned(waypoint)
    turns = [
        np.linalg.norm(cell.arm.jacobian(q)[3:] @ v)
        for q, v in zip(motion.q, motion.v, strict=True)
    ]
    assert max(turns) < 1.01 * TURN
    assert max(turns) > 0.9 * TURN * pace or motion.duration < 2.0
    np.testing.assert_allclose(
        cell.arm.pose(motion.q[-1]).as_matrix(), target.as_matrix(), atol=1e-4
    )


@pytest.mark.parametrize("nut", [nuts.SQUARE, nuts.ROUND])
@pytest.mark.parametrize("yaw", np.linspace(-3.0, 3.0, 9))
def test_the_wrist_is_turned_little_between_a_nut_and_its_peg(nut: nuts.Nut, yaw: float) -> None:
    w, z = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    quat, at = np.array([0.0, 0.0, z, w]), np.array([-0.11, 1.5 * nut.peg[1], 0.83])
    cell = Cell(seen(**{f"{nut.name}_pos": at, f"{nut.name}_quat": quat}))
    turn, there = nuts.choice(cell, nut)
    ends = nuts.held(nut, cell.pose(nut.name), turn), nuts.around_peg(cell, nut, nuts.LOW, there)
    grasp, place = ends[0], nuts.held(nut, ends[1], turn)
    first, last = nuts.wrist(cell, grasp), nuts.wrist(cell, place)
    assert max(abs(first), abs(last)) < nuts.WRIST
    assert abs(last - first) < 3.5
    # What is told of joint 7 is where inverse kinematics brings it, about.
    target = grasp @ cell.T_tcp_grip.inverse()
    found = cell.planner.ik.solve(cell.arm, target, cell.arm.home)
    assert found.converged
    assert abs(found.q[6] - first) < 1.0


@pytest.mark.parametrize("yaw", [0.0, 0.7, 0.9, 2.0, 3.1, -1.2])
def test_a_block_is_held_by_its_faces_with_the_least_turn(yaw: float) -> None:
    across = block_grasp(flat(0.5, 0.1, 0.02, yaw)).rotation().as_matrix()[:, 1]
    np.testing.assert_allclose(
        np.sin(2.0 * (np.arctan2(across[1], across[0]) - yaw)), 0.0, atol=1e-9
    )
    assert abs(across[1]) > np.cos(np.pi / 4) - 1e-9


def test_a_block_that_is_not_there_is_told() -> None:
    thing = Thing("cube", flat(0.02, -0.03, 0.83, 2.0), 0.04)
    told = StandIn("Lift", [thing]).run()
    assert told.startswith("grasp: the fingers closed to 0.0 mm")


@pytest.mark.parametrize("yaw", [0.4, -2.5])
def test_a_square_nut_fits_around_its_peg(yaw: float) -> None:
    nut = Thing("SquareNut", flat(-0.11, 0.15, 0.83, yaw), 0.032)
    nut.spot = nut.pose.apply(np.array([0.062, 0.0, 0.003]))
    world = StandIn("NutAssemblySquare", [nut])
    low: list[SE3] = []
    step = world.step

    def watched(answer: Mapping[str, Any]) -> None:
        was = nut.held is not None
        step(answer)
        if was and nut.held is None:
            low.append(nut.pose)
            nut.pose = flat(0.23, 0.1, 0.83, yaw)  # it falls

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
    cell = Cell(seen(np.array(q)))
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
    names += ["frame_is_assembled", "tool_on_frame", "cube_pos", "hinge_qpos"]
    told = measured({name: np.ones(3) for name in names}, Noise(0, NOISE))
    assert set(told) == {"robot0_joint_pos", "cube_pos"}
    np.testing.assert_array_equal(told["robot0_joint_pos"], np.ones(3))
