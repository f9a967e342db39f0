"""What every robot can do, whoever wrote its file: be simulated, held, moved, recorded."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import mujoco
import numpy as np
import pytest
import rerun as rr

from robo47_qp.control.joint_impedance import JointImpedance
from robo47_qp.errors import InvalidValueError, NoGripperError
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.metrics import metrics
from robo47_qp.report.rerun.log import RerunLog
from robo47_qp.report.run_plot import plot_run
from robo47_qp.run.runner import Runner
from robo47_qp.run.task import Program
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.plain_arm import PlainArm
from tests.robots import MAKERS, MODELS, robot_named, robot_or_skip
from tests.runs import Reach, no_objects

DT = 1e-3


@pytest.fixture(scope="module")
def world(robot: Robot) -> Simulation:
    return Simulation(robot, no_objects)


@pytest.mark.parametrize("name", MAKERS)
def test_every_robot_is_tested(name: str) -> None:
    """Tests on a robot whose model is missing are left out; this one is skipped and says why."""
    assert robot_or_skip(name).joints


def test_the_tool_is_where_the_untouched_file_has_it(
    plain: PlainArm, arm: Arm, world: Simulation, rng: np.random.Generator
) -> None:
    for q in (arm.home, *rng.uniform(arm.q_min, arm.q_max, (20, arm.n))):
        position, R = plain.tool(q)
        T = arm.pose(q)
        np.testing.assert_allclose(T.translation(), position, atol=1e-12)
        np.testing.assert_allclose(T.rotation().as_matrix(), R, atol=1e-12)
    world.reset()
    position, R = plain.tool(arm.home)
    np.testing.assert_allclose(world.tool_pose().translation(), position, atol=1e-12)


def test_the_jacobian_is_that_of_the_untouched_file(
    plain: PlainArm, arm: Arm, rng: np.random.Generator
) -> None:
    for q in rng.uniform(arm.q_min, arm.q_max, (10, arm.n)):
        np.testing.assert_allclose(arm.jacobian(q), plain.jacobian(q), atol=1e-7)


def test_nothing_but_torque_motors_moves_the_joints(robot: Robot, world: Simulation) -> None:
    m = world.model
    grip = 0 if robot.gripper is None else 1
    assert m.nu == len(robot.joints) + grip
    for joint, name, limit in zip(robot.joints, robot.motors, robot.tau_max, strict=True):
        motor = m.actuator(name)
        assert m.joint(int(motor.trnid[0])).name == joint
        assert motor.gainprm[0] * motor.gear[0] == 1.0
        assert not motor.biasprm.any()
        assert motor.dyntype == mujoco.mjtDyn.mjDYN_NONE
        assert motor.forcerange.tolist() == [-limit, limit]


def test_a_torque_arrives_at_its_joint(robot: Robot, world: Simulation) -> None:
    world.reset()
    before = world.last_torque()
    step = 0.5 * robot.tau_rate_max * DT * np.where(np.arange(len(before)) % 2, -1.0, 1.0)
    hold = np.clip(world.data.qfrc_bias[: len(before)], -robot.tau_max, robot.tau_max)
    world.step(hold + step)
    np.testing.assert_allclose(world.last_torque(), hold + step, atol=1e-9)


def test_home_is_free_of_contacts_and_inside_the_limits(
    robot: Robot, arm: Arm, world: Simulation
) -> None:
    world.reset()
    assert world.data.ncon == 0
    assert arm.limit_margin(robot.home) > 0.0


def test_gravity_compensation_holds_the_arm(robot: Robot, arm: Arm, world: Simulation) -> None:
    world.reset()
    still = np.zeros(arm.n)
    for _ in range(500):
        world.step(arm.inverse_dynamics(world.state().q, still, still))
    assert np.abs(world.state().q - robot.home).max() < 1e-6
    # Without it the arm falls, unless dry friction holds it.
    if not world.model.dof_frictionloss.any():
        for _ in range(500):
            world.step(still)
        assert np.abs(world.state().q - robot.home).max() > 1e-2


def test_joint_impedance_brings_a_displaced_arm_home(
    robot: Robot, arm: Arm, world: Simulation
) -> None:
    world.reset()
    controller, still = JointImpedance(), np.zeros(arm.n)
    world.data.qpos[: arm.n] += 0.02
    mujoco.mj_step1(world.model, world.data)
    for _ in range(2500):
        state = world.state()
        world.step(controller.torque(arm, JointReference(robot.home, still, still), state))
    # Dry friction keeps what the spring cannot move.
    stuck = 1.05 * world.model.dof_frictionloss[: arm.n] / robot.stiffness
    assert (np.abs(world.state().q - robot.home) < 1e-3 + stuck).all()
    assert np.abs(world.state().v).max() < 1e-2


def test_joint_impedance_tracks_motions_all_over_the_workspace(
    robot: Robot, arm: Arm, world: Simulation, rng: np.random.Generator
) -> None:
    world.reset()
    controller, q = JointImpedance(), robot.home
    worst = np.zeros(arm.n)
    for _ in range(3):
        spread = arm.q_min + rng.uniform(0.15, 0.85, arm.n) * (arm.q_max - arm.q_min)
        goal = robot.home + np.clip(spread - robot.home, -0.8, 0.8)
        way = plan_ptp(q, goal, robot.profile, DT)
        for q_ref, v_ref, a_ref in zip(way.q, way.v, way.a, strict=True):
            state = world.state()
            worst = np.maximum(worst, np.abs(state.q - q_ref))
            tau = controller.torque(arm, JointReference(q_ref, v_ref, a_ref), state)
            assert (np.abs(tau) <= robot.tau_max).all()
            world.step(tau)
        q = goal
    stuck = 1.1 * world.model.dof_frictionloss[: arm.n] / robot.stiffness
    assert (worst < 1e-3 + stuck).all()


def test_every_reachable_target_is_reached(arm: Arm, plain: PlainArm) -> None:
    rng, solver = np.random.default_rng(5), MultiStart(solver=QpIk(max_iterations=30))
    for q in rng.uniform(arm.q_min, arm.q_max, (200, arm.n)):
        target = arm.pose(q)
        result = solver.solve(arm, target, arm.home)
        assert result.converged, result.explanation
        position, angle = plain.errors(result.q, target)
        assert position < 1.1e-6
        assert angle < 1.1e-6
        assert plain.inside(result.q)


def test_a_job_without_grips_runs_and_is_recorded(robot: Robot, tmp_path: Path) -> None:
    task = Reach()
    scenario = ClassicalStack().scenario(robot, task)
    simulation = Simulation(robot, task.build_scene)
    runner = Runner(scenario, simulation)
    path = tmp_path / "run.rrd"
    log = RerunLog(path, simulation.model, robot, runner.signals)
    run = runner.run(sinks=[log])
    log.finish("done")
    log.close()
    assert run.failure is None
    assert metrics(run)["max_joint_error_rad"] < 0.03
    findings = audit(run)
    unkept = [finding for finding in findings if not finding.ok]
    friction = simulation.model.dof_frictionloss.any()
    assert {finding.signal for finding in unkept} <= (
        {"LIN measured (tool)"} if friction else set()
    )
    for finding in findings:
        joint = finding.signal.rpartition("(")[2].rstrip(")")
        if joint in robot.joints:
            slides = joint in robot.slides
            assert finding.unit.startswith(("m", "N") if slides else ("rad", "N·m"))
            assert "N·m" not in finding.unit or not slides
    names = {signal.name.split("/")[0] for signal in runner.signals}
    assert ("gripper" in names) == (robot.gripper is not None)
    plot_run(run, tmp_path / "run.png")
    entities = {chunk.entity_path for chunk in rr.chunk.RrdReader(path).stream().to_chunks()}
    assert "/signals" in entities


def test_springs_in_the_joints_are_held_from_the_start(tmp_path: Path) -> None:
    path = tmp_path / "springs.xml"
    text = (MODELS / "hinge6.xml").read_text()
    path.write_text(text.replace('name="shoulder"', 'name="shoulder" stiffness="30"'))
    robot = replace(robot_named("hinge6"), mjcf=path)
    simulation, arm, still = Simulation(robot, no_objects), Arm(robot), np.zeros(6)
    held = arm.inverse_dynamics(robot.home, still, still)
    assert (
        abs(held[1] - Arm(robot_named("hinge6")).inverse_dynamics(robot.home, still, still)[1]) > 5
    )
    np.testing.assert_allclose(simulation.data.ctrl, held, atol=1e-9)


BARE = replace(PANDA, name="bare", gripper=None)


@dataclass(frozen=True, kw_only=True)
class Snatch(Reach):
    """A grip that nobody foresees."""

    def program(self, sensed: Sensed) -> Program:
        up = self.preview(sensed)[0]
        yield replace(up, grip=Grip(width=0.0, force=1.0))
        return None


def test_a_robot_without_its_gripper_has_welded_fingers() -> None:
    simulation = Simulation(BARE, no_objects)
    assert simulation.model.njnt == len(BARE.joints)
    assert simulation.model.nu == len(BARE.joints)


@pytest.mark.parametrize("name", ["width", "width_speed", "width_command", "grip_settled"])
def test_what_only_a_gripper_tells_is_refused_without_one(name: str) -> None:
    simulation = Simulation(BARE, no_objects)
    with pytest.raises(NoGripperError, match=r"Robot 'bare' has no gripper, and .* needs one"):
        getattr(simulation, name)()
    with pytest.raises(NoGripperError, match="the force of its fingers needs one"):
        simulation.last_finger_forces()
    with pytest.raises(NoGripperError, match="a grip needs one"):
        simulation.command_grip(Grip(width=0.0, force=1.0))


@dataclass(frozen=True, kw_only=True)
class Careless(PickPlace):
    """Does not tell that it needs a gripper."""

    opening_needed: ClassVar[float | None] = None


def test_a_task_with_grips_is_refused_before_anything_moves() -> None:
    with pytest.raises(InvalidValueError, match="found bare, without a gripper"):
        ClassicalStack().scenario(BARE, PickPlace())
    task = Careless()
    simulation = Simulation(BARE, task.build_scene)
    runner = Runner(ClassicalStack().scenario(BARE, task), simulation)
    with pytest.raises(NoGripperError, match="Choose a robot with a gripper"):
        runner.rehearse()
    assert simulation.time == 0.0


def test_a_grip_that_was_not_foreseen_is_refused_when_it_comes() -> None:
    task = Snatch()
    simulation = Simulation(BARE, task.build_scene)
    runner = Runner(ClassicalStack().scenario(BARE, task), simulation)
    with pytest.raises(NoGripperError, match="needs one"):
        runner.run()


def test_a_limit_of_a_slide_is_told_in_metres() -> None:
    robot = robot_named("slider6")
    assert robot.units == ("m", "m", "rad", "rad", "rad", "rad")
    assert robot.unit("rad", "m") == "rad or m"
    assert PANDA.unit("rad", "m") == "rad"
    assert replace(robot, slides=robot.joints).unit("rad", "m") == "m"


def test_signals_and_findings_of_slides_have_their_own_units() -> None:
    robot, task = robot_named("slider6"), Reach()
    runner = Runner(ClassicalStack().scenario(robot, task), Simulation(robot, task.build_scene))
    units = {signal.name: signal.unit for signal in runner.signals}
    assert units["joints/q_ref"] == units["joints/q"] == units["errors/q"] == "rad or m"
    assert units["joints/v_ref"] == units["joints/v"] == "rad/s or m/s"
    assert units["joints/a_ref"] == units["joints/a"] == "rad/s² or m/s²"
    assert units["joints/tau"] == units["joints/tau_command"] == "N·m or N"
    run = runner.run()
    run.rows["joints/v"][7, 3] = run.rows["joints/tau_command"][7, 3] = 99.0
    run.rows["joints/a_ref"][7, 0] = 99.0
    found = {finding.signal: finding.unit for finding in audit(run) if not finding.ok}
    assert found["measured v (yaw)"] == "rad/s"
    assert found["torque (yaw)"] == "N·m"
    assert found["torque rate (yaw)"] == "N·m/s"
    assert found["reference a (rail)"] == "m/s²"
    assert found["reference jerk (rail)"] == "m/s³"


def test_the_bound_on_the_reach_behind_slides_is_kept_and_no_longer_than_the_links() -> None:
    arm = Arm(robot_named("slider6"))
    rng, base = np.random.default_rng(4), np.array([0.0, 0.0, 0.1])
    far = max(
        float(np.linalg.norm(arm.pose(q).translation() - base))
        for q in rng.uniform(arm.q_min, arm.q_max, (3000, arm.n))
    )
    # By hand from the file: rail and the lift's foot, lift and the beam's foot, beam, wrist, tool.
    tool = float(np.linalg.norm([0.01, -0.02, 0.13]))
    longest = np.hypot(0.6, 0.15) + (0.7 + 0.05) + 0.4 + 0.06 + tool
    away = np.array([100.0, 0.0, 0.1])
    assert 100.0 - arm.beyond_reach(away) == pytest.approx(longest, abs=1e-9)
    assert far < longest
