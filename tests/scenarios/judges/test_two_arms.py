"""TwoArmLift and TwoArmPegInHole beside figures of robosuite, and against a stand-in for it."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.model.tool_poses import ToolPoses
from robo47_qp.motion.collision_check import Collisions
from robo47_qp.motion.waypoint import tool_down
from scenarios.judges.suite import two_arms
from scenarios.judges.suite.cell import FINGERTIPS, HOME
from scenarios.judges.suite.pair import FIRST, SECOND, Pair
from scenarios.judges.suite.programs import Programs
from scenarios.judges.suite.sensing import NOISE, Noise, measured
from tests.scenarios.judges.stand_in import KP, RATE, StandIn

HALF = np.sqrt(0.5)
ON_TABLE, ON_FLOOR = 0.56, 0.6
"""Distances of the bases from the middle between them, with a table there and without."""
BAR = 0.02
"""Thickness of a handle [m]."""


def bases(apart: float) -> np.ndarray:
    """Where robosuite's arms stand that face each other: positions and quaternions."""
    return np.array(
        [[0.0, -apart, 0.912, HALF, 0.0, 0.0, HALF], [0.0, apart, 0.912, HALF, 0.0, 0.0, -HALF]]
    )


def seen(apart: float, first: Any = HOME, second: Any = HOME) -> dict[str, Any]:
    joints = {"robot0_joint_pos": np.array(first), "robot1_joint_pos": np.array(second)}
    return {"bases": bases(apart), "rate": RATE, "kp": KP, **joints}


def told(name: str, pose: SE3) -> dict[str, Any]:
    w, x, y, z = pose.rotation().wxyz
    return {f"{name}_pos": pose.translation(), f"{name}_quat": np.array([x, y, z, w])}


class Pandas(StandIn):
    """Two Pandas that move as told; they hold a pot, or a peg and a plate."""

    def __init__(self, task: str, pot: SE3 | None = None, noise: Noise | None = None) -> None:
        apart = ON_FLOOR if pot is None else ON_TABLE
        super().__init__(task, [])
        self.setup |= {"bases": bases(apart)}
        self.pair = Pair(seen(apart), 0.0 if pot is None else FINGERTIPS)
        self.q, self.v, self.widths = np.tile(HOME, 2), np.zeros(14), np.full(2, 0.08)
        self.pot, self.noise, self.lost = pot, noise, False
        self.held: SE3 | None = None
        self.ways: list[ToolPoses] = []
        self.off = np.zeros(3)
        """Error of where the hole is told to be [m]."""

    @property
    def tools(self) -> ToolPoses:
        self.pair.q = self.q
        return self.pair.tools

    def observation(self) -> dict[str, Any]:
        first, second = np.split(self.q, 2)
        found: dict[str, Any] = {"robot0_joint_pos": first, "robot1_joint_pos": second}
        if self.pot is None:
            plate = self.tools[SECOND] @ two_arms.PLATE
            found |= told("hole", SE3.from_translation(self.off) @ plate)
        else:
            found |= told("pot", self.pot)
            for i, width in enumerate(self.widths):
                found[f"robot{i}_gripper_qpos"] = np.array([0.5, -0.5]) * width
        return measured(found, self.noise)

    def step(self, answer: Mapping[str, Any]) -> None:
        actions = np.split(np.asarray(answer["actions"], float), 2)
        goal = np.concatenate([one[:7] for one in actions])
        for _ in range(10):
            self.v += 0.002 * (KP * (goal - self.q) - 2.0 * np.sqrt(KP) * self.v)
            self.q = self.q + 0.002 * self.v
        tools = self.tools
        self.ways.append(tools)
        if self.pot is None:
            assert [len(one) for one in actions] == [7, 7]
            return
        least = [0.0 if self.lost else BAR * self._around(i, tools) for i in range(2)]
        self.widths = np.clip(self.widths - [0.004 * one[7] for one in actions], least, 0.08)
        if min(least) > 0.0 and self.widths.max() < BAR + 1e-6:
            self.held = self.held or tools[FIRST].inverse() @ self.pot
            self.pot = tools[FIRST] @ self.held

    def _around(self, i: int, tools: ToolPoses) -> bool:
        """Whether a hand is where its fingers would close on the bar of its handle."""
        assert self.pot is not None
        hand = tools[(FIRST, SECOND)[i]]
        middle = self.pot.apply(np.array([0.0, (0.16, -0.16)[i], 0.06]))
        x, y, z = hand.inverse().apply(middle)
        along = (self.pot.rotation().inverse() @ hand.rotation()).as_matrix()[0, 0]
        # The side bars leave 70 mm, the pads are 16 mm wide and end 4 mm beyond the grip site.
        return bool(
            abs(x) < 0.02 and abs(y) < 0.02 and -0.02 < z < 0.008 and abs(along) > np.cos(0.2)
        )


