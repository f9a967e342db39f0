"""ClassicalStack: inverse kinematics, planner and controller from a few settings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import mujoco

from robo47_qp.control.cartesian_impedance import CartesianImpedance
from robo47_qp.control.computed_torque import ComputedTorque
from robo47_qp.control.controller import Controller
from robo47_qp.control.joint_impedance import JointImpedance
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.control.operational_space import OperationalSpace
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.ik.dls import TUNED
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import IkSolver
from robo47_qp.model.obstacle import Obstacle, add_obstacle
from robo47_qp.model.ratings import profile_at_ratings
from robo47_qp.model.robot import Robot
from robo47_qp.motion.branch_choice import BranchChoice
from robo47_qp.motion.collision_check import Collisions, Surroundings
from robo47_qp.motion.detour import Detour
from robo47_qp.motion.motor_share import MotorShare
from robo47_qp.motion.paths.segments import PathProfile
from robo47_qp.motion.planner import Planner
from robo47_qp.run.scenario import Scenario
from robo47_qp.run.task import Task

IK_SOLVERS: dict[str, Callable[[str, float | None], IkSolver]] = {
    "mink": lambda backend, clearance: MultiStart(
        solver=MinkIk(backend=backend, max_iterations=30, stall=Stall(), clearance=clearance)
    ),
    "qp": lambda backend, clearance: MultiStart(
        solver=QpIk(backend=backend, max_iterations=30, stall=Stall(), clearance=clearance)
    ),
    "lm": lambda _, clearance: MultiStart(
        solver=LmIk(max_iterations=20, stall=Stall(), clearance=clearance)
    ),
    "dls": lambda _, clearance: MultiStart(solver=replace(TUNED, clearance=clearance)),
    "mink-single": lambda backend, clearance: MinkIk(backend=backend, clearance=clearance),
    "qp-single": lambda backend, clearance: QpIk(backend=backend, clearance=clearance),
    "lm-single": lambda _, clearance: LmIk(clearance=clearance),
    "dls-single": lambda _, clearance: replace(TUNED, clearance=clearance),
}
"""Inverse kinematics by name, made from the name of a QP solver and the distance to keep from
obstacles [m] (None: obstacles are ignored). Solvers that are restarted give a start up early;
those of a single start are more patient."""
QP_SOLVERS = ("daqp", "osqp")
BY_QP = ("mink", "qp")
"""Inverse kinematics whose QP solver can be chosen."""

CONTROLLERS: dict[str, Callable[[], Controller]] = {
    "computed_torque": ComputedTorque,
    "joint_impedance": JointImpedance,
    "cartesian_impedance": CartesianImpedance,
    "operational_space": OperationalSpace,
}
"""Controllers by name."""
PROFILES = ("gentle", "rated")
"""Bounds of all motions by name: the robot's own profile with a slow tool on its paths, or as fast
as ratings and motors allow."""
_RATED_TOOL = PathProfile(linear=(1.7, 13.0, 6500.0), angular=(2.5, 25.0, 12500.0))
"""Bounds of the tool on its paths where joints may move as fast as they are rated for: those that
Franka Robotics gives its arms (Franka Control Interface, robot limits); joints bound it before."""
PACE_MIN = 0.01
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


def solves_qp(ik: str) -> bool:
    """Return whether the QP solver of an inverse kinematics can be chosen, by its name."""
    return ik.removesuffix("-single") in BY_QP


@dataclass(frozen=True, kw_only=True)
class ClassicalStack:
    """Settings of the classical stack, from which it makes the parts that run a task."""

    ik: str = "mink"
    """Inverse kinematics, a name of `IK_SOLVERS`."""
    qp_solver: str = "daqp"
    """Solver of the quadratic programs of "mink" and "qp", a name of `QP_SOLVERS`."""
    controller: str = "computed_torque"
    """Controller, a name of `CONTROLLERS`."""
    observer: DisturbanceObserver | None = DisturbanceObserver()
    """What estimates the joints' state and compensates what disturbs them; None takes the state
    as it is measured, and leaves disturbances to the controller."""
    profile: str = "gentle"
    """Bounds of all motions, a name of `PROFILES`."""
    pace: float = 1.0
    """Pace of all motions, 0.01 to 1: at 0.5 they take twice the time."""

    def __post_init__(self) -> None:
        """Check the names and the pace.

        Raises:
            UnknownNameError: No solver, controller or profile has this name.
            InvalidValueError: The pace is out of range, or a QP solver is named that is not used.
        """
        for kind, name, known in (
            ("inverse kinematics", self.ik, IK_SOLVERS),
            ("QP solver", self.qp_solver, QP_SOLVERS),
            ("profile", self.profile, PROFILES),
            ("controller", self.controller, CONTROLLERS),
        ):
            if name not in known:
                raise UnknownNameError(kind, name, known)
        if not PACE_MIN <= self.pace <= 1.0:
            raise InvalidValueError("pace", self.pace, f"between {PACE_MIN} and 1")
        if self.qp_solver != QP_SOLVERS[0] and not solves_qp(self.ik):
            expected = f"left out unless the inverse kinematics is {' or '.join(BY_QP)}"
            raise InvalidValueError("qp_solver", self.qp_solver, expected)

    def solver(self, clearance: float | None = None) -> IkSolver:
        """Return the inverse kinematics.

        Args:
            clearance: Distance to keep from declared obstacles [m]; None ignores them.
        """
        return IK_SOLVERS[self.ik](self.qp_solver, clearance)

    def planner(self, robot: Robot, task: Task) -> Planner:
        """Return the planner for a task: it plans around the obstacles that the task declares.

        Without any, it refuses motions in which the arm would touch itself, and PTP motions
        that would touch what stands in the scene, and chooses configurations accordingly.
        """
        planner = Planner(ik=self.solver(), profile=robot.profile, pace=self.pace)
        if self.profile == "rated":
            planner = replace(
                planner,
                profile=profile_at_ratings(robot.rated),
                motors=MotorShare(),
                lin=replace(planner.lin, profile=_RATED_TOOL),
                continuous=replace(planner.continuous, profile=_RATED_TOOL),
            )
        if not task.obstacles:
            itself = _itself(robot)
            return replace(
                planner,
                collisions=itself,
                surroundings=Collisions(
                    robot, task.build_scene, clearance=_LEAST_CLEARANCE, touched_at_home=True
                ),
                branch_choice=BranchChoice(collisions=itself),
            )
        around = _adding(task.obstacles)
        collisions = Collisions(robot, around, clearance=_WAY_CLEARANCE)
        return replace(
            planner,
            ik=self.solver(_IK_CLEARANCE),
            collisions=collisions,
            branch_choice=BranchChoice(collisions=collisions),
            detour=Detour(roomy=Collisions(robot, around, clearance=_SEARCH_CLEARANCE)),
        )

    def scenario(self, robot: Robot, task: Task, seed: int | None = None) -> Scenario:
        """Return a task as this stack runs it.

        Args:
            robot: The robot that does it.
            task: What is to be done.
            seed: Seed of the random start; None takes the default start.

        Raises:
            InvalidValueError: The robot cannot do the task; see `Task.check_robot`.
        """
        task.check_robot(robot)
        return Scenario(
            robot=robot,
            task=task,
            planner=self.planner(robot, task),
            controller=CONTROLLERS[self.controller](),
            observer=self.observer,
            seed=seed,
        )


@lru_cache(maxsize=8)
def _itself(robot: Robot) -> Collisions:
    return Collisions(robot, _adding(()), clearance=_LEAST_CLEARANCE)


def _adding(obstacles: Sequence[Obstacle]) -> Surroundings:
    def add(spec: mujoco.MjSpec) -> None:
        for obstacle in obstacles:
            add_obstacle(spec, obstacle)

    return add
