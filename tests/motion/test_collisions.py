from dataclasses import replace
from itertools import combinations
from pathlib import Path

import mujoco
import numpy as np
import pytest

from robo47_qp.errors import PlanError, RefusalReason
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.collision_check import Collisions, Surroundings
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.trajectory import Trajectory
from tests.robots import GRIPPER
from tests.small_robots import gantry

ARM, DT = Arm(PANDA), 1e-3
BALL, RADIUS = np.array([0.2, 0.25, 0.5]), 0.05


def ball(spec: mujoco.MjSpec) -> None:
    body = spec.worldbody.add_body(name="ball", pos=BALL)
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0, 0])


def turned(angle: float) -> np.ndarray:
    q = ARM.home.copy()
    q[0] += angle
    return q


def test_a_swing_into_a_ball_is_refused_with_bodies_joint_and_time() -> None:
    collisions = Collisions(PANDA, ball, clearance=0.01)
    swing = plan_ptp(turned(-0.5), turned(1.5), PANDA.profile, DT)
    with pytest.raises(PlanError, match=r"ball.* come within .* mm at \d\.\d+ s") as caught:
        collisions.check("swing", swing)
    found = caught.value.rejection
    assert found is not None
    assert found.reason is RefusalReason.COLLISION
    assert caught.value.waypoint == "swing"
    assert found.joint in PANDA.joints
    assert found.time is not None
    assert found.q is not None
    k = int(found.time / DT)
    between = found.time / DT - k
    there = (1.0 - between) * swing.q[k] + between * swing.q[k + 1]
    assert list(found.q) == pytest.approx(there.tolist(), abs=1e-9)
    assert found.fraction == pytest.approx(found.time / swing.duration)
    assert gap(swing.q[k]) < 0.01
    # Not long before, there was room.
    earlier = int(np.flatnonzero(np.abs(swing.q[:, 0] - swing.q[k, 0]) > 0.03)[0])
    before = [i for i in range(k) if abs(swing.q[i, 0] - swing.q[k, 0]) > 0.03]
    assert earlier == 0
    assert gap(swing.q[before[-1]]) > 0.01


def gap(q: np.ndarray) -> float:
    """Distance from the ball to the nearest geom of the robot, by MuJoCo on the file alone."""
    spec = mujoco.MjSpec.from_file(str(PANDA.mjcf))
    ball(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, value in zip(PANDA.joints, q, strict=True):
        data.joint(name).qpos[0] = value
    mujoco.mj_forward(model, data)
    target = int(model.body("ball").geomadr[0])
    touching = [g for g in range(model.ngeom) if g != target and model.geom_contype[g]]
    ends = np.zeros(6)
    return min(mujoco.mj_geomDistance(model, data, g, target, 1.0, ends) for g in touching)


def test_a_free_way_is_free() -> None:
    collisions = Collisions(PANDA, ball, clearance=0.01)
    collisions.check("away", plan_ptp(turned(0.0), turned(-1.0), PANDA.profile, DT))
    assert collisions.at(ARM.home) is None


def test_the_arm_does_not_go_through_itself() -> None:
    folded = np.array([0.0, -1.6, 0.0, -3.05, 0.0, 0.3, 0.0])
    found = Collisions(PANDA, lambda _: None).at(folded)
    assert found is not None
    assert found[2] in PANDA.joints


def test_what_moves_freely_is_no_obstacle() -> None:
    def loose(spec: mujoco.MjSpec) -> None:
        body = spec.worldbody.add_body(name="cube", pos=ARM.pose(ARM.home).translation())
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.05, 0, 0])

    assert Collisions(PANDA, loose).at(ARM.home) is None


class Oracle:
    """Distances between bodies by MuJoCo on the file alone, pair by pair of geoms."""

    def __init__(self, surroundings: Surroundings, clearance: float = 0.005) -> None:
        spec = mujoco.MjSpec.from_file(str(PANDA.mjcf))
        own = {body.name for body in spec.bodies}
        surroundings(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        for name in GRIPPER.joints:
            self.data.qpos[self.model.joint(name).qposadr[0]] = 0.5 * GRIPPER.width_max
        self.addresses = [int(self.model.joint(name).qposadr[0]) for name in PANDA.joints]
        m = self.model
        solid = [g for g in range(m.ngeom) if m.geom_contype[g] or m.geom_conaffinity[g]]
        self.pairs = [
            (a, b)
            for a, b in combinations(solid, 2)
            if m.geom_bodyid[a] != m.geom_bodyid[b]
            and m.geom_bodyid[a] not in self.related(int(m.geom_bodyid[b]))
            and m.geom_bodyid[b] not in self.related(int(m.geom_bodyid[a]))
        ]
        bodies = [tuple(sorted(m.geom_bodyid[list(pair)].tolist())) for pair in self.pairs]
        at_home = zip(bodies, self.all(ARM.home), strict=True)
        close = {
            pair
            for pair, distance in at_home
            if distance < clearance and {m.body(body).name for body in pair} <= own
        }
        kept = zip(self.pairs, bodies, strict=True)
        self.pairs = [pair for pair, names in kept if names not in close]

    def related(self, body: int) -> set[int]:
        """The bodies that hold this one rigidly, and the next after them."""
        m, found = self.model, {body}
        while body:
            free = m.body_jntnum[body] > 0
            body = int(m.body_parentid[body])
            found.add(body)
            if free:
                break
        return found

    def place(self, q: np.ndarray) -> None:
        self.data.qpos[self.addresses] = q
        mujoco.mj_kinematics(self.model, self.data)

    def all(self, q: np.ndarray) -> list[float]:
        self.place(q)
        ends = np.zeros(6)
        return [
            mujoco.mj_geomDistance(self.model, self.data, a, b, 0.5, ends) for a, b in self.pairs
        ]

    def least(self, q: np.ndarray) -> float:
        return min(self.all(q))


def post(at: np.ndarray, radius: float, height: float = 0.4) -> Surroundings:
    def add(spec: mujoco.MjSpec) -> None:
        body = spec.worldbody.add_body(name="post", pos=at)
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[radius, height, 0])

    return add