def pot_at(x: float, y: float, yaw: float) -> SE3:
    return SE3.from_rotation_and_translation(SO3.from_z_radians(yaw), np.array([x, y, 0.87]))


FIGURES = (
    (
        [0.372, -0.281, 0.207, -3.099, 0.003, 2.877, 0.488],
        [-0.175, 0.506, -0.184, -2.951, 0.199, 2.889, 1.084],
        [-0.146283, -0.346483, 1.001479],
        [0.018424, 0.075166, -0.997001],
        [-0.156484, 0.449271, 0.764658],
        [0.794021, -0.482494, -0.350201, 0.118698],
    ),
    (
        [-0.264, 0.02, 0.3, -2.593, 0.006, 2.676, 0.3],
        [0.433, -0.214, 0.345, -2.732, 0.451, 2.839, 1.221],
        [-0.017789, -0.143743, 1.039224],
        [-0.010881, 0.063507, -0.997922],
        [0.31036, 0.143264, 1.086943],
        [0.390678, -0.625413, -0.501341, 0.452644],
    ),
)
"""Joints of both arms, and where robosuite 1.5.2 has peg and plate at them: the peg's position and
axis, and the plate's position and quaternion wxyz."""


@pytest.mark.parametrize(("first", "second", "peg", "axis", "plate", "turn"), FIGURES)
def test_peg_and_plate_are_where_robosuite_has_them(
    first: Any, second: Any, peg: Any, axis: Any, plate: Any, turn: Any
) -> None:
    hands = Pair(seen(ON_FLOOR, first, second), 0.0).measured_tools
    T_world_peg, T_world_plate = hands[FIRST] @ two_arms.PEG, hands[SECOND] @ two_arms.PLATE
    np.testing.assert_allclose(T_world_peg.translation(), peg, atol=1e-5)
    np.testing.assert_allclose(T_world_peg.rotation().as_matrix()[:, 2], axis, atol=1e-5)
    # Robosuite rounds the quaternion by which the hand is turned on the last link to four digits.
    np.testing.assert_allclose(T_world_plate.translation(), plate, atol=1e-4)
    R = SO3(np.array(turn) / np.linalg.norm(turn)).as_matrix()
    np.testing.assert_allclose(T_world_plate.rotation().as_matrix(), R, atol=1e-3)


def test_grip_sites_are_where_robosuite_has_them() -> None:
    """Figures of robosuite 1.5.2: joints of both arms, and its sites grip_site at them."""
    pair = Pair(
        seen(
            ON_TABLE,
            [0.305, 0.508, 0.015, -2.814, -0.446, 2.823, 0.693],
            [-0.455, -0.251, 0.499, -2.448, -0.265, 2.875, 1.259],
        )
    )
    hands = pair.measured_tools
    first, second = [-0.07831, -0.358326, 0.868027], [0.030954, 0.002575, 1.291422]
    np.testing.assert_allclose(hands[FIRST].translation(), first, atol=1e-5)
    np.testing.assert_allclose(hands[SECOND].translation(), second, atol=1e-5)


