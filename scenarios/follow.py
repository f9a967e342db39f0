"""The tool follows a target: dragged with the mouse, moved by keys, or along a recorded hand path.

With --viewer a window of MuJoCo shows the arm and the target, a ball. Hold Ctrl and drag with the
mouse: the right button moves it, the left button turns it; a double-click selects it again. Arrows
and Page Up/Down move it, comma and period turn it, Home brings it back. The run ends when the
window is closed, after --seconds, or with Ctrl-C; the arm then comes to rest and the recording is
completed. Without --viewer the target moves along the hand path of a file.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from robo47_qp.report.importing import importing

with importing():
    import mujoco
    from rich.console import Console

    from robo47_qp.cli import INTERRUPTED, LOGS, OK, RunOptions, main, one_of, run_task
    from robo47_qp.errors import InvalidValueError
    from robo47_qp.model.robots import load_robot, robot_names
    from robo47_qp.run.failure import Failure
    from robo47_qp.run.task import Program, Task
    from robo47_qp.run.teleop.driver import LONGEST, TARGET, TeleopDriver, TeleopSettings
    from robo47_qp.run.teleop.hand_path import read_hand_path
    from robo47_qp.run.teleop.steering import HELP
    from robo47_qp.sim.sensed import Sensed
    from robo47_qp.sim.simulation import Simulation
    from robo47_qp.stack import CONTROLLERS, ClassicalStack
    from robo47_qp.tasks.table import TABLE, add_table

HAND_PATH = Path(__file__).with_name("hand_path.csv")
"""The path that is followed where none is chosen."""
BY_HAND = 60.0
"""Longest time that a person has, if no other is chosen [s]."""


@dataclass(frozen=True, kw_only=True)
class FollowOptions:
    """Options of this scenario."""

    robot: Annotated[str, one_of(robot_names())] = "panda"
    """Robot; iiwa14 and xarm7 take their model from MuJoCo Menagerie."""
    controller: Annotated[str, one_of([*CONTROLLERS])] = ClassicalStack.controller
    """Controller that tracks what streaming inverse kinematics commands."""
    seconds: float | None = None
    """Time after which it ends, at most 590 [s]; without it, the time of the path, or 60 s by
    hand."""
    path: Path | None = None
    """Hand path to follow: a text file with a line "t,x,y,z,rx,ry,rz" and a line per pose;
    without it and without --viewer, scenarios/hand_path.csv."""
    viewer: bool = False
    """Open MuJoCo's viewer, in which the target is moved by hand unless --path is given; needs a
    display."""
    speed: float = ClassicalStack.pace
    """Pace, 0.01 to 1: part of the arm's motion limits to use."""
    clearance: float = TeleopSettings.clearance
    """Distance to keep between links and from the table [m]."""
    log: Path = LOGS / "follow.rrd"
    """Recording to write; report and plot go beside it, with the endings .json and .png."""
    json: bool = False
    """Print the report as JSON on the standard output and nothing else."""

    def __post_init__(self) -> None:
        """Check what no type can.

        Raises:
            InvalidValueError: A number is out of range, or the recording has the wrong ending.
            UnknownNameError: No controller has the name.
        """
        self.run_options  # noqa: B018  # checks its settings
        if self.seconds is not None and not 0.0 < self.seconds <= LONGEST:
            expected = f"above 0 and at most {LONGEST:g} [s]"
            raise InvalidValueError("--seconds", self.seconds, expected)
        if not 0.0 <= self.clearance < 0.05:
            expected = "at least 0 and below 0.05 [m]"
            raise InvalidValueError("--clearance", self.clearance, expected)

    @property
    def run_options(self) -> RunOptions:
        """The same, as options of a run."""
        return RunOptions(
            robot=self.robot,
            controller=self.controller,
            speed=self.speed,
            log=self.log,
            viewer=self.viewer,
            json=self.json,
        )

    def settings(self) -> TeleopSettings:
        """Return what is followed, and how.

        Raises:
            RecordingError, InvalidValueError: The path cannot be read, or is none.
        """
        file = HAND_PATH if self.path is None and not self.viewer else self.path
        path = None if file is None else read_hand_path(file)
        usual = BY_HAND if path is None else min(path.duration + 1.0, LONGEST)
        return TeleopSettings(
            seconds=usual if self.seconds is None else self.seconds,
            path=path,
            clearance=self.clearance,
            obstacles=(TABLE,),
        )


@dataclass(frozen=True, kw_only=True)
class Follow(Task):
    """A table, and a target above it; the driver moves the arm, and nothing is judged."""

    name: str = "follow"

    @property
    def time_limit(self) -> float:
        """See `Task.time_limit` [s]."""
        return LONGEST + 20.0

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`; the target is a ball with the axes of the tool."""
        add_table(spec)
        target = spec.worldbody.add_body(name=TARGET, mocap=True)
        target.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[0.05, 0.0, 0.0],
            rgba=[0.9, 0.3, 0.5, 0.4],
            contype=0,
            conaffinity=0,
        )
        for axis in range(3):
            end, colour = [0.0] * 3, [0.2, 0.2, 0.2, 1.0]
            end[axis], colour[axis] = 0.09, 0.9
            target.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[0.0, 0.0, 0.0, *end],
                size=[0.005, 0.0, 0.0],
                rgba=colour,
                contype=0,
                conaffinity=0,
            )

    def program(self, sensed: Sensed) -> Program:
        """Yield nothing: a driver moves the arm."""
        yield from ()
        return None

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`: where the target was, is up to who moved it."""
        return None


def run(options: FollowOptions, console: Console) -> int:
    """Follow the target, record it, and say how it went; returns the exit code."""
    driver = TeleopDriver(options.settings())
    if options.viewer and options.path is None:
        console.print(HELP, highlight=False)
    robot = load_robot(options.robot)
    code = run_task(Follow(), robot, options.run_options, console, driver)
    return INTERRUPTED if driver.interrupted and code == OK else code


if __name__ == "__main__":
    sys.exit(main(FollowOptions, run, __doc__))
