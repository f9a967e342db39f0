import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.model.arm import Arm
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.item import Item
from robo47_qp.tasks.table import add_table
from tests.controlled import DT, LOAD
from tests.runs import no_objects


def held(arm: Arm) -> np.ndarray:
    return arm.inverse_dynamics(arm.home, np.zeros(arm.n), np.zeros(arm.n))


def test_nothing_wrong_is_the_simulation_itself(robot: Robot, rng: np.random.Generator) -> None:
    plain = Simulation(robot, no_objects)
    other = DisturbedSimulation(robot, no_objects, Disturbance(), rng)
    for _ in range(50):
        tau = plain.motor_torque() + rng.uniform(-0.5, 0.5, len(robot.joints))
        plain.step(tau)
        other.step(tau)
    assert plain.state().q.tolist() == other.state().q.tolist()
    assert plain.state().v.tolist() == other.state().v.tolist()


@pytest.mark.parametrize("delay", [1, 5])
def test_a_command_arrives_so_many_periods_later(robot: Robot, delay: int) -> None:
    sim = DisturbedSimulation(robot, no_objects, Disturbance(torque_delay=delay * DT))
    for _ in range(2):
        start, step = sim.motor_torque(), 0.5 * robot.tau_rate_max * DT
        for k in range(delay + 2):
            sim.step(start + step)
            arrived = sim.last_torque() - start
            assert arrived == pytest.approx(step if k >= delay else 0 * step, abs=1e-9)
        sim.reset()


def test_a_torque_that_is_no_number_is_refused_before_it_is_delayed(robot: Robot) -> None:
    sim = DisturbedSimulation(robot, no_objects, Disturbance(torque_delay=2 * DT))
    good = sim.motor_torque()
    with pytest.raises(InvalidValueError, match="commanded torque must be finite"):
        sim.step(good * np.nan)
    assert sim.time == 0.0
    for _ in range(4):
        sim.step(good)


def test_noise_needs_a_generator(robot: Robot) -> None:
    with pytest.raises(InvalidValueError, match="rng must be a numpy Generator"):
        DisturbedSimulation(robot, no_objects, Disturbance(noise_q=1e-3))
    with pytest.raises(InvalidValueError, match="rng must be a numpy Generator"):
        DisturbedSimulation(robot, no_objects, Disturbance(noise_force=0.1))
    for camera in ("pose_noise", "heading_noise", "pose_bias", "rotation_bias", "outliers"):
        with pytest.raises(InvalidValueError, match="rng must be a numpy Generator"):
            DisturbedSimulation(robot, no_objects, Disturbance(**{camera: 0.1}))  # type: ignore[arg-type]


def test_an_unknown_payload_pulls_as_one_that_the_arm_knows(robot: Robot, arm: Arm) -> None:
    sim = DisturbedSimulation(robot, no_objects, Disturbance(payload=LOAD))
    loaded = arm.with_payload(LOAD)
    if robot.gripper is None:
        assert sim.motor_torque() == pytest.approx(held(loaded), abs=1e-6)
    assert sim.motor_torque() - Simulation(robot, no_objects).motor_torque() == pytest.approx(
        held(loaded) - held(arm), abs=1e-6
    )