@pytest.mark.parametrize(("yaw", "seed"), [(2.1, None), (4.18, 5)])
def test_a_pot_is_lifted_level_by_hands_that_keep_their_places_on_it(
    yaw: float, seed: int | None
) -> None:
    noise = None if seed is None else Noise(seed, NOISE)
    world = Pandas("TwoArmLift", pot_at(0.03, -0.03, yaw), noise)
    assert world.run() == ""
    assert world.pot is not None
    # Robosuite wants 0.10 m.
    np.testing.assert_allclose(world.pot.translation(), [0.03, -0.03, 0.87 + 0.16], atol=1e-3)
    assert world.pot.rotation().as_matrix()[2, 2] > np.cos(np.deg2rad(0.5))
    carried = [one for one in world.ways if one[FIRST].translation()[2] > 0.94]
    late = [one[FIRST].inverse() @ one[SECOND] for one in carried[-40:]]
    for pose in late:
        apart = (late[-1].inverse() @ pose).log()
        assert np.abs(apart).max() < 5e-4


def test_a_pot_that_one_hand_does_not_hold_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(two_arms, "ATTEMPTS", 1)
    world = Pandas("TwoArmLift", pot_at(0.0, 0.0, np.pi))
    world.lost = True
    assert world.run() == "grasp: the fingers closed to 0.0 mm"


@pytest.mark.parametrize("yaw", [2.0 * np.pi / 3.0, np.pi, 4.0 * np.pi / 3.0])
def test_open_hands_have_room_around_the_handles(yaw: float) -> None:
    """The pot as robosuite makes it, of walls, bars and side bars (pot_with_handles.py)."""
    pot, pair = pot_at(0.0, 0.0, yaw), Pair(seen(ON_TABLE))
    grasps = {
        name: pair.nearest(name, two_arms.handle_grasps(pot, side))
        for name, side in ((FIRST, 1.0), (SECOND, -1.0))
    }
    target = ToolPoses({name: pair.tcp(pose) for name, pose in grasps.items()})
    found = pair.planner.ik.solve(pair.arm, target, pair.arm.home)
    assert found.converged

    def add(spec: mujoco.MjSpec) -> None:
        box, body = mujoco.mjtGeom.mjGEOM_BOX, spec.worldbody.add_body(name="pot")
        body.pos, body.quat = pot.translation(), pot.rotation().wxyz
        body.add_geom(type=box, size=[0.07, 0.07, 0.07])
        for side in (1.0, -1.0):
            body.add_geom(type=box, size=[0.055, 0.01, 0.01], pos=[0.0, 0.16 * side, 0.06])
            for end in (0.045, -0.045):
                at = [end, 0.115 * side, 0.06]
                body.add_geom(type=box, size=[0.01, 0.045, 0.01], pos=at)

    assert Collisions(pair.arm.robot, add, clearance=0.004).at(found.q) is None
    for side, hand in zip((1.0, -1.0), grasps.values(), strict=True):
        bar = hand.inverse() @ pot
        middle = bar.apply(np.array([0.0, 0.16 * side, 0.06]))
        np.testing.assert_allclose(middle, [0.0, 0.0, -two_arms.LOWERED], atol=1e-9)
        assert abs(bar.rotation().as_matrix()[0, 0]) == pytest.approx(1.0)


def hole_and_peg() -> mujoco.MjModel:
    """The plate by plate-with-hole.xml, and a peg of the largest radius."""
    spec = mujoco.MjSpec()
    plate = spec.worldbody.add_body(name="plate")
    box, cylinder = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
    plate.add_geom(type=box, pos=[0.0, 0.0, 0.0], size=[0.06, 0.17, 0.01])
    plate.add_geom(type=box, pos=[0.22, 0.0, 0.0], size=[0.06, 0.17, 0.01])
    plate.add_geom(type=box, pos=[0.11, 0.11, 0.0], size=[0.05, 0.06, 0.01])
    plate.add_geom(type=box, pos=[0.11, -0.11, 0.0], size=[0.05, 0.06, 0.01])
    peg = spec.worldbody.add_body(name="peg", mocap=True)
    peg.add_geom(type=cylinder, size=[0.03, 0.13, 0.0])
    return spec.compile()


def room(model: mujoco.MjModel, T_plate_peg: SE3) -> float:
    """Distance of the peg from the plate, at most 0.1 [m]."""
    data = mujoco.MjData(model)
    data.mocap_pos[0] = T_plate_peg.translation()
    data.mocap_quat[0] = T_plate_peg.rotation().wxyz
    mujoco.mj_forward(model, data)
    return min(mujoco.mj_geomDistance(model, data, part, 4, 0.1, None) for part in range(4))


