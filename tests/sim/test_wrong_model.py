"""Wrong masses and friction against statics and energies summed body by body."""

import mujoco
import numpy as np
import pytest
from numpy.typing import ArrayLike

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.mjcf import robot_spec
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots import load_robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.sim.wrong_model import change_joints
from tests.runs import no_objects

G = 9.81


def drawn(robot: Robot, rng: np.random.Generator) -> tuple[Simulation, Disturbance]:
    """A world as modelled, and errors for every link."""
    plain = Simulation(robot, no_objects)
    bodies = plain.model.nbody - 1
    return plain, Disturbance(
        link_mass_factor=rng.uniform(0.9, 1.1, bodies),
        link_inertia_factor=rng.uniform(0.8, 1.2, bodies),
        link_com_shift=rng.uniform(-0.02, 0.02, (bodies, 3)),
    )


def state(sim: Simulation, rng: np.random.Generator) -> None:
    """Somewhere, at rest."""
    lower, upper = sim.model.jnt_range.T
    sim.data.qpos[:] = lower + (upper - lower) * rng.uniform(0.2, 0.8, sim.model.nq)
    sim.data.qvel[:] = 0.0
    mujoco.mj_forward(sim.model, sim.data)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"link_com_shift": (0.1, 0.2)}, "3 numbers, or 3 numbers for each of 11; found shape .2"),
        ({"link_com_shift": 0.01}, "3 numbers, or 3 numbers for each of 11; found shape \\(\\)"),
        ({"link_com_shift": np.zeros((2, 11, 3))}, "3 numbers for each of 11; found shape .2, 11"),
        ({"object_com_shift": np.zeros(6)}, "3 numbers, or 3 numbers for each of 0; found sha"),
        ({"link_mass_factor": np.ones((20, 2))}, "a number, or a number for each of 11; found sh"),
        ({"dry_friction": np.ones((7, 1))}, "a number, or a number for each of 7; found shape .7"),
    ],
)
def test_numbers_of_another_shape_are_refused(setting: dict[str, ArrayLike], message: str) -> None:
    (name,) = setting
    with pytest.raises(InvalidValueError, match=f"{name} must be .*{message}"):
        DisturbedSimulation(PANDA, no_objects, Disturbance(**setting))  # type: ignore[arg-type]


def test_every_link_has_its_own_mass(robot: Robot, rng: np.random.Generator) -> None:
    plain, wrong = drawn(robot, rng)
    heavy = DisturbedSimulation(robot, no_objects, wrong).model
    factor = np.asarray(wrong.link_mass_factor)
    assert heavy.body_mass[1:] == pytest.approx(factor * plain.model.body_mass[1:])
    assert np.std(factor) > 0.01


def test_wrong_links_are_held_by_the_slope_of_their_potential_energy(
    robot: Robot, rng: np.random.Generator
) -> None:
    plain, wrong = drawn(robot, rng)
    sim = DisturbedSimulation(robot, no_objects, wrong)
    m, d = plain.model, plain.data
    mass = m.body_mass[1:] * np.asarray(wrong.link_mass_factor)

    def energy(q: np.ndarray) -> float:
        d.qpos[:] = q
        mujoco.mj_kinematics(m, d)
        R = d.xmat[1:].reshape(-1, 3, 3)
        com = (
            d.xpos[1:]
            + (R @ (m.body_ipos[1:] + np.asarray(wrong.link_com_shift))[..., None])[..., 0]
        )
        return float(G * mass @ com[:, 2])

    state(sim, rng)
    q, h = sim.data.qpos.copy(), 1e-5
    slope = [(energy(q + h * e) - energy(q - h * e)) / (2 * h) for e in np.eye(len(q))]
    assert sim.data.qfrc_bias == pytest.approx(slope, abs=1e-6)
    state_of_plain = Simulation(robot, no_objects)
    state_of_plain.data.qpos[:] = q
    mujoco.mj_forward(state_of_plain.model, state_of_plain.data)
    assert np.abs(state_of_plain.data.qfrc_bias - slope).max() > 1e-3


def test_wrong_links_have_the_kinetic_energy_of_their_parts(
    robot: Robot, rng: np.random.Generator
) -> None:
    plain, wrong = drawn(robot, rng)
    sim = DisturbedSimulation(robot, no_objects, wrong)
    state(sim, rng)
    m, d = plain.model, plain.data
    d.qpos[:] = sim.data.qpos
    mujoco.mj_forward(m, d)
    M = np.diag(m.dof_armature.copy())
    for i, (mass, inertia, shift) in enumerate(
        zip(
            np.asarray(wrong.link_mass_factor),
            np.asarray(wrong.link_inertia_factor),
            np.asarray(wrong.link_com_shift),
            strict=True,
        ),
        start=1,
    ):
        Jp, Jr = np.zeros((3, m.nv)), np.zeros((3, m.nv))
        com = d.xpos[i] + d.xmat[i].reshape(3, 3) @ (m.body_ipos[i] + shift)
        mujoco.mj_jac(m, d, Jp, Jr, com, i)
        R = d.ximat[i].reshape(3, 3)
        moments = R @ np.diag(mass * inertia * m.body_inertia[i]) @ R.T
        M += mass * m.body_mass[i] * Jp.T @ Jp + Jr.T @ moments @ Jr
    found = np.zeros((m.nv, m.nv))
    mujoco.mj_fullM(sim.model, sim.data, found)
    assert found == pytest.approx(M, abs=1e-9)


