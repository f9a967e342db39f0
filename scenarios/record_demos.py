"""Demonstrations for imitation learning: successful episodes of a task as a LeRobot dataset."""

import os
import shutil
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from robo47_qp.report.importing import importing

with importing():
    import numpy as np
    from numpy.typing import NDArray
    from rich.console import Console

    from robo47_qp.arrays import Checked, Count, CountOrZero, Matrix
    from robo47_qp.cli import FAILED, LOGS, OK, main
    from robo47_qp.constants import TIMESTEP
    from robo47_qp.errors import InvalidValueError, MissingExtraError, RecordingError
    from robo47_qp.model.robot import Robot
    from robo47_qp.model.robots.panda import PANDA
    from robo47_qp.report.video import OffscreenCamera
    from robo47_qp.run.observers import Observer
    from robo47_qp.run.registry import load_task
    from robo47_qp.run.runner import Runner
    from robo47_qp.run.scenario import Run
    from robo47_qp.sim.simulation import Simulation
    from robo47_qp.stack import ClassicalStack

_RATE = 30
"""Frames per second."""
_PICTURE, _STATE, _ACTION = "observation.images.overview", "observation.state", "action"
_CODEC_ERROR = 12.0
"""Largest mean error of an image after the video codec [of 255]."""


@dataclass(frozen=True, kw_only=True)
class DemoOptions(Checked):
    """Options of this scenario."""

    task: str = "pick_place"
    """Name of a task."""
    episodes: Count = 10
    """Successful episodes to write."""
    seed: CountOrZero = 0
    """Seed of the first attempt; the next ones follow."""
    attempts: int | None = None
    """Largest number of attempts; by default twice the number of episodes."""
    out: Path = LOGS / "demos"
    """New folder of the dataset."""
    size: tuple[int, int] = (240, 320)
    """Height and width of the pictures [pixel]."""
    images: bool = False
    """Store every image as PNG instead of videos."""

    def __post_init__(self) -> None:
        """Check the options.

        Raises:
            InvalidValueError: A number is out of range, or the folder exists.
        """
        super().__post_init__()
        if self.attempts is not None and self.attempts < self.episodes:
            raise InvalidValueError("--attempts", self.attempts, "no less than --episodes")
        if min(self.size) < 32 or max(self.size) > 1080 or any(n % 2 for n in self.size):
            raise InvalidValueError("--size", self.size, "two even numbers from 32 to 1080")
        if self.out.exists():
            raise InvalidValueError("--out", self.out, "a folder that is not there yet")

    def _label(self, field: str) -> str:
        return f"--{field}"


class Frames(Observer):
    """Images of a run and the rows at which they were taken, at most 20 ms after they were due.

    State and action of a frame are those of the time of its image.
    """

    def __init__(self, camera: OffscreenCamera) -> None:
        self._camera = camera
        self.pictures: list[NDArray[np.uint8]] = []
        self.rows: list[int] = []

    def tick(self, simulation: Simulation) -> None:
        if simulation.time * _RATE >= len(self.pictures):
            self.pictures.append(self._camera.picture(simulation.data))
            self.rows.append(round(simulation.time / TIMESTEP))


def columns(run: Run, rows: list[int]) -> tuple[Matrix, Matrix]:
    """Return the states (N, n + 1) and actions (N, n + 1) of all frames but the last.

    State: measured joint positions, then the opening width. Action: joint positions and width
    commanded for the time of the next frame, as in `JointTarget`.
    """
    now, after = rows[:-1], rows[1:]
    state, action = [run.rows["joints/q"][now]], [run.rows["joints/q_ref"][after]]
    if run.scenario.robot.gripper is not None:
        state.append(run.rows["gripper/width"][now])
        action.append(run.rows["gripper/width_command"][after])
    return np.hstack(state), np.hstack(action)


def lerobot_dataset() -> Any:
    """Return LeRobot's class of datasets, set to stay offline.

    Raises:
        MissingExtraError: LeRobot is not installed.
    """
    os.environ.setdefault("HF_HUB_OFFLINE", "1")
    try:
        module: Any = import_module("lerobot.datasets.lerobot_dataset")
    except ImportError as error:
        raise MissingExtraError("scenarios/record_demos.py", "lerobot", "lerobot") from error
    return module.LeRobotDataset


