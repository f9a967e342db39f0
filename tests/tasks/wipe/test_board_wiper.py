"""The sponge lies on the board and is laid down where they are, not where they are believed."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from mink import SE3

from robo47_qp.constants import TIMESTEP
from robo47_qp.evaluation.perturbation import PRESETS, Perturbation
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.task import Program
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.wipe import board_wiper
from robo47_qp.tasks.wipe.board import SLIDING
from robo47_qp.tasks.wipe.wipe import Wipe


def begun(task: Wipe, seed: int, seconds: float, wrong: Perturbation) -> tuple[Run, Simulation]:
    """Return the first seconds of an episode, and its world as they leave it."""
    episode = TaskEpisode(robot=PANDA, task=task, perturbation=wrong, time_limit=seconds)
    scenario = episode.scenario(seed)
    simulation = episode.simulation(scenario, seed)
    return Runner(scenario, simulation).run(), simulation


def end_of(run: Run, name: str) -> SE3:
    """Return where the sponge is when the last phase of a name ends."""
    i = max(i for i, phase in enumerate(run.phases) if phase.name == name)
    return SE3(np.roll(run.rows["objects/sponge"][run.phases[i + 1].start - 1], 4))


@pytest.mark.parametrize("noise_force", [0.0, 0.3])
def test_the_sponge_is_led_over_the_board_where_both_are_seen(noise_force: float) -> None:
    """Their common error shifts nothing; foam over an edge of the board would press otherwise."""
    wrong = Perturbation(pose_bias=4e-3, rotation_bias=0.0175, noise_force=noise_force)
    run, world = begun(Wipe(), 71_002, 26.0, wrong)
    T_board = world.marker_pose("board").inverse()
    corner = np.array([-0.04, -0.09])
    hover, beside = (
        (T_board @ end_of(run, name)).translation()[:2] - corner for name in ("hover", "beside")
    )
    assert np.linalg.norm(hover) > 5e-3
    assert np.linalg.norm(beside) < 2e-3


@dataclass(frozen=True, kw_only=True)
class Crept(Wipe):
    """The sponge is put back at once, after it has crept up between the fingers."""

    crept: float
    """By how much [m]."""

    def program(self, sensed: Sensed) -> Program:
        hand = self._wiper(sensed, sensed.seen_pose("board"))
        held = yield from hand.pick()
        assert held.above is not None
        home = SE3.from_translation(np.array([0.0, 0.0, 0.5 * self.sponge.height]))
        goal = sensed.seen_pose("place of the sponge") @ home
        yield from hand.place(goal, replace(held, above=held.above - self.crept))
        yield hand.retreat(sensed.tool_pose())
        return None


def test_the_sponge_is_lowered_until_it_touches_and_let_go_without_a_bounce() -> None:
    """Let go 2 mm above the table, it would rock aside on its foam."""
    task = Crept(crept=2e-3)
    run, world = begun(task, 71_003, 60.0, Perturbation(pose_noise=1e-3, noise_force=0.3))
    assert run.failure is not None
    assert run.failure.evidence.startswith("8 of 8 marks are left")
    names = [phase.name for phase in run.phases]
    assert names[-7:-1] == ["set down", "stop", "loosen", "release", "settle", "retreat"]
    start = {phase.name: phase.start for phase in run.phases}
    pressed = run.rows["contact/tool"][start["loosen"] - 200 : start["loosen"], 2].mean()
    assert pressed + 9.81 * task.sponge.mass == pytest.approx(1.0, abs=0.5)
    lowered = end_of(run, "lower"), end_of(run, "set down")
    assert 1e-3 < lowered[0].translation()[2] - lowered[1].translation()[2] < 4e-3
    tips = run.rows["gripper/force"][start["release"] - 50 : start["release"]]
    assert tips.max() < 3.0
    assert task.measures(world)["sponge_error_m"] < 3e-3
    assert all(finding.ok for finding in audit(run))


def test_the_sponge_does_not_slide_while_it_is_relieved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction holds the joints in another way than when they moved; insisting, they would leap.

    What is held drags the tool aside when the board no longer does, and is gone by the next line.
    """
    monkeypatch.setattr(board_wiper, "_FIRST_TOUCHES", 1)
    run, _ = begun(Wipe(), 61_018, 96.0, replace(PRESETS["severe"], pushes=0))
    start = [phase.start for phase in run.phases if phase.name in ("ease", "to stroke 2")]
    assert len(start) == 3, "one after the sponge is run in, one after the first stroke, the line"
    eased = run.rows["objects/sponge"][start[1] : start[1] + 1500, :2]
    assert len(eased) == 1500
    speeds = np.linalg.norm(eased[10:] - eased[:-10], axis=1) / (10 * TIMESTEP)
    assert speeds.max() < 0.5 * SLIDING
    line = run.rows["tool/pose"] - run.rows["tool/pose_ref"]
    assert np.linalg.norm(line[start[2] :, :3], axis=1).max() < 0.4e-3