def test_heavier_links_take_torque_in_proportion(robot: Robot, arm: Arm) -> None:
    torque = {
        factor: DisturbedSimulation(
            robot, no_objects, Disturbance(link_mass_factor=factor, payload=LOAD)
        ).motor_torque()
        for factor in (0.8, 1.0, 1.2)
    }
    brick = held(arm.with_payload(LOAD)) - held(arm)
    for factor in (0.8, 1.2):
        own = torque[1.0] - brick
        assert torque[factor] == pytest.approx(factor * own + brick, abs=1e-6)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"torque_delay": -1}, "torque_delay must be 0 or more and finite: one number, or two in"),
        (
            {"state_delay": (2e-3, 1e-3)},
            "state_delay must be .* two in rising order; found \\(0.002",
        ),
        ({"torque_delay": (1, 2, 3)}, "torque_delay must be .* two in rising order"),
        ({"torque_delay": ()}, "torque_delay must be .* two in rising order"),
        ({"state_delay": "1"}, "state_delay must be .* two in rising order; found '1'"),
        ({"payload": 3}, "payload must be a Payload or None; found 3"),
        ({"pushes": (1,)}, "pushes must be a sequence, each a Push"),
        ({"noise_q": np.nan}, "noise_q must be 0 or more and finite"),
        ({"noise_force": -0.1}, "noise_force must be 0 or more and finite"),
        ({"link_mass_factor": [1.0, 0.0]}, "link_mass_factor must be above 0 and finite"),
        ({"link_com_shift": [0.0, np.nan, 0.0]}, "link_com_shift must be"),
        ({"dry_friction": -0.1}, "dry_friction must be 0 or more and finite"),
        ({"object_mass_factor": 0.0}, "object_mass_factor must be above 0 and finite"),
        ({"friction": -1.0}, "friction must be 0 or more and finite"),
        ({"dropped_frames": 1.0}, "dropped_frames must be at least 0 and below 1"),
        ({"occlusion": 2}, "occlusion must be a whole number, at least 0 and at most 1"),
        ({"pose_noise": np.inf}, "pose_noise must be 0 or more and finite"),
        ({"heading_noise": -1.0}, "heading_noise must be 0 or more and finite"),
        ({"pose_bias": -1.0}, "pose_bias must be 0 or more and finite"),
        ({"camera_rate": 0.0}, "camera_rate must be 0.001 or more and finite"),
    ],
)
def test_another_disturbance_is_refused(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        Disturbance(**setting)  # type: ignore[arg-type]


@pytest.mark.parametrize("factor", [0.8, 1.2])
def test_heavier_links_are_harder_to_turn_in_proportion(robot: Robot, factor: float) -> None:
    matrices, weights = [], []
    for sim in (
        Simulation(robot, no_objects),
        DisturbedSimulation(robot, no_objects, Disturbance(link_mass_factor=factor)),
    ):
        m, M = sim.model, np.zeros((sim.model.nv, sim.model.nv))
        mujoco.mj_fullM(m, sim.data, M)
        matrices.append(M - np.diag(m.dof_armature))
        weights.append(m.body_subtreemass[0])
    assert np.abs(matrices[1] - factor * matrices[0]).max() < 1e-9
    assert weights[1] == pytest.approx(factor * weights[0])


def two_bricks(spec: mujoco.MjSpec) -> None:
    """A table with two loose bricks, and a third that is fixed to it."""
    box = mujoco.mjtGeom.mjGEOM_BOX
    table = spec.worldbody.add_geom(name="table", type=box, pos=[0.5, 0, -0.02], size=[0.3] * 3)
    table.size = [0.3, 0.3, 0.02]
    for name, x in (("left", 0.4), ("right", 0.6), ("fixed", 0.5)):
        brick = spec.worldbody.add_body(name=name, pos=[x, 0.0, 0.02])
        brick.add_geom(name=name, type=box, size=[0.02] * 3, mass=0.2)
        if name != "fixed":
            brick.add_freejoint()


def hold(sim: Simulation, seconds: float) -> None:
    for _ in range(round(seconds / DT)):
        sim.step(sim.motor_torque())


def errors_seen(sim: DisturbedSimulation, name: str, frames: int) -> np.ndarray:
    """What the camera says less the truth: position and turn, (frames, 4)."""
    found = []
    for _ in range(frames):
        truth, seen = sim.object_pose(name), sim.seen_pose(name)
        turn = (seen.rotation() @ truth.rotation().inverse()).log()
        assert turn[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
        found.append([*(seen.translation() - truth.translation()), turn[2]])
        hold(sim, 0.034)
    return np.array(found)


CAMERA = Disturbance(pose_noise=5e-3, heading_noise=0.05, pose_bias=3e-3)


def test_the_camera_takes_thirty_frames_in_a_second_and_holds_each() -> None:
    sim = DisturbedSimulation(PANDA, two_bricks, CAMERA, np.random.default_rng(3))
    seen: list[list[float]] = []
    new: list[int] = []
    for k in range(1000):
        pose = sim.seen_pose("left").wxyz_xyz.tolist()
        if not seen or pose != seen[-1]:
            seen.append(pose)
            new.append(k)
        hold(sim, DT)
    assert len(seen) == 30
    assert new == [-(-k * 100 // 3) for k in range(30)]
    assert sim.noise_figures["pose_noise"] == 5e-3


def test_a_frame_shows_where_things_were_when_it_was_taken() -> None:
    tiny = Disturbance(pose_noise=1e-12)
    sim = DisturbedSimulation(PANDA, two_bricks, tiny, np.random.default_rng(3))
    turned = SE3.from_rotation_and_translation(SO3.from_z_radians(0.3), np.array([0.4, 0, 0.5]))
    sim.place_object("left", turned)
    assert sim.seen_pose("left").as_matrix() == pytest.approx(turned.as_matrix(), abs=1e-9)
    hold(sim, 0.033)
    assert sim.object_pose("left").translation()[2] < 0.496
    assert sim.seen_pose("left").translation()[2] == pytest.approx(0.5)
    hold(sim, DT)
    assert sim.seen_pose("left").translation()[2] == pytest.approx(
        sim.object_pose("left").translation()[2], abs=1e-9
    )
    with pytest.raises(UnknownNameError, match="No object is called 'none'"):
        sim.seen_pose("none")
    with pytest.raises(UnknownNameError, match="No marker is called 'none'"):
        sim.seen_time("none")


def test_what_is_seen_depends_on_seed_and_frame_and_not_on_who_asks() -> None:
    def sim(seed: int) -> DisturbedSimulation:
        return DisturbedSimulation(PANDA, two_bricks, CAMERA, np.random.default_rng(seed))

    curious, lazy, other = sim(1), sim(1), sim(2)
    for _ in range(70):
        curious.seen_pose("right"), curious.state()
        for one in (curious, lazy, other):
            hold(one, DT)
    seen = [one.seen_pose("left").wxyz_xyz.tolist() for one in (curious, lazy, other)]
    assert seen[0] == seen[1] != seen[2]
    lazy.reset()
    again = lazy.seen_pose("left").wxyz_xyz.tolist()
    assert again == sim(1).seen_pose("left").wxyz_xyz.tolist() != seen[1]


def test_a_bias_without_noise_stays(rng: np.random.Generator) -> None:
    sim = DisturbedSimulation(PANDA, two_bricks, Disturbance(pose_bias=5e-3), rng)
    errors = errors_seen(sim, "left", 5)
    # The brick sinks by a part of a µm into the table meanwhile.
    assert np.ptp(errors, axis=0) == pytest.approx(np.zeros(4), abs=1e-6)
    assert np.linalg.norm(errors[0, :3]) > 1e-4


def test_the_truth_is_not_touched_by_the_camera(rng: np.random.Generator) -> None:
    plain = Simulation(PANDA, two_bricks)
    sim = DisturbedSimulation(PANDA, two_bricks, CAMERA, rng)
    for one in (plain, sim):
        hold(one, 0.1)
    assert sim.data.qpos.tolist() == plain.data.qpos.tolist()
    assert sim.object_pose("left").wxyz_xyz.tolist() == plain.object_pose("left").wxyz_xyz.tolist()
    assert plain.seen_pose("left").wxyz_xyz.tolist() == plain.object_pose("left").wxyz_xyz.tolist()


def test_without_a_camera_that_errs_things_are_seen_as_they_are() -> None:
    sim = DisturbedSimulation(PANDA, two_bricks, Disturbance(), np.random.default_rng(0))
    sim.place_object("left", SE3.from_translation(np.array([0.4, 0.0, 0.5])))
    hold(sim, 0.05)
    assert sim.seen_pose("left").wxyz_xyz.tolist() == sim.object_pose("left").wxyz_xyz.tolist()


def test_only_what_moves_freely_gets_heavier() -> None:
    plain = Simulation(PANDA, two_bricks).model
    heavy = DisturbedSimulation(PANDA, two_bricks, Disturbance(object_mass_factor=1.3)).model
    for i in range(plain.nbody):
        factor = 1.3 if plain.body(i).name in ("left", "right") else 1.0
        assert heavy.body_mass[i] == pytest.approx(factor * plain.body_mass[i])
        assert heavy.body_inertia[i] == pytest.approx(factor * plain.body_inertia[i])
    assert heavy.body_subtreemass[0] == pytest.approx(plain.body_subtreemass[0] + 0.3 * 0.4)


@pytest.mark.parametrize(("friction", "slides"), [(0.8, True), (1.1, False)])
def test_friction_decides_what_slides(friction: float, slides: bool) -> None:
    """On a slope of tan 0.95."""
    sim = DisturbedSimulation(PANDA, two_bricks, Disturbance(friction=friction))
    sim.set_friction("right", 2.0 - friction)
    sim.model.opt.gravity[:] = [0.95 * 5.0, 0.0, -5.0]
    start = sim.object_pose("right").translation()[0]
    hold(sim, 0.2)
    assert bool(sim.object_pose("right").translation()[0] - start > 0.01) is slides


def test_each_object_has_its_own_mass() -> None:
    wrong = Disturbance(object_mass_factor=[0.7, 1.3, 9.0])
    sim = DisturbedSimulation(PANDA, two_bricks, wrong)
    masses = [sim.model.body(name).mass[0] for name in sim.objects]
    assert masses == pytest.approx([0.7 * 0.2, 1.3 * 0.2])
    assert np.shape(sim.disturbance.object_mass_factor) == (2,)


@pytest.mark.parametrize(("asked", "tips"), [(0.008, False), (0.012, True)])
def test_a_brick_tips_over_an_edge_once_its_centre_of_mass_is_beyond(
    asked: float, tips: bool
) -> None:
    """It lies with 30 of its 40 mm on the table: 10 mm from its middle to the edge."""
    wrong = Disturbance(object_com_shift=[asked, 0.0, 0.0])
    sim = DisturbedSimulation(PANDA, two_bricks, wrong)
    sim.place_object("right", SE3.from_translation(np.array([0.79, 0.0, 0.02])))
    hold(sim, 0.4)
    assert bool(sim.object_pose("right").translation()[2] < 0.015) is tips


def test_a_centre_of_mass_stays_inside() -> None:
    wrong = Disturbance(object_com_shift=[0.5, -0.01, 0.0])
    model = DisturbedSimulation(PANDA, two_bricks, wrong).model
    assert model.body("left").ipos == pytest.approx([0.014, -0.01, 0.0])


@pytest.mark.parametrize("round_", [False, True])
@pytest.mark.parametrize("shift", [(0.01, 0.01), (0.01, -0.004), (-0.02, -0.02)])
def test_what_stands_does_not_fall_over_by_itself(round_: bool, shift: tuple[float, float]) -> None:
    """Its data sheet has its centre of mass off the middle, and the world has it further out."""
    size = (0.032, 0.032, 0.07)
    item = Item(name="it", size=size, round=round_, mass=0.3, com=(0.004, 0.003, 0.005))

    def scene(spec: mujoco.MjSpec) -> None:
        add_table(spec)
        item.add(spec, (0.5, 0.1, 0.035))

    sim = DisturbedSimulation(PANDA, scene, Disturbance(object_com_shift=(*shift, 0.01)))
    found = sim.model.body("it").ipos
    assert np.sign(found[:2] - item.com[:2]).tolist() == np.sign(shift).tolist()
    assert found[2] == pytest.approx(0.015)
    hold(sim, 0.4)
    assert sim.object_pose("it").rotation().as_matrix()[2, 2] > np.cos(np.radians(1.5))


@pytest.mark.parametrize("factor", [0.8, 1.1])
def test_an_object_of_another_size_stands_where_it_stood_with_its_mass(factor: float) -> None:
    sim = DisturbedSimulation(PANDA, two_bricks, Disturbance(object_size_factor=factor))
    plain = Simulation(PANDA, two_bricks)
    brick, was = sim.model.geom("left"), plain.model.geom("left")
    assert brick.size == pytest.approx(factor * was.size)
    assert sim.model.body("left").mass[0] == pytest.approx(0.2)
    assert sim.model.body("left").inertia == pytest.approx(
        factor**2 * plain.model.body("left").inertia
    )
    assert sim.object_pose("left").translation()[2] == pytest.approx(0.02 * factor)
    tilted = SO3.from_x_radians(0.3)
    low = 0.02 * (np.cos(0.3) + np.sin(0.3))
    pose = SE3.from_rotation_and_translation(tilted, np.array([0.4, 0.0, low]))
    sim.place_object("left", pose)
    assert sim.object_pose("left").translation()[2] == pytest.approx(factor * low)
    sim.reset()
    hold(sim, 0.05)
    assert sim.object_pose("left").translation()[2] == pytest.approx(0.02 * factor, abs=2e-4)


def gripped(spec: mujoco.MjSpec) -> None:
    """A brick that is placed between the fingers, one beside, and a goal."""
    two_bricks(spec)
    next(body for body in spec.bodies if body.name == "left").gravcomp = 1.0
    goal = spec.worldbody.add_body(name="goal", mocap=True, pos=[0.5, 0.2, 0.0])
    goal.add_geom(size=[0.01, 0.0, 0.0], contype=0, conaffinity=0)


def test_what_the_fingers_hold_is_hidden_and_what_lies_there_is_seen() -> None:
    sim = DisturbedSimulation(PANDA, gripped, Disturbance(occlusion=1))
    sim.place_object("left", sim.tool_pose())
    assert sim.seen_pose("left").as_matrix() == pytest.approx(sim.tool_pose().as_matrix())
    sim.command_grip(Grip(width=0.0, force=20.0))
    hold(sim, 0.5)
    since, moved = sim.seen_time("left"), sim.seen_time("right")
    assert since < 0.42
    assert moved == pytest.approx(0.5, abs=0.034)
    hold(sim, 0.2)
    assert sim.seen_time("left") == since
    sim.command_grip(Grip(width=0.08, force=20.0))
    hold(sim, 0.5)
    assert sim.seen_time("left") > 0.9


def test_goals_are_seen_with_the_error_of_all_things_and_poses_asked_for_are_exact() -> None:
    wrong = Disturbance(pose_bias=0.01, rotation_bias=0.02)
    seeing, asked = (
        DisturbedSimulation(
            PANDA, gripped, wrong, np.random.default_rng(4), goals_asked_for=is_asked
        )
        for is_asked in (False, True)
    )
    goal, brick = seeing.marker_pose("goal"), seeing.object_pose("left")
    between = goal.inverse() @ brick
    seen = seeing.seen_marker("goal").inverse() @ seeing.seen_pose("left")
    assert seen.as_matrix() == pytest.approx(between.as_matrix(), abs=1e-9)
    off = seeing.seen_marker("goal").translation() - goal.translation()
    assert np.linalg.norm(off) > 1e-3
    assert asked.seen_marker("goal").wxyz_xyz.tolist() == goal.wxyz_xyz.tolist()
    moved = SE3.from_translation(np.array([0.01, 0.0, 0.0])) @ goal
    seeing.place_marker("goal", moved)
    assert seeing.seen_marker("goal").translation() - goal.translation() == pytest.approx(
        off + np.array([0.01, 0.0, 0.0]), abs=1e-3
    )