def verdict(collisions: Collisions, motion: Trajectory) -> PlanError | None:
    try:
        collisions.check("motion", motion)
    except PlanError as error:
        return error
    return None


def test_the_verdict_is_that_of_a_dense_look() -> None:
    rng, clearance, seen = np.random.default_rng(1), 0.01, {True: 0, False: 0}
    for _ in range(8):
        start, goal = ARM.home + rng.uniform(-0.7, 0.7, (2, ARM.n))
        goal = np.clip(goal, ARM.q_min, ARM.q_max)
        start = np.clip(start, ARM.q_min, ARM.q_max)
        middle = ARM.pose(0.5 * (start + goal)).translation()
        around = post(middle + rng.normal(0.0, 0.12, 3), 0.005, 0.1)
        motion, oracle = plan_ptp(start, goal, PANDA.profile, DT), Oracle(around)
        error = verdict(Collisions(PANDA, around, clearance), motion)
        least = min(oracle.least(q) for q in motion.q[::12])
        if least < 0.5 * clearance:
            assert error is not None
        if error is not None:
            found = error.rejection
            assert found is not None
            assert found.q is not None
            assert oracle.least(np.array(found.q)) < clearance + 1e-6
        seen[error is None] += 1
    assert min(seen.values()) >= 2


@pytest.mark.parametrize("shape", ["CYLINDER", "BOX", "CAPSULE", "ELLIPSOID"])
def test_distances_are_not_those_of_contacts(shape: str) -> None:
    """MuJoCo's contacts of what is apart err by millimetres, or there are none."""
    rng, clearance, near = np.random.default_rng(7), 0.03, 0

    def thing(spec: mujoco.MjSpec) -> None:
        body = spec.worldbody.add_body(name="thing", pos=BALL, quat=[0.8, 0.4, -0.3, 0.3])
        body.add_geom(type=getattr(mujoco.mjtGeom, f"mjGEOM_{shape}"), size=[0.03, 0.06, 0.05])

    oracle, collisions = Oracle(thing, clearance), Collisions(PANDA, thing, clearance)
    for _ in range(150):
        q = turned(0.8) + rng.uniform(-0.3, 0.3, ARM.n)
        least, found = oracle.least(q), collisions.at(q)
        assert (found is not None) == (least < clearance)
        if found is not None:
            near += 1
            # Of overlaps, MuJoCo is wrong about depths.
            assert found[3] == pytest.approx(least, abs=1e-6) if least > 0.0 else found[3] <= 0.0
    assert 20 < near < 130


@pytest.mark.parametrize("angle", [0.2, 0.45, 0.6])
def test_the_whole_clearance_is_kept_at_every_sample(angle: float) -> None:
    """Past a pole to which some samples only come a little too close."""
    motion = plan_ptp(turned(-0.5), turned(1.0), PANDA.profile, DT)
    tip = ARM.pose(turned(angle)).translation()
    beside = tip + 0.045 * np.array([np.cos(angle), np.sin(angle), 0.0])
    pole = post(beside, 0.002, 0.02)
    oracle = Oracle(pole, 0.02)
    least = min(oracle.least(q) for q in motion.q)
    assert 0.005 < least < 0.02
    assert verdict(Collisions(PANDA, pole, 1.0001 * least), motion) is not None
    assert verdict(Collisions(PANDA, pole, 0.9999 * least), motion) is None