class Dataset:
    """A LeRobot dataset that is written, then read back and compared."""

    def __init__(self, kind: Any, options: DemoOptions, robot: Robot) -> None:
        """Create the dataset.

        Args:
            kind: LeRobot's class; see `lerobot_dataset`.
            options: Options of the scenario.
            robot: The robot whose joints are written.
        """
        self._kind, self._options = kind, options
        names = [*robot.joints, *(() if robot.gripper is None else ("width",))]
        vector = {"dtype": "float32", "shape": (len(names),), "names": names}
        picture = {
            "dtype": "image" if options.images else "video",
            "shape": (*options.size, 3),
            "names": ["height", "width", "channels"],
        }
        self._dataset = self._kind.create(
            repo_id=self._name,
            root=options.out,
            fps=_RATE,
            robot_type=robot.name,
            use_videos=not options.images,
            features={_STATE: vector, _ACTION: dict(vector), _PICTURE: picture},
        )
        self._written: list[tuple[Matrix, Matrix, NDArray[np.uint8]]] = []

    @property
    def _name(self) -> str:
        return f"robo47/{self._options.task}"

    def add(self, run: Run, frames: Frames) -> None:
        """Add an episode."""
        rows = [row for row in frames.rows if row < len(run.rows)]
        states, actions = columns(run, rows)
        for state, action, picture in zip(states, actions, frames.pictures, strict=False):
            frame = {
                _STATE: state.astype(np.float32),
                _ACTION: action.astype(np.float32),
                _PICTURE: picture,
                "task": run.scenario.task.name.replace("_", " "),
            }
            self._dataset.add_frame(frame)
        self._dataset.save_episode()
        self._written.append((states, actions, frames.pictures[len(states) // 2]))

    def close(self) -> int:
        """Finish the dataset, read it back and compare; return the number of frames.

        Raises:
            RecordingError: It does not read as it was written.
        """
        self._dataset.finalize()
        read = self._kind(self._name, root=self._options.out)
        start = 0
        for episode, (states, actions, picture) in enumerate(self._written):
            middle = len(states) // 2
            for k in (0, middle, len(states) - 1):
                frame = read[start + k]
                for name, written in ((_STATE, states[k]), (_ACTION, actions[k])):
                    same = np.array_equal(np.asarray(frame[name]), written.astype(np.float32))
                    self._demand(same, f"{name} of frame {k} of episode {episode}")
                at = int(frame["episode_index"]), int(frame["frame_index"])
                self._demand(at == (episode, k), f"place of frame {k} of episode {episode}")
                if k == middle:
                    # Read as (channels, height, width) from 0 to 1.
                    seen = 255.0 * np.asarray(frame[_PICTURE]).transpose(1, 2, 0)
                    off = float(np.abs(seen - picture).mean())
                    self._demand(off < _CODEC_ERROR, f"picture of episode {episode}")
            start += len(states)
        self._demand(len(read) == start, "number of frames")
        return start

    def _demand(self, same: bool, what: str) -> None:
        if not same:
            raise RecordingError(f"{self._options.out} does not read as it was written: {what}.")


def run(options: DemoOptions, console: Console) -> int:
    """Record the episodes; return the exit code."""
    task, kind = load_task(options.task)(), lerobot_dataset()
    simulation = Simulation(PANDA, task.build_scene)
    simulation.model.vis.quality.shadowsize = 0  # shadows take most of the time
    camera = OffscreenCamera(simulation.model, "overview", options.size[1], options.size[0])
    dataset, done = Dataset(kind, options, PANDA), 0
    attempts = 2 * options.episodes if options.attempts is None else options.attempts
    try:
        for seed in range(options.seed, options.seed + attempts):
            frames = Frames(camera)
            scenario = ClassicalStack().scenario(PANDA, task, seed)
            result = Runner(scenario, simulation).run(observers=[frames])
            if result.failure is None:
                dataset.add(result, frames)
                done += 1
                console.print(f"seed {seed}: episode {done} of {options.episodes}")
            else:
                console.print(f"seed {seed}: left out: {result.failure.evidence}", markup=False)
            if done == options.episodes:
                break
    finally:
        # An interruption loses none of the episodes that were saved.
        camera.close()
        if done:
            count = dataset.close()
            told = f"{count} frames of {done} episodes in {options.out}, read back and compared"
            console.print(told, soft_wrap=True)
        else:
            shutil.rmtree(options.out, ignore_errors=True)
            console.print("no attempt succeeded: nothing was written")
    return OK if done == options.episodes else FAILED


if __name__ == "__main__":
    sys.exit(main(DemoOptions, run, __doc__))
