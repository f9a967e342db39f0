import mujoco
import numpy as np
import pytest

from robo47_qp.arm import Arm
from robo47_qp.errors import Obstacle, PlanError
from robo47_qp.motion.collisions import Collisions
from robo47_qp.motion.ptp import plan_ptp
from robo47_qp.robots.panda import PANDA

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
    assert found.obstacle is Obstacle.COLLISION
    assert found.segment == "swing"
    assert found.joint in PANDA.joints
    assert found.time is not None
    assert found.q is not None
    k = round(found.time / DT)
    assert swing.q[k].tolist() == list(found.q)
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