def verdict(peg: SE3, plate: SE3) -> tuple[float, float, float]:
    """Robosuite's figures t [m], d [m] and cos (two_arm_peg_in_hole.py)."""
    v: Vector = peg.rotation().as_matrix()[:, 2]
    center = plate.apply(np.array([0.1, 0.0, 0.0]))
    apart = center - peg.translation()
    cos = abs(plate.rotation().as_matrix()[:, 2] @ v)
    return float(apart @ v), float(np.linalg.norm(np.cross(v, apart))), float(cos)


@pytest.mark.parametrize("seed", [None, 3, 8])
def test_a_peg_is_led_into_the_hole_without_touching_the_plate(seed: int | None) -> None:
    noise = None if seed is None else Noise(seed, NOISE)
    world = Pandas("TwoArmPegInHole", noise=noise)
    assert world.run() == ""
    ways = [(one[FIRST] @ two_arms.PEG, one[SECOND] @ two_arms.PLATE) for one in world.ways]
    t, d, cos = verdict(*ways[-1])
    assert -0.12 <= t <= 0.14
    assert d < 0.06
    assert cos > 0.95
    assert t == pytest.approx(0.13 - two_arms.THROUGH, abs=0.01)
    model = hole_and_peg()
    least = min(room(model, plate.inverse() @ peg) for peg, plate in ways[::3])
    assert least > (0.019 if noise is None else 0.008)


def test_a_peg_beside_the_hole_is_refused() -> None:
    world = Pandas("TwoArmPegInHole")
    world.off = np.array([0.05, 0.0, 0.0])
    told = world.run()
    assert told.startswith("plan: ")
    assert "left_hand and right_hand come within" in told


def test_a_plate_that_would_be_in_the_mount_of_its_arm_is_seen() -> None:
    """Robosuite has a pedestal there, to 0.16 m before the base and 0.03 m above it."""
    pair = Pair(seen(ON_FLOOR), 0.0)
    low = tool_down([0.0, 0.32, 1.18], 0.5 * np.pi)
    plate = low @ two_arms.PLATE
    far = plate.apply(np.array([-0.06, 0.17, 0.0]))
    near = plate.apply(np.array([0.28, 0.17, 0.0]))
    lowest = min((far, near), key=lambda corner: -corner[1])
    assert lowest[1] > 0.6 - 0.15
    assert lowest[2] < 0.912 + 0.02
    found = pair.planner.ik.solve(pair.arm, ToolPoses({SECOND: pair.tcp(low)}), pair.arm.home)
    assert found.converged
    assert pair.planner.collisions is not None
    assert pair.planner.collisions.at(found.q) is None
    pair.keep_clear(second=two_arms.plate_solids())
    hit = pair.planner.collisions.at(found.q)
    assert hit is not None
    assert set(hit[:2]) == {"right_hand", "world"}


def test_how_peg_and_hole_are_to_each_other_is_not_told() -> None:
    names = ["angle", "t", "d", "peg_to_hole", "hole_pos", "peg_quat", "handle0_xpos"]
    values = {name: np.ones(4 if name == "peg_quat" else 3) for name in names}
    found = measured(values, Noise(0, NOISE))
    assert set(found) == {"hole_pos", "peg_quat", "handle0_xpos"}
    assert (found["handle0_xpos"] != 1.0).all()


def test_each_arm_is_commanded_with_its_gripper_where_it_has_one() -> None:
    fingers = {f"robot{i}_gripper_qpos": np.array([0.02, -0.02]) for i in range(2)}
    for task, more, length in (("TwoArmLift", fingers, 16), ("TwoArmPegInHole", {}, 14)):
        message = seen(ON_TABLE) | more | {"reset": True, "task": task}
        actions = Programs().infer(message)["actions"]
        assert len(actions) == length
        np.testing.assert_array_equal(actions[:7], HOME)
        np.testing.assert_array_equal(actions[length // 2 :][:7], HOME)
