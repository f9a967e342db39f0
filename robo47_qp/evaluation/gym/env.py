"""Tasks as environments of Gymnasium."""

from dataclasses import asdict
from typing import Any, TypeAlias

import gymnasium
import numpy as np
from numpy.typing import NDArray

from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.evaluation.gym.spaces import ActionScale, Mode, Single, numbers_of, observation_space
from robo47_qp.evaluation.perturbation import PRESETS, Perturbation
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.arm import Arm
from robo47_qp.model.cell import in_cell
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots import load_robot
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.video import OffscreenCamera
from robo47_qp.run.policy.drivers import (
    PolicyTiming,
    StepwiseDriver,
    check_judged,
    check_one_tool,
)
from robo47_qp.run.registry import load_task
from robo47_qp.run.start import checked_start
from robo47_qp.run.task import Task
from robo47_qp.sim.sensed import Senses

_Base: TypeAlias = gymnasium.Env[dict[str, NDArray[Any]], NDArray[Any]]
_CONFIRMED = 0.3
"""Time for which the verdict must be success before an episode ends with it [s]."""
_WIDTH, _HEIGHT = 640, 480


class TaskEnv(_Base):
    """A task. The reward is 1 at the end of a successful episode, and 0 otherwise.

    An episode is terminated once the task's verdict has been success for 0.3 s, or by a failure:
    the watchdog, or an action that cannot be carried out. It is truncated when its time is over.
    Then the arm comes to rest and the verdict judges the world, as for every policy. `info` has
    `success`, and at the end `cause` and `evidence` of a failure, the task's `measures`, and what
    the audit found: `audit_ok`, and `broken_promises` by name. That of `reset` has the `sheet`:
    what data sheets say of the cell, as in `Observation`.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  # declared so in Gymnasium
        "render_modes": ["rgb_array"],
        "render_fps": 30,
    }

    def __init__(
        self,
        task: Task | str,
        *,
        mode: Mode = "joints",
        timing: PolicyTiming | None = None,
        vary: bool = False,
        perturbation: Perturbation | str = "none",
        robot: Robot | str | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Build the scene.

        Args:
            task: The task, or its name; see `load_task`.
            mode: Kind of actions; see `ActionScale`.
            timing: Actions per second and length of an episode.
            vary: Whether every episode has its own scene (`Task.variant`), as in evaluations.
            perturbation: How the world differs from what is believed of it, drawn anew in every
                episode as in evaluations; or the name of a preset.
            robot: The robot, or its name (see `load_robot`), which puts it in its cell; by default
                the one that the task is made for.
            render_mode: "rgb_array" for pictures, which need OpenGL.

        Raises:
            InvalidValueError: There is no such mode, the task is done before it begins, or it
                needs several tools, or the robot cannot do it (see `checked_start`).
            UnknownNameError: There is no such preset.
            Robo47Error: See `load_robot`.
        """
        self._task: Task = load_task(task)() if isinstance(task, str) else task
        check_one_tool(self._task)
        if isinstance(perturbation, str):
            if perturbation not in PRESETS:
                raise UnknownNameError("perturbation", perturbation, tuple(PRESETS))
            perturbation = PRESETS[perturbation]
        self._timing, self._vary = timing or PolicyTiming(), vary
        named = self._task.default_robot if robot is None else robot
        self._robot = (
            named if isinstance(named, Robot) else in_cell(load_robot(named), self._task.name)
        )
        self._task = self._task.laid_out(self._robot)
        self._episodes = TaskEpisode(robot=self._robot, task=self._task, perturbation=perturbation)
        self._anew = vary or perturbation != Perturbation()
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InvalidValueError("render_mode", repr(render_mode), "None or 'rgb_array'")
        self.render_mode, self._shown = render_mode, render_mode is not None
        self._arm = Arm(self._robot)
        self._camera: OffscreenCamera | None = None
        self._episode: StepwiseDriver | None = None
        self._simulation = checked_start(self._task, self._robot, seed=0)
        check_judged(self._task, self._simulation)
        self.scale = ActionScale(self._arm, mode)
        """Converts between actions in SI units and vectors of the action space."""
        self.action_space = self.scale.space
        sensed = Senses(self._simulation, as_seen=self._task.as_seen).read()
        sizes = len(self._simulation.objects), len(sensed.markers)
        seconds = self._timing.seconds or self._task.time_limit
        measured = perturbation.velocity_cutoff != 0.0
        self._space = observation_space(self._arm, *sizes, seconds, velocities=measured)
        space: Any = self._space
        self.observation_space = space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Single], dict[str, Any]]:
        """Start an episode; with a seed, in the world of an evaluation with this seed."""
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(2**31)) if seed is None else seed
        episodes = self._episodes
        scenario = (
            episodes.scenario(drawn)
            if self._vary
            else episodes.stack.scenario(self._robot, self._task, drawn)
        )
        if self._anew:
            self.close()
            self._simulation = self._episodes.simulation(scenario, drawn, drawn=self._shown)
        self._episode = StepwiseDriver(scenario, self._simulation, self._timing)
        self._good = 0
        seen = self._episode.observe()
        info = {"seed": drawn, "success": False, "sheet": asdict(seen.sheet)}
        return numbers_of(seen, self._space), info

    def step(self, action: Single) -> tuple[dict[str, Single], float, bool, bool, dict[str, Any]]:
        """Carry out an action until the next one is due."""
        episode = self._episode
        if episode is None:
            raise gymnasium.error.ResetNeeded("The episode is over: call reset() first.")
        failure = episode.step(self.scale.action(action))
        self._good = self._good + 1 if failure is None and episode.done else 0
        # One instant is no time, however long a decision lasts.
        confirmed = self._good > max(1.0, _CONFIRMED * self._timing.rate)
        terminated = failure is not None or confirmed
        truncated = episode.over and not terminated
        info: dict[str, Any] = {"success": False}
        if terminated or truncated:
            run = episode.end()
            failure = run.failure
            broken = [finding.signal for finding in audit(run) if not finding.ok]
            info = {
                "success": failure is None,
                "cause": None if failure is None else failure.cause.value,
                "evidence": None if failure is None else failure.evidence,
                "measures": run.measures,
                "audit_ok": not broken,
                "broken_promises": broken,
                "process": "that of the world",
            }
            self._episode = None
        reward = 1.0 if info["success"] else 0.0
        return self._observed(episode), reward, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the scene (480, 640, 3); None without a render mode."""
        if self.render_mode is None:
            return None
        if self._camera is None:
            self._camera = OffscreenCamera(self._simulation.model, "overview", _WIDTH, _HEIGHT)
        return self._camera.picture(self._simulation.data)

    def close(self) -> None:
        """Close the camera."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None

    def _observed(self, episode: StepwiseDriver) -> dict[str, Single]:
        return numbers_of(episode.observe(), self._space)
