"""The tray stays level between two hands that do not fight each other."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.evaluation.perturbation import PRESETS
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.failure import Cause
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.watchdog import Watchdog
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.carry_tray.carry_tray import CarryTray, squeeze
from robo47_qp.tasks.carry_tray.tray import BALL, CUP, NAME
from robo47_qp.tasks.heading import tilt, upright
from robo47_qp.tasks.task_state import task_state
from tests.runs import at_rest

PAIR = panda_pair()
TASK = CarryTray()


def start() -> Simulation:
    simulation = Simulation(PAIR, TASK.build_scene)
    TASK.reset(simulation, np.random.default_rng(0))
    return simulation


def at_goal() -> Simulation:
    """The world as it is to be in the end."""
    simulation = start()
    TASK.tray.place(simulation, simulation.marker_pose("goal"))
    task_state(simulation)[3] = 1.0
    at_rest(simulation)
    return simulation


def shifted(simulation: Simulation, name: str, by: list[float]) -> None:
    pose = SE3.from_translation(np.array(by)) @ simulation.object_pose(name)
    simulation.place_object(name, pose)


@pytest.fixture(scope="module")
def run() -> Run:
    simulation = Simulation(PAIR, TASK.build_scene)
    return Runner(ClassicalStack(ik="qp").scenario(PAIR, TASK), simulation).run()


def test_the_tray_is_carried_level_over_the_wall(run: Run) -> None:
    assert run.failure is None
    assert run.measures["tilt_max_deg"] < 0.5
    assert run.measures["internal_force_N"] < 5.0
    assert run.rows[f"objects/{NAME}"][:, 2].max() > TASK.wall[2] + 0.04


def test_no_limit_is_violated_and_the_hands_keep_their_relative_pose(run: Run) -> None:
    findings = audit(run)
    assert [finding for finding in findings if not finding.ok] == []
    together = [finding for finding in findings if finding.signal.startswith("relative pose")]
    assert len(together) == 2


def test_what_compliant_hands_do_is_told(run: Run) -> None:
    phases = [replace(phase, compliant=phase.name == "cross") for phase in run.phases]
    (rows,) = [rows for phase, rows in run.spans() if phase.name == "cross"]
    told = audit(replace(run, phases=phases))
    together = [f for f in told if f.signal.startswith("relative pose measured")]
    assert [bool(f.exempt) for f in together] == [False, True]
    assert together[1].signal.endswith(", exempt")
    assert together[1].share == pytest.approx((rows.stop - rows.start) / len(run.rows))
    (before,) = [f for f in audit(run) if f.signal.startswith("relative pose measured")]
    assert sum(f.share for f in together) == pytest.approx(before.share)
    assert before.extreme == max(f.extreme for f in together)
    (commanded,) = [f for f in told if f.signal.startswith("relative pose commanded")]
    assert not commanded.exempt
    assert commanded.share == pytest.approx(before.share)


def test_in_a_wrong_world_the_hands_neither_drift_nor_fight() -> None:
    """Heavier links, joints that rub, noise, delays: up to where the tray is lifted."""
    # With a camera that sees all at once and as it is, there is less to wait for.
    erring = replace(
        PRESETS["moderate"],
        pose_bias=0.0,
        rotation_bias=0.0,
        pose_noise=0.0,
        heading_noise=0.0,
        outliers=0.0,
    )
    episode = TaskEpisode(robot=PAIR, task=TASK, perturbation=erring)
    scenario = replace(episode.scenario(80001), watchdog=Watchdog(time_limit=21.0))
    run = Runner(scenario, episode.simulation(scenario, 80001)).run()
    assert run.failure is not None
    assert run.failure.cause is Cause.TIMEOUT
    assert run.phases[-1].name == "lift"
    assert [finding for finding in audit(run) if not finding.ok] == []
    assert run.measures["internal_force_N"] < 10.0


def test_the_weight_is_shared(run: Run) -> None:
    (rows,) = [rows for phase, rows in run.spans() if phase.name == "cross"]
    left, right = (-run.rows[f"contact/{one}tool"][rows, 2].mean() for one in ("", "right_"))
    whole = TASK.tray.whole_mass * 9.81
    assert left + right == pytest.approx(whole, rel=0.02)
    assert min(left, right) > 0.3 * whole


def test_the_end_is_judged() -> None:
    assert TASK.verdict(at_goal()) is None


@pytest.mark.parametrize(
    ("name", "by", "told"),
    [
        (BALL, [0.05, 0.0, 0.0], "the ball is 50 mm"),
        (BALL, [0.0, 0.0, 0.05], "the ball"),
        (CUP, [0.03, 0.0, 0.0], "the cup has slid 30 mm"),
        (NAME, [0.0, 0.006, 0.0], "from its goal"),
    ],
)
def test_what_has_left_its_place_is_told(name: str, by: list[float], told: str) -> None:
    simulation = at_goal()
    shifted(simulation, name, by)
    failure = TASK.verdict(simulation)
    assert failure is not None
    assert told in failure.evidence


@pytest.mark.parametrize(
    ("note", "value", "told"),
    [(0, np.radians(2.1), "tilted by 2.10"), (1, 20.5, "20.5 N"), (3, 0.0, "never above")],
)
def test_what_happened_on_the_way_is_told(note: int, value: float, told: str) -> None:
    simulation = at_goal()
    task_state(simulation)[note] = value
    failure = TASK.verdict(simulation)
    assert failure is not None
    assert told in failure.evidence


def test_a_cup_that_lies_is_told() -> None:
    simulation = at_goal()
    cup = simulation.object_pose(CUP)
    lying = SE3.from_rotation_and_translation(SO3.from_x_radians(1.4), cup.translation())
    simulation.place_object(CUP, lying)
    assert "leans 80" in str(TASK.tray.lost(simulation))


def test_a_tray_that_touches_the_wall_is_a_collision() -> None:
    simulation = at_goal()
    x, thick, _ = TASK.wall
    TASK.tray.place(simulation, SE3.from_translation(np.array([x - 0.1 - 0.4 * thick, 0.0, 0.02])))
    mujoco.mj_forward(simulation.model, simulation.data)
    TASK.monitor(simulation)
    failure = TASK.verdict(simulation)
    assert failure is not None
    assert failure.cause is Cause.COLLISION


def test_the_tilt_is_the_angle_from_the_vertical() -> None:
    for angle in (0.0, 1e-5, 0.3, 2.0):
        turned = SO3.from_z_radians(0.7) @ SO3.from_x_radians(angle) @ SO3.from_z_radians(0.4)
        assert tilt(SE3.from_rotation(turned)) == pytest.approx(angle, abs=1e-9)


def test_starts_walls_and_goals_do_not_overlap() -> None:
    for seed in range(50):
        rng = np.random.default_rng(seed)
        x, thick, _ = TASK.variant(rng).wall
        turned = 0.1 * np.cos(0.12) + 0.1 * np.sin(0.12)
        assert 0.36 + turned < x - 0.5 * thick
        assert x + 0.5 * thick < 0.64 - turned


def test_at_the_start_nothing_is_noted() -> None:
    simulation = start()
    TASK.monitor(simulation)
    assert not task_state(simulation).any()


class Pulled(Simulation):
    """Both hands bear 4 N of the weight, and pull at each other with 5 N."""

    def last_tool_force(self, tool: int = 0) -> Vector:
        return np.array([(5.0, -5.0)[tool], 0.0, -4.0])


def test_the_internal_force_is_what_moves_nothing() -> None:
    pulled = Pulled(PAIR, TASK.build_scene)
    left, right = (pulled.last_tool_force(tool)[None] for tool in (0, 1))
    assert squeeze(left, right) == pytest.approx([5.0])
    TASK.tray.place(pulled, SE3.from_translation(np.array([0.35, 0.0, 0.02])))
    TASK.monitor(pulled)
    assert task_state(pulled)[1] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("at", "turn", "went"),
    [
        # At its start; with its edge over the wall, and just not; beyond, beside and below.
        ((0.35, 0.0, 0.09), 0.0, False),
        ((0.394, 0.0, 0.09), 0.0, True),
        ((0.391, 0.0, 0.09), 0.0, False),
        ((0.391, 0.0, 0.09), 0.1, True),
        ((0.606, 0.0, 0.09), 0.0, True),
        ((0.609, 0.0, 0.09), 0.0, False),
        ((0.5, 0.24, 0.09), 0.0, True),
        ((0.5, 0.26, 0.09), 0.0, False),
        ((0.5, 0.0, 0.079), 0.0, False),
    ],
)
def test_the_tray_was_above_the_wall_where_it_is_over_it(
    at: tuple[float, float, float], turn: float, went: bool
) -> None:
    simulation = start()
    TASK.tray.place(simulation, upright(at, turn))
    TASK.monitor(simulation)
    assert task_state(simulation)[3] == went


@pytest.fixture
def recorded() -> tuple[Simulation, dict[str, Matrix]]:
    """A world with the tray on the table, and its last 20 periods with the tray 20 mm above."""
    simulation = start()
    kept = {f"motion/{name} velocity": np.zeros((20, 6)) for name in (NAME, CUP)}
    kept[f"objects/{NAME}"] = np.tile([0.35, 0.0, 0.02, 1.0, 0.0, 0.0, 0.0], (20, 1))
    kept |= {f"contact/{one}tool": np.zeros((20, 3)) for one in ("", "right_")}
    simulation.lately = kept.__getitem__
    return simulation, kept


@pytest.mark.parametrize("row", [0, 7, 19])
def test_what_happens_between_two_looks_is_noted(
    recorded: tuple[Simulation, dict[str, Matrix]], row: int
) -> None:
    simulation, kept = recorded
    TASK.monitor(simulation)
    assert not task_state(simulation).any()
    tilted = SO3.from_z_radians(0.7) @ SO3.from_x_radians(0.04)
    kept[f"objects/{NAME}"][row, 3:] = tilted.wxyz
    kept["contact/tool"][row] = [0.0, 21.0, -4.0]
    kept["contact/right_tool"][row] = [0.0, -21.0, -4.0]
    TASK.monitor(simulation)
    np.testing.assert_allclose(task_state(simulation), [0.04, 21.0, 0.0, 0.0])
    kept[f"objects/{NAME}"][row, :3] = [TASK.wall[0], 0.0, 0.09]
    TASK.monitor(simulation)
    np.testing.assert_allclose(task_state(simulation), [0.04, 21.0, 0.0, 1.0])


def test_forces_on_a_tray_that_stands_do_not_count(
    recorded: tuple[Simulation, dict[str, Matrix]],
) -> None:
    simulation, kept = recorded
    kept["contact/tool"][7] = [0.0, 42.0, 0.0]
    kept[f"objects/{NAME}"][7, 2] = 0.0
    TASK.monitor(simulation)
    assert task_state(simulation)[1] == 0.0