def test_dry_friction_holds_up_to_its_size_and_brakes_by_it_beyond() -> None:
    friction = np.array([0.5, 0.4, 0.6, 0.3, 0.2, 0.25, 0.1])
    wrong = Disturbance(dry_friction=friction, wrist_friction=0.5)
    expected = friction * [1, 1, 1, 1, 0.5, 0.5, 0.5]
    for joint in range(7):
        for share, moves in ((0.9, False), (2.0, True)):
            sim = DisturbedSimulation(PANDA, no_objects, wrong)
            sim.model.opt.gravity[:] = 0.0
            sim.model.dof_damping[:] = 0.0
            sim.reset()
            tau = np.zeros(7)
            tau[joint] = share * expected[joint]
            for _ in range(20):
                sim.step(tau)
            assert bool(abs(sim.true_state().v[joint]) > 2e-3) is moves, (joint, share)
            if moves:
                braking = sim.data.qfrc_constraint[joint]
                assert braking == pytest.approx(-expected[joint], rel=0.02)


def test_friction_and_inertia_of_the_drives_are_those_asked_for(rng: np.random.Generator) -> None:
    damping, armature = rng.uniform(0.7, 1.3, 7), rng.uniform(0.8, 1.2, 7)
    wrong = Disturbance(damping_factor=damping, armature_factor=armature)
    sim, plain = DisturbedSimulation(PANDA, no_objects, wrong), Simulation(PANDA, no_objects)
    v = rng.uniform(-1, 1, 7)
    matrices = []
    for one in (sim, plain):
        one.data.qvel[:7] = v
        mujoco.mj_forward(one.model, one.data)
        matrices.append(np.zeros((one.model.nv, one.model.nv)))
        mujoco.mj_fullM(one.model, one.data, matrices[-1])
    passive = sim.data.qfrc_passive[:7], plain.data.qfrc_passive[:7]
    assert passive[0] == pytest.approx(damping * passive[1])
    more = np.zeros(plain.model.nv)
    more[:7] = 0.1 * (armature - 1.0)
    assert matrices[0] - matrices[1] == pytest.approx(np.diag(more), abs=1e-12)
    assert sim.model.dof_armature[7:].tolist() == plain.model.dof_armature[7:].tolist()


def test_the_wrist_of_each_arm_has_its_share() -> None:
    pair = load_robot("panda_pair")
    spec = robot_spec(pair)
    errors = np.tile([0.5, 1.0, 1.0], (14, 1))
    change_joints(spec, spec.compile(), pair.joints, errors, 0.6)
    model = spec.compile()
    friction = [model.joint(name).frictionloss[0] for name in pair.joints]
    assert friction == pytest.approx(2 * ([0.5] * 4 + [0.3] * 3))


def test_what_slides_gets_no_friction_of_hinges_and_is_none_of_the_first_four() -> None:
    rail = load_robot("panda_rail")
    wrong = Disturbance(dry_friction=0.5, damping_factor=2.0)
    worlds = Simulation(rail, no_objects), DisturbedSimulation(rail, no_objects, wrong)
    plain, model = (world.model for world in worlds)
    more = [
        model.joint(name).frictionloss[0] - plain.joint(name).frictionloss[0]
        for name in rail.joints
    ]
    assert more == pytest.approx([0.0] + [0.5] * 4 + [0.3] * 3)
    damping = [m.joint(rail.joints[0]).damping[0] for m in (plain, model)]
    assert damping[1] == 2.0 * damping[0]


def test_a_constant_error_of_links_and_friction_is_one_number() -> None:
    one = DisturbedSimulation(PANDA, no_objects, Disturbance(link_mass_factor=1.05))
    plain = Simulation(PANDA, no_objects)
    assert one.model.body_mass == pytest.approx(1.05 * plain.model.body_mass)
    assert one.model.body_inertia == pytest.approx(1.05 * plain.model.body_inertia)
    assert one.disturbance.link_mass_factor == 1.05


def test_numbers_beyond_the_robot_are_left_out_and_too_few_are_refused() -> None:
    many = Disturbance(link_mass_factor=np.linspace(1, 2, 64), dry_friction=np.ones(32))
    left = DisturbedSimulation(PANDA, no_objects, many).disturbance
    assert np.shape(left.link_mass_factor) == (11,)
    assert np.shape(left.dry_friction) == (7,)
    with pytest.raises(InvalidValueError, match="dry_friction must be one for all, or 7 or more;"):
        DisturbedSimulation(PANDA, no_objects, Disturbance(dry_friction=[0.1, 0.2]))
    few = Disturbance(link_com_shift=np.zeros((2, 3)))
    with pytest.raises(InvalidValueError, match="link_com_shift must be one for all, or 11 or"):
        DisturbedSimulation(PANDA, no_objects, few)


def test_a_world_without_errors_of_its_bodies_is_compiled_as_modelled() -> None:
    plain, same = (
        Simulation(PANDA, no_objects),
        DisturbedSimulation(PANDA, no_objects, Disturbance(noise_q=1e-4), np.random.default_rng(1)),
    )
    for name in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_invweight0"):
        assert np.array_equal(getattr(plain.model, name), getattr(same.model, name))
    tau = plain.motor_torque() + 0.3
    for _ in range(20):
        plain.step(tau)
        same.step(tau)
    assert plain.true_state().q.tolist() == same.true_state().q.tolist()
