"""Peg and hole: their contacts are those of steel that comes to rest."""

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.peg_insert.peg import DEPTH, DIAMETER, LENGTH, add_block, set_exact_contacts
from robo47_qp.tasks.peg_insert.peg_insert import PegInsert


def test_a_peg_that_wobbles_in_the_hole_comes_to_rest() -> None:
    """However it was let go: a verdict asks for 1 mm/s and 0.02 rad/s."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.cone = 1e-3, mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 100.0
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    set_exact_contacts(spec)
    turned = SO3.exp(np.array([0.02, -0.015, 0.7]))
    add_block(spec.worldbody.add_body(name="hole", quat=turned.wxyz))
    in_hole = turned.apply(np.array([0.0, 0.0, 0.5 * LENGTH - DEPTH]))
    PegInsert().peg.add(spec, tuple(in_hole))
    model, rng = spec.compile(), np.random.default_rng(0)
    for _ in range(6):
        data = mujoco.MjData(model)
        data.qpos[3:] = turned.wxyz
        data.qvel[:] = [*rng.normal(scale=5e-3, size=3), *rng.normal(scale=0.3, size=3)]
        mujoco.mj_step(model, data, 1500)
        assert np.linalg.norm(data.qvel[:3]) < 1e-4
        assert np.linalg.norm(data.qvel[3:]) < 1e-3


def test_a_peg_that_lies_on_the_block_meets_no_wall_sideways() -> None:
    """Poses near the edge of the hole, up to 3 µm deep: what is deeper is no contact of theirs."""
    simulation = Simulation(PANDA, PegInsert().build_scene)
    rng, hole = np.random.default_rng(0), np.array([0.48, -0.10, 0.04])
    simulation.place_marker("hole", SE3.from_translation(hole))
    model, data = simulation.model, simulation.data
    walls = {model.geom(f"wall{i}").id for i in range(16)} | {model.geom("peg").id}
    met = 0
    for _ in range(3000):
        tilt = SO3.exp(np.array([*rng.normal(scale=2e-3, size=2), rng.uniform(-3.0, 3.0)]))
        z = tilt.as_matrix()[2]
        lowest = -0.5 * LENGTH * z[2] - 0.5 * DIAMETER * float(np.hypot(z[0], z[1]))
        aside = [*rng.uniform(-4e-3, 4e-3, 2), -lowest - rng.uniform(0.0, 3e-6)]
        simulation.place_object("peg", SE3.from_rotation_and_translation(tilt, hole + aside))
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        for geoms, depth in zip(data.contact.geom, -data.contact.dist, strict=True):
            if set(geoms.tolist()) <= walls:
                met += 1
                assert depth < 4e-6
    assert met > 3000


def test_a_peg_that_grazes_a_wall_is_not_deep_in_it() -> None:
    """It lies on two walls, 11 µm deep; with a tolerance of 1e-8, it was 16 mm deep in a third."""
    spec = mujoco.MjSpec()
    set_exact_contacts(spec)
    at = [0.44761403288639456, -0.13167394623786086, 0.04]
    add_block(
        spec.worldbody.add_body(
            name="hole", pos=at, quat=[0.7394698150875453, 0.0, 0.0, 0.673189715143058]
        )
    )
    PegInsert().peg.add(spec, (0.0, 0.0, 0.0))
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:3] = [0.42888750998296205, -0.13986221075164518, 0.07029564084271667]
    data.qpos[3:] = [
        0.99796240028122,
        0.01065535821153255,
        0.01207753818351176,
        0.06173851340740601,
    ]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    assert 1e-5 < -data.contact.dist.min() < 1.2e-5