@pytest.mark.parametrize("share", [0.2, 0.35, 0.42, 0.7, 0.8])
def test_what_is_thin_is_not_passed_between_two_looks(share: float) -> None:
    """Two samples and a wire between them: however far they are apart, it is seen."""
    start, goal = turned(-1.0), turned(1.0)
    place = ARM.pose(start + share * (goal - start)).translation()
    wire = post(place, 1e-4, 0.01)
    rest = np.zeros((2, ARM.n))
    jump = Trajectory(dt=1.0, q=np.array([start, goal]), v=rest, a=rest)
    oracle = Oracle(wire)
    ends = [oracle.least(q) for q in jump.q]
    assert min(ends) > 0.005
    error = verdict(Collisions(PANDA, wire, clearance=0.002), jump)
    assert error is not None
    found = error.rejection
    assert found is not None
    assert found.q is not None
    assert "post" in error.explanation
    assert oracle.least(np.array(found.q)) < 0.002
    assert found.time == pytest.approx((found.q[0] - start[0]) / 2.0, abs=1e-9)


def test_where_everything_is_near_the_looks_are_close_and_end() -> None:
    """Along a wall at little more than the clearance."""
    motion = plan_ptp(turned(0.7), turned(1.3), PANDA.profile, DT)

    def floor(height: float) -> Surroundings:
        def add(spec: mujoco.MjSpec) -> None:
            body = spec.worldbody.add_body(name="floor", pos=[0.17, 0.26, height])
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.05, 0.05, 0.01])

        return add

    oracle = Oracle(floor(0.4))
    ground = int(oracle.model.body("floor").geomadr[0])
    near = zip(oracle.pairs, oracle.all(turned(1.0)), strict=True)
    lowest = min(distance for pair, distance in near if ground in pair)
    for clearance in (0.004, 0.0):
        free = Collisions(PANDA, floor(0.4 + lowest - clearance - 0.002), clearance)
        assert verdict(free, motion) is None
        tight = Collisions(PANDA, floor(0.4 + lowest - clearance + 0.002), clearance)
        assert verdict(tight, motion) is not None


def test_the_two_bodies_and_the_joint_are_the_right_ones() -> None:
    """The hand against the wall of a box; the last joint that moves it is named."""
    place = ARM.pose(turned(0.5)).translation()
    error = verdict(
        Collisions(PANDA, post(place, 0.01), 0.005),
        plan_ptp(ARM.home, turned(0.8), PANDA.profile, DT),
    )
    assert error is not None
    found = error.rejection
    assert found is not None
    assert found.q is not None
    oracle = Oracle(post(place, 0.01))
    near = oracle.all(np.array(found.q))
    bodies = [oracle.model.geom_bodyid[g] for g in oracle.pairs[int(np.argmin(near))]]
    names = {oracle.model.body(int(body)).name for body in bodies}
    assert set(error.explanation.split(" come within")[0].split(" and ")) == names
    chain, at = set(), int(max(bodies, key=lambda b: oracle.model.body(int(b)).name != "post"))
    while at:
        chain.add(at)
        at = int(oracle.model.body_parentid[at])
    movers = [name for name in PANDA.joints if int(oracle.model.joint(name).bodyid[0]) in chain]
    assert found.joint == movers[-1]


def test_a_motion_into_itself_is_refused_where_it_is_too_close() -> None:
    folded = np.array([0.0, -1.6, 0.0, -3.05, 0.0, 0.3, 0.0])
    motion = plan_ptp(ARM.home, folded, PANDA.profile, DT)
    error = verdict(Collisions(PANDA, lambda _: None, 0.01), motion)
    oracle = Oracle(lambda _: None)
    assert error is not None
    found = error.rejection
    assert found is not None
    assert found.q is not None
    assert found.time is not None
    assert oracle.least(np.array(found.q)) < 0.01
    before = motion.q[: int(found.time / DT) - 1]
    assert min(oracle.least(q) for q in before[::10]) > 0.005


def test_a_thin_tip_does_not_pass_a_wire_however_far_the_samples_are_apart(tmp_path: Path) -> None:
    robot = gantry(tmp_path, 'type="sphere" size="0.001"')
    start, goal = np.zeros(4), np.array([1.0, 0.0, 0.0, 0.0])
    start[0], rest = -1.0, np.zeros((2, 4))
    jump = Trajectory(dt=1.0, q=np.array([start, goal]), v=rest, a=rest)
    for place in (-0.613, 0.0217, 0.7771):
        wire = post(np.array([place, 0.0, 0.0]), 1e-4)
        robot_away = replace(robot, home=np.array([-1.5, 0.0, 0.0, 0.0]), gripper=None)
        error = verdict(Collisions(robot_away, wire, clearance=0.002), jump)
        assert error is not None
        found = error.rejection
        assert found is not None
        assert found.q is not None
        assert abs(found.q[0] - place) < 0.001 + 1e-4 + 0.002 + 1e-9


def test_open_fingers_are_looked_at_where_they_are() -> None:
    """A wall beside the hand that closed fingers would not come near."""
    tip = ARM.pose(ARM.home)
    beside = tip.translation() + tip.rotation().as_matrix() @ np.array([0.0, 0.066, 0.0])

    def wall(spec: mujoco.MjSpec) -> None:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.005, 0, 0], pos=beside)

    away = replace(PANDA, home=turned(0.5))  # what is near at home is left out
    found = Collisions(away, wall, clearance=0.012).at(ARM.home)
    assert found is not None
    assert "finger" in found[0] + found[1]
