"""The runner: every row at its instant, every phase in its place, nothing moved by a rehearsal."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import PlanError, RecordingError
from robo47_qp.model.arm import JOINT_MARGIN, Arm, JointReference
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import Motion, Place
from robo47_qp.run.control_loop import TICK_ROWS
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.recording import CHUNK_ROWS, Rows
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.steps import Step, StepExecutor
from robo47_qp.run.task import Program
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.run.witnesses import Eyewitness, Keeper, ends
from tests.runs import Reach, Witness, carry_out, make_runner, no_objects, picked_and_placed

PHASES = [
    "approach",
    "descend",
    "close gripper",
    "lift",
    "carry",
    "lower",
    "release",
    "retreat",
    "home",
    "end",
]


def test_phases_come_in_order_and_cover_all_rows() -> None:
    run = picked_and_placed()
    assert [phase.name for phase in run.phases] == PHASES
    starts = [phase.start for phase in run.phases]
    assert starts[0] == 0
    assert starts == sorted(set(starts))
    index = run.rows["phase"][:, 0]
    for i, (start, end) in enumerate(zip(starts, ends(run), strict=True)):
        assert (index[start:end] == i).all()
    still = {"close gripper", "release", "end"}
    assert [phase.name for phase in run.phases if phase.leg is None] == [
        name for name in PHASES if name in still
    ]
    assert [leg.waypoint.name for leg in run.legs] == [n for n in PHASES if n not in still]


def test_motions_start_where_the_last_one_ended() -> None:
    run = picked_and_placed()
    end = PANDA.home
    arm = Arm(PANDA)
    for leg in run.legs:
        np.testing.assert_array_equal(leg.trajectory.q[0], end)
        np.testing.assert_allclose(
            leg.T_world_start.as_matrix(), arm.pose(end).as_matrix(), atol=1e-12
        )
        end = leg.trajectory.q[-1]
    np.testing.assert_allclose(end, PANDA.home, atol=1e-12)


def test_observers_hear_of_phases_legs_and_events_when_they_happen(
    witnessed: tuple[Run, Witness, Eyewitness, Keeper],
) -> None:
    run, witness, _, _ = witnessed
    assert [name for _, name in witness.phases] == PHASES
    for (time, _), phase in zip(witness.phases, run.phases, strict=True):
        assert time == pytest.approx(phase.start * TIMESTEP, abs=1e-9)
    arm = Arm(PANDA)
    assert [leg for _, leg, _ in witness.legs] == run.legs
    moving = [phase for phase in run.phases if phase.leg is not None]
    for (time, leg, paths), phase in zip(witness.legs, moving, strict=True):
        path = paths["tool"]
        assert time == pytest.approx(phase.start * TIMESTEP, abs=1e-9)
        assert path.shape == (leg.trajectory.steps + 1, 3)
        for k in (0, leg.trajectory.steps // 2, leg.trajectory.steps):
            expected = arm.pose(leg.trajectory.q[k]).translation()
            np.testing.assert_allclose(path[k], expected, atol=1e-12)
    texts = [text for _, text, _ in witness.notes]
    assert texts[0].startswith("close gripper: 39.")
    assert "fingers 10.0 N" in texts[0]
    assert texts[1].startswith("release: 51.9 mm")
    assert texts[2:] == ["program done", "success"]
    assert {level for _, _, level in witness.notes} == {"INFO"}
    assert witness.calls[:3] == ["phase", "planned", "tick"]
    assert witness.calls[-1] == "note"


def test_observers_look_at_least_every_few_periods(
    witnessed: tuple[Run, Witness, Eyewitness, Keeper],
) -> None:
    run, witness, _, _ = witnessed
    steps = np.diff([0.0, *witness.times]) / TIMESTEP
    assert steps.min() > 0.5
    assert steps.max() < TICK_ROWS + 0.5
    assert witness.times[-1] == pytest.approx(len(run.rows) * TIMESTEP, abs=1e-9)


def test_sinks_get_the_rows_of_the_run(
    witnessed: tuple[Run, Witness, Eyewitness, Keeper],
) -> None:
    run, _, _, keeper = witnessed
    np.testing.assert_array_equal(np.concatenate(keeper.blocks), run.rows.values)
    assert max(len(block) for block in keeper.blocks) <= CHUNK_ROWS


def test_an_error_of_a_sink_ends_the_run() -> None:
    class Full:
        def write(self, rows: Rows) -> None:
            raise RecordingError("the disk is full")

    with pytest.raises(RecordingError, match="the disk is full"):
        carry_out(Reach(), sinks=[Full()])


def test_the_arm_stands_still_before_the_end_is_judged() -> None:
    run = picked_and_placed()
    last = run.phases[-1]
    assert (len(run.rows) - last.start) * TIMESTEP == pytest.approx(0.3)
    assert np.abs(run.rows["joints/v"][-1]).max() < 1e-4


def test_the_first_failure_counts_and_is_told() -> None:
    failure = Failure(cause=Cause.GRASP, evidence="nothing between the fingers")
    witness = Witness()
    run = carry_out(Reach(ending=failure), observers=[witness])
    assert run.failure is not None
    assert run.failure == replace(failure, time=run.failure.time)
    assert run.failure.time == pytest.approx(len(run.rows) * TIMESTEP)
    assert [(text, level) for _, text, level in witness.notes] == [
        ("gave up: nothing between the fingers", "ERROR"),
        ("failed (grasp): nothing between the fingers", "ERROR"),
    ]
    assert run.measures == {"rise_m": 0.02}


def test_a_waypoint_out_of_reach_while_under_way_is_a_failure_not_an_error() -> None:
    witness = Witness()
    run = carry_out(Reach(rise=5.0), observers=[witness])
    assert run.failure is not None
    assert run.failure.cause is Cause.IK
    assert "Waypoint 'up' cannot be planned" in run.failure.evidence
    assert [phase.name for phase in run.phases] == ["end"]
    assert witness.notes[-1][2] == "ERROR"


def test_the_time_of_the_loop_is_measured() -> None:
    run = picked_and_placed()
    assert 0.0 < run.loop_seconds < 30.0


def test_a_rehearsal_plans_what_the_run_then_does() -> None:
    rehearsed = make_runner(PickPlace())[0].rehearse()
    run = picked_and_placed()  # a run after a rehearsal is the same: see the next test
    assert [leg.waypoint.name for leg in rehearsed] == [leg.waypoint.name for leg in run.legs]
    for plan, leg in zip(rehearsed, run.legs, strict=True):
        off = plan.T_world_goal.translation() - leg.T_world_goal.translation()
        assert np.linalg.norm(off) < 1e-3
        assert plan.waypoint.motion is leg.waypoint.motion
        assert plan.trajectory.duration == pytest.approx(leg.trajectory.duration, abs=0.02)
    assert rehearsed[-1].waypoint.target is Place.HOME
    assert {leg.waypoint.motion for leg in rehearsed} == {Motion.PTP, Motion.LIN}


@dataclass(frozen=True, kw_only=True)
class Dash(Step):
    """Leaves the reference on its way out of the limits of joint 2, too fast to brake."""

    @property
    def name(self) -> str:
        return "dash"

    def carry_out(self, executor: StepExecutor) -> None:
        q, v = executor.loop.reference.q.copy(), np.zeros_like(executor.loop.reference.q)
        q[1], v[1] = executor.loop.arm.q_max[1] - 1e-3, 1.5
        executor.loop.take_over(JointReference(q, v, np.zeros_like(q)))


@dataclass(frozen=True, kw_only=True)
class Dashing(Reach):
    """Asks for so many dashes, one after the other."""

    dashes: int = 1

    def program(self, sensed: Sensed) -> Program:
        for _ in range(self.dashes):
            yield Dash()
        return self.ending


@pytest.mark.parametrize("dashes", [1, 2])
def test_an_arm_that_cannot_stop_is_a_failure_and_what_was_recorded_is_kept(dashes: int) -> None:
    """At the end of the program, and before its next step."""
    witness = Witness()
    run = carry_out(Dashing(dashes=dashes), observers=[witness])
    assert run.failure is not None
    assert run.failure.cause is Cause.LIMIT
    assert "the arm cannot stop: joint2 leaves its limits after 0." in run.failure.evidence
    assert witness.notes[-1][1].startswith("failed (limit)")


def test_why_a_program_gave_up_stays_the_failure_where_the_arm_cannot_stop() -> None:
    given = Failure(cause=Cause.GRASP, evidence="nothing between the fingers")
    run = carry_out(Dashing(ending=given))
    assert run.failure is not None
    assert (run.failure.cause, run.failure.evidence) == (given.cause, given.evidence)


@pytest.mark.parametrize("given", [None, Failure(cause=Cause.GRASP, evidence="nothing held")])
def test_an_arm_too_fast_when_it_is_made_stiff_again_is_a_failure(
    given: Failure | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused() -> None:
        raise PlanError("stop", "joint2 leaves its limits")

    runner = make_runner(Dashing(dashes=0, ending=given))[0]
    monkeypatch.setattr(runner.executor.compliance, "stiffen", refused)
    failure = runner.run().failure
    assert failure is not None
    limit = "the arm cannot stop: joint2 leaves its limits"
    assert failure.evidence == (limit if given is None else given.evidence)


def test_a_rehearsal_changes_nothing() -> None:
    run = picked_and_placed()
    runner, simulation = make_runner(PickPlace())
    before = simulation.data.qpos.copy(), simulation.data.qvel.copy(), simulation.data.ctrl.copy()
    runner.rehearse()
    data = simulation.data
    for old, new in zip(before, (data.qpos, data.qvel, data.ctrl), strict=True):
        np.testing.assert_array_equal(old, new)
    assert simulation.time == 0.0
    np.testing.assert_array_equal(runner.run().rows.values, run.rows.values)


@pytest.mark.parametrize(
    ("task", "waypoint"),
    [(PickPlace(pick=(0.88, 0.58)), "approach"), (PickPlace(place=(0.88, -0.58)), "carry")],
)
def test_a_rehearsal_tells_what_cannot_be_reached_and_nothing_moves(
    task: PickPlace, waypoint: str
) -> None:
    runner, simulation = make_runner(task)
    before = simulation.data.qpos.copy()
    with pytest.raises(
        PlanError, match=f"Waypoint '{waypoint}' cannot be planned: .*(reach|no closer)"
    ):
        runner.rehearse()
    assert simulation.time == 0.0
    np.testing.assert_array_equal(simulation.data.qpos, before)


def test_the_same_seed_gives_the_same_bits() -> None:
    first = picked_and_placed(seed=3).rows.values
    second = carry_out(PickPlace(), seed=3).rows.values
    assert first.tobytes() == second.tobytes()


def test_a_used_world_gives_the_same_bits_as_a_new_one() -> None:
    first = picked_and_placed().rows.values
    runner, simulation = make_runner(PickPlace())
    for _ in range(50):
        simulation.step(np.full(7, 5.0))
    again = Runner(runner.scenario, simulation)
    assert again.run().rows.values.tobytes() == first.tobytes()


def test_different_seeds_give_different_runs() -> None:
    starts = {picked_and_placed(seed=s).rows["objects/cube"][0].tobytes() for s in (2, 3, 4)}
    goals = {picked_and_placed(seed=s).rows["objects/cube"][-1].tobytes() for s in (2, 3, 4)}
    assert len(starts) == len(goals) == 3


def test_plans_leave_room_for_tracking_at_the_joint_limits() -> None:
    scenario, simulation = ClassicalStack().scenario(PANDA, Reach()), Simulation(PANDA, no_objects)
    executor, arm = Runner(scenario, simulation).executor, Arm(PANDA)
    room = JOINT_MARGIN * (arm.q_max - arm.q_min)
    inner = executor.planning_arm(arm.home)
    np.testing.assert_allclose(inner.q_min, arm.q_min + room)
    np.testing.assert_allclose(inner.q_max, arm.q_max - room)
    whole = executor.planning_arm(arm.q_max - 0.5 * room)
    np.testing.assert_array_equal(whole.q_max, arm.q_max)


def test_an_arm_that_starts_next_to_a_limit_can_leave_it_and_come_back() -> None:
    arm = Arm(PANDA)
    home = np.array(PANDA.home)
    home[6] = arm.q_max[6] - 0.3 * JOINT_MARGIN * (arm.q_max[6] - arm.q_min[6])
    robot = replace(PANDA, home=home)
    scenario = ClassicalStack().scenario(robot, Reach())
    simulation = Simulation(robot, Reach().build_scene)
    assert Runner(scenario, simulation).run().failure is None


def test_a_controller_that_gives_no_torque_is_not_blamed_on_the_program() -> None:
    """Without an observer, nobody makes velocities of positions alone."""
    scenario = ClassicalStack(observer=None).scenario(PANDA, Reach())
    only_positions = Disturbance(velocity_cutoff=0.0)
    run = Runner(scenario, DisturbedSimulation(PANDA, Reach().build_scene, only_positions)).run()
    assert run.failure is not None
    assert run.failure.cause is Cause.LIMIT
    assert "cannot be controlled: commanded torque must be finite [N·m]; f" in run.failure.evidence
    assert (len(run.rows), run.failure.time) == (0, 0.0)
