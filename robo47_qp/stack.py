"""Options that every scenario of one run shares."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias

import mujoco

from robo47_qp.control.joint_impedance import JointImpedance
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.settings import Stall
from robo47_qp.ik.solver import IkSolver
from robo47_qp.model.obstacle import Obstacle, add_obstacle
from robo47_qp.model.robot import Robot
from robo47_qp.motion.branch_choice import BranchChoice
from robo47_qp.motion.collision_check import Collisions, Surroundings
from robo47_qp.motion.detour import Detour
from robo47_qp.motion.planner import Planner
from robo47_qp.run.scenario import Scenario
from robo47_qp.run.task import Task

IkName: TypeAlias = Literal["qp", "lm", "dls", "qp-single", "lm-single", "dls-single"]
"""Inverse kinematics that can be chosen: with restarts, or from a single start."""
SINGLE = "-single"
"""How the names without restarts end."""
LOGS = Path(__file__).resolve().parents[1] / "logs"
"""Where recordings go unless another place is named."""
_SLOWEST = 0.01
"""A run at this pace takes 100 times as long."""
_IK_CLEARANCE = 0.01
"""Distance that inverse kinematics keeps from declared obstacles at the ends of motions [m]."""
_SEARCH_CLEARANCE = 0.009
"""Distance that is kept while a way around is sought [m]."""
_WAY_CLEARANCE = 0.005
"""Distance that is kept on the way [m]."""
_LEAST_CLEARANCE = 0.002
"""Distance that links keep from each other where no obstacles are declared, and on PTP motions
from what stands in the scene [m]."""


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """What can be chosen for one run."""

    ik: IkName = "qp"
    """Inverse kinematics: mink's QP inside the joint limits, the faster Levenberg-Marquardt
    inside them, or damped least squares clamped to them. Each starts from home and is restarted
    from other configurations, at most 100 times, where it gets stuck; the names with -single
    start from home alone, with the more patient settings of a solver without restarts (100 QPs,
    200 steps of dls), and offer one configuration per goal where the others offer several. Among
    obstacles qp and lm step around what is in the way; dls has its answers looked at, and those
    too close to anything refused. Straight lines are followed from one start per point with any
    of them, and where one fails, a slower search near it helps."""
    qp_solver: Literal["daqp", "osqp"] = "daqp"
    """QP solver for --ik qp and qp-single."""
    seed: int | None = None
    """Draw what the task leaves open, as starts and goals, at random from this seed; without it,
    the default ones are used."""
    speed: float = 1.0
    """Pace, 0.01 to 1: at 0.5 the motions take twice the time."""
    log: Path = LOGS / "run.rrd"
    """Recording to write; the report goes beside it, with the ending .json."""
    plot: Path | None = None
    """Picture of path and errors to write (PNG); by default beside the recording."""
    video: Path | None = None
    """Video to write (mp4); needs the extra "video" and OpenGL."""
    live: bool = False
    """Also show the recording in a viewer while it runs, at the pace of real time."""
    realtime: bool = False
    """Run no faster than real time."""
    viewer: bool = False
    """Open MuJoCo's interactive viewer and run no faster than real time; needs a display."""
    visuals: Literal["primitives", "menagerie"] = "primitives"
    """Looks of the robot: its own simple shapes, or the meshes of MuJoCo Menagerie (needs the
    extra "visuals"). The physics is the same."""
    json: bool = False
    """Print the report as JSON on the standard output and nothing else."""

    def __post_init__(self) -> None:
        """Check what no type can.

        Raises:
            InvalidValueError: A number is out of range, or a file has the wrong ending.
        """
        if not _SLOWEST <= self.speed <= 1.0:
            raise InvalidValueError("--speed", self.speed, f"between {_SLOWEST} and 1")
        if self.seed is not None and self.seed < 0:
            raise InvalidValueError("--seed", self.seed, "0 or more")
        if self.qp_solver != "daqp" and self.ik.removesuffix(SINGLE) != "qp":
            expected = "left out unless --ik is qp or qp-single"
            raise InvalidValueError("--qp-solver", self.qp_solver, expected)
        files = {"--log": (self.log, ".rrd"), "--plot": (self.plot, ".png")}
        files["--video"] = (self.video, ".mp4")
        for option, (path, ending) in files.items():
            if path is not None and path.suffix != ending:
                raise InvalidValueError(option, path, f"a file that ends with {ending}")

    @property
    def paced(self) -> bool:
        """True where the run must not go faster than real time."""
        return self.realtime or self.live or self.viewer

    def solver(self, clearance: float | None = None) -> IkSolver:
        """The IK that was chosen.

        Args:
            clearance: Distance to keep from declared obstacles [m]; None looks at none.
        """
        if self.ik.endswith(SINGLE):
            return self._single(clearance)
        return MultiStart(solver=self._hasty(clearance))

    def _single(self, clearance: float | None) -> IkSolver:
        """What has one start only, and does not give it up early."""
        if self.ik == "dls-single":
            return DlsIk(clearance=clearance)
        if self.ik == "lm-single":
            return LmIk(clearance=clearance)
        return QpIk(backend=self.qp_solver, clearance=clearance)

    def _hasty(self, clearance: float | None) -> IkSolver:
        """What is restarted; lm and qp give up a start early."""
        if self.ik == "dls":
            return DlsIk(clearance=clearance)
        if self.ik == "lm":
            return LmIk(max_iterations=20, stall=Stall(), clearance=clearance)
        return QpIk(backend=self.qp_solver, max_iterations=30, stall=Stall(), clearance=clearance)

    def scenario(self, robot: Robot, task: Task) -> Scenario:
        """The scenario that was chosen; declared obstacles are planned around.

        Without any, motions in which the arm would touch itself are refused, and so are PTP motions
        that would touch what stands in the scene; configurations are chosen accordingly.

        Raises:
            MissingExtraError: There are obstacles and what plans around them is not installed.
        """
        planner = Planner(ik=self.solver(), profile=robot.profile, pace=self.speed)
        if task.obstacles:
            around = _around(task.obstacles)
            collisions = Collisions(robot, around, clearance=_WAY_CLEARANCE)
            planner = replace(
                planner,
                ik=self.solver(_IK_CLEARANCE),
                collisions=collisions,
                branch_choice=BranchChoice(collisions=collisions),
                detour=Detour(roomy=Collisions(robot, around, clearance=_SEARCH_CLEARANCE)),
            )
        else:
            itself = Collisions(robot, _around(()), clearance=_LEAST_CLEARANCE)
            planner = replace(
                planner,
                collisions=itself,
                surroundings=Collisions(robot, task.build_scene, clearance=_LEAST_CLEARANCE),
                branch_choice=BranchChoice(collisions=itself),
            )
        return Scenario(
            robot=robot,
            task=task,
            planner=planner,
            controller=JointImpedance(),
            seed=self.seed,
        )


def _around(obstacles: Sequence[Obstacle]) -> Surroundings:
    def add(spec: mujoco.MjSpec) -> None:
        for obstacle in obstacles:
            add_obstacle(spec, obstacle)

    return add
