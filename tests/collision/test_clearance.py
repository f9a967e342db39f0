"""Distances against elementary geometry, and against all pairs without a broad phase."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.collision.broad_phase import BroadPhase
from robo47_qp.collision.clearance import Clearance, closest_pair
from robo47_qp.collision.distance import GeomDistance
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robots.panda import PANDA
from tests.small_robots import at, cell, gantry, vector

SPHERE, BOX, CAPSULE = (
    'type="sphere" size="0.1"',
    'type="box" size="0.1 0.2 0.3"',
    'type="capsule" size="0.1 0.3"',
)


def probe(folder: Path, tip: str, obstacle: Obstacle) -> Clearance:
    return Clearance(Arm(gantry(folder, tip), obstacles=[obstacle]), 0.0)


def measured(clearance: Clearance, x: float, y: float, z: float, tilt: float = 0.0) -> float:
    distance, names = clearance.nearest(vector(x, y, z, tilt))
    assert names == ("probe", "it")
    return distance


def test_sphere_and_sphere(tmp_path: Path) -> None:
    of = probe(tmp_path, SPHERE, Obstacle(name="it", shape=Shape.SPHERE, size=(0.25,)))
    for x, y, z in [(1.0, 0.5, -0.4), (0.3, 0.0, 0.2), (0.1, 0.1, 0.1), (0.0, 0.0, 0.01)]:
        expected = np.linalg.norm([x, y, z]) - 0.35
        assert measured(of, x, y, z) == pytest.approx(expected, abs=1e-9)


def test_sphere_and_box(tmp_path: Path) -> None:
    of = probe(tmp_path, SPHERE, Obstacle(name="it", shape=Shape.BOX, size=(0.3, 0.4, 0.5)))
    assert measured(of, 0.6, 0.8, 0.5) == pytest.approx(0.5 - 0.1, abs=1e-9)
    assert measured(of, 0.6, 0.8, 1.7) == pytest.approx(1.3 - 0.1, abs=1e-9)
    assert measured(of, 0.0, 0.45, 0.0) == pytest.approx(-0.05, abs=1e-9)
    # The centre inside: out by the nearest face.
    assert measured(of, 0.25, 0.0, 0.0) == pytest.approx(-0.15, abs=1e-9)


def test_capsule_and_capsule(tmp_path: Path) -> None:
    it = Obstacle(name="it", shape=Shape.CAPSULE, size=(0.05, 0.4))
    of = probe(tmp_path, CAPSULE, it)
    assert measured(of, 0.5, 0.0, 0.2) == pytest.approx(0.35, abs=1e-9)
    # Crossed: the probe lies along x, 0.3 m in front.
    assert measured(of, 0.1, 0.3, 0.1, np.pi / 2) == pytest.approx(0.15, abs=1e-9)
    assert measured(of, 0.1, 0.08, 0.1, np.pi / 2) == pytest.approx(-0.07, abs=1e-9)
    # End to end.
    assert measured(of, 0.0, 0.0, 1.0) == pytest.approx(0.15, abs=1e-9)


def test_box_and_plane(tmp_path: Path) -> None:
    of = probe(tmp_path, BOX, Obstacle(name="it", shape=Shape.PLANE, T_world_obstacle=at(0, 0, -1)))
    for z, tilt in [(0.0, 0.0), (-0.8, 0.0), (0.2, 0.4), (-0.9, -1.1)]:
        low = 0.1 * abs(np.sin(tilt)) + 0.3 * abs(np.cos(tilt))
        assert measured(of, 1.7, -1.9, z, tilt) == pytest.approx(z + 1.0 - low, abs=1e-9)


def test_cylinder_and_box(tmp_path: Path) -> None:
    of = probe(tmp_path, BOX, Obstacle(name="it", shape=Shape.CYLINDER, size=(0.2, 0.5)))
    assert measured(of, 0.0, 0.9, 0.1) == pytest.approx(0.5, abs=1e-7)
    assert measured(of, 0.4, 0.0, 1.2) == pytest.approx(np.hypot(0.1, 0.4), abs=1e-7)
    assert measured(of, 0.25, 0.0, 0.1) == pytest.approx(-0.05, abs=1e-5)


def through(middle: Vector, axis: Vector, half: float, size: Vector) -> bool:
    """Whether points along an axis, 0.1 mm apart, are in a box."""
    along = np.linspace(-half, half, int(2e4 * half))
    return bool((np.abs(middle + along[:, None] * axis) < size).all(axis=1).any())


@pytest.mark.parametrize("cut_off", [np.inf, 0.02, 0.0, -0.01])
@pytest.mark.parametrize("box_first", [True, False])
def test_a_capsule_run_through_a_box_is_never_clear(box_first: bool, cut_off: float) -> None:
    rng = np.random.default_rng(3)
    crossing, fooled = 0, 0
    for _ in range(30):
        size, radius, half = rng.uniform(0.01, 0.3, 3), *rng.uniform(0.01, [0.08, 0.3])
        spec = mujoco.MjSpec()
        for kind, lengths in sorted(
            [(mujoco.mjtGeom.mjGEOM_BOX, size), (mujoco.mjtGeom.mjGEOM_CAPSULE, [radius, half, 0])],
            key=lambda pair: (pair[0] == mujoco.mjtGeom.mjGEOM_BOX) != box_first,
        ):
            spec.worldbody.add_body(mocap=True).add_geom(type=kind, size=lengths)
        m = spec.compile()
        d = mujoco.MjData(m)
        box, capsule = (0, 1) if box_first else (1, 0)
        measure = GeomDistance(m, d)
        for _ in range(12):
            d.mocap_pos[:] = rng.uniform(-0.2, 0.2, (2, 3))
            d.mocap_quat[:] = rng.normal(size=(2, 4))
            d.mocap_quat /= np.linalg.norm(d.mocap_quat, axis=1)[:, None]
            mujoco.mj_kinematics(m, d)
            R = d.geom_xmat.reshape(-1, 3, 3)
            middle = R[box].T @ (d.geom_xpos[capsule] - d.geom_xpos[box])
            if through(middle, R[box].T @ R[capsule][:, 2], half, size):
                crossing += 1
                assert measure.between(0, 1, cut_off) < 0.0
                fooled += mujoco.mj_geomDistance(m, d, 0, 1, 9.0, None) > 0.0
                _check_way_out(m, d, measure, box, capsule)
    assert crossing > 50
    assert fooled > 0, "MuJoCo has mended this: the second look can go"


def _check_way_out(
    m: mujoco.MjModel, d: mujoco.MjData, measure: GeomDistance, box: int, capsule: int
) -> None:
    """Moving out along the segment by the depth makes them touch."""
    depth = -measure.between(0, 1, np.inf)
    out = (measure.segment[:3] - measure.segment[3:]) / depth
    assert np.linalg.norm(out) == pytest.approx(1.0, abs=1e-9)
    sign = 1.0 if capsule == 1 else -1.0
    before = d.mocap_pos.copy()
    d.mocap_pos[capsule] = before[capsule] + sign * depth * 0.5 * out
    d.mocap_pos[box] = before[box] - sign * depth * 0.5 * out
    mujoco.mj_kinematics(m, d)
    after = measure.between(0, 1, np.inf)
    d.mocap_pos[:] = before
    mujoco.mj_kinematics(m, d)
    # They touch, as the probe's surface is out by all of its depth and by no more.
    assert after == pytest.approx(0.0, abs=1e-9)


@pytest.fixture(scope="module")
def crowded() -> Clearance:
    return Clearance(Arm(PANDA, obstacles=cell()), 0.01)


def configurations(arm: Arm, count: int) -> Matrix:
    return np.random.default_rng(8).uniform(arm.q_min, arm.q_max, (count, arm.n))


def every(clearance: Clearance, q: Vector) -> Vector:
    """All pairs, each on its own."""
    return np.array([clearance.distance_of(i, q) for i in range(len(clearance.pairs.kept))])


def test_the_nearest_is_the_least_of_all_pairs(crowded: Clearance) -> None:
    overlaps = 0
    for q in configurations(crowded.arm, 150):
        distances = every(crowded, q)
        found, names = crowded.nearest(q)
        assert found == pytest.approx(distances.min(), abs=1e-9)
        ties = np.flatnonzero(distances < distances.min() + 1e-9)
        assert names in {crowded.pairs.names[i] for i in ties}
        overlaps += found < -0.02
    assert 20 < overlaps < 130


def test_clear_says_whether_the_nearest_is_far_enough(crowded: Clearance) -> None:
    clear = 0
    for q in configurations(crowded.arm, 100):
        nearest = every(crowded, q).min()
        for margin in (0.0, 0.01, 0.05, -0.01):
            assert crowded.clear(q, margin) == (nearest >= margin)
        clear += nearest >= 0.01
    assert 20 < clear < 90


def test_nearby_pairs_are_all_that_are_close_the_closest_first(crowded: Clearance) -> None:
    for q in configurations(crowded.arm, 50):
        distances = every(crowded, q)
        near = crowded.pairs_within(q, 0.06)
        assert set(near.pair.tolist()) == set(np.flatnonzero(distances < 0.06).tolist())
        assert near.distance.tolist() == sorted(near.distance.tolist())
        assert near.distance == pytest.approx(distances[near.pair], abs=1e-9)
        lengths = np.linalg.norm(near.segment[:, 3:] - near.segment[:, :3], axis=1)
        assert lengths == pytest.approx(np.abs(near.distance), abs=1e-9)


def test_no_pair_is_closer_than_its_bound(crowded: Clearance) -> None:
    m, d = crowded.arm.model, mujoco.MjData(crowded.arm.model)
    broad = BroadPhase(m, crowded.pairs.kept)
    tight = 0
    for q in configurations(crowded.arm, 100):
        d.qpos[:] = q
        mujoco.mj_kinematics(m, d)
        distances = every(crowded, q)
        bounds = broad.bounds(d)
        assert (bounds <= distances + 1e-9).all()
        tight += int((bounds > 0.06).sum())
    assert tight > 100 * 0.5 * len(crowded.pairs.kept)


def test_what_the_tool_cannot_help(crowded: Clearance) -> None:
    """The same for all configurations of one tool pose; here joint 1 of another arm height."""
    q = crowded.arm.home.copy()
    distance, names = crowded.nearest_of_tools(q, [0])
    hand = {"link7", "hand", "left_finger", "right_finger"}
    assert names[0] in hand
    among = [
        crowded.distance_of(i, q)
        for i, (a, b) in enumerate(crowded.pairs.names)
        if a in hand and b in {"table", "post", "ball", "shelf", "floor"}
    ]
    base = [
        crowded.distance_of(i, q)
        for i, (a, b) in enumerate(crowded.pairs.names)
        if a == "link0" and b in hand
    ]
    assert distance == pytest.approx(min(among + base), abs=1e-9)


def test_what_the_leeway_of_the_tool_may_open_is_not_inevitable() -> None:
    tool = Arm(PANDA).pose(PANDA.home).translation()
    ball = Obstacle(
        name="ball",
        shape=Shape.SPHERE,
        size=(0.05,),
        T_world_obstacle=at(tool[0], tool[1], tool[2] - 0.08),
    )
    arm = Arm(PANDA, obstacles=[ball])
    distance, pair = Clearance(arm, 0.0).nearest_of_tools(arm.home, [0])
    for required, inevitable in ((distance + 1e-3, False), (distance + 3e-3, True)):
        found = closest_pair(arm, arm.home, required, 2e-3, [0])
        assert (found.inevitable, found.pair) == (inevitable, pair)
        assert not closest_pair(arm, arm.home, required, 2e-3, []).inevitable
