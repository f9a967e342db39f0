"""A client of libfranka that picks a cube and places it, with pylibfranka and nothing of robo47_qp.

It runs in any environment with pylibfranka and numpy, against `robo47 serve-franka` as against an
arm, and is told where cube and goal are: x, y [m] and heading [rad].
"""

import sys
from argparse import ArgumentParser
from collections.abc import Callable
from typing import Any

import numpy as np
import pylibfranka as franka

UP, ON_TABLE = 0.16, 0.02
"""Heights of the tool on the way, and where it grasps and releases [m]."""
HOME = (0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4)
DOWN = np.diag([1.0, -1.0, -1.0])
_SPEED, _TURN = 0.15, 0.6
"""Mean speed of the tool [m/s] and of its turn [rad/s]."""


def blend(share: float) -> float:
    """Smoothly from 0 to 1, at rest at both ends up to the acceleration."""
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def follow(control: Any, seconds: float, command: Callable[[float], Any]) -> None:
    """Send a command for every period of a motion, from share 0 to 1 of it."""
    steps = max(2, round(1000 * seconds))
    for i in range(steps + 1):
        control.readOnce()
        now = command(blend(i / steps))
        now.motion_finished = i == steps
        control.writeOnce(now)


def turned(vector: np.ndarray) -> np.ndarray:
    """The rotation about a vector by its length (3, 3)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    R: np.ndarray = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return R


def turn_of(R: np.ndarray) -> np.ndarray:
    """The vector of a rotation by less than half a turn (3,)."""
    axis = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.zeros(3)
    vector: np.ndarray = axis / sine * np.arctan2(sine, 0.5 * (np.trace(R) - 1.0))
    return vector


def pose_motion(robot: Any, position: np.ndarray, heading: float) -> None:
    """Move the tool on a straight line to a position, pointing down with a heading."""
    # The commanded pose, not the measured one: a motion begins where the last one was to end.
    start = np.array(robot.read_once().O_T_EE_c).reshape(4, 4).T
    way = position - start[:3, 3]
    turn = turn_of(start[:3, :3].T @ turned(np.array([0.0, 0.0, heading])) @ DOWN)
    seconds = 0.8 + max(float(np.linalg.norm(way)) / _SPEED, float(np.linalg.norm(turn)) / _TURN)

    def at(share: float) -> Any:
        T = np.eye(4)
        T[:3, :3] = start[:3, :3] @ turned(share * turn)
        T[:3, 3] = start[:3, 3] + share * way
        return franka.CartesianPose(T.T.ravel().tolist())

    follow(robot.start_cartesian_pose_control(franka.ControllerMode.JointImpedance), seconds, at)


def joint_motion(robot: Any, q_goal: np.ndarray) -> None:
    """Move the joints to positions (7,) [rad]."""
    q_start = np.array(robot.read_once().q_d)
    seconds = 0.5 + 2.5 * float(np.abs(q_goal - q_start).max())

    def at(share: float) -> Any:
        return franka.JointPositions((q_start + share * (q_goal - q_start)).tolist())

    follow(robot.start_joint_position_control(franka.ControllerMode.JointImpedance), seconds, at)


def quarter(angle: float) -> float:
    """The nearest heading to 0 at which a cube looks as at this one."""
    return float((angle + np.pi / 4) % (np.pi / 2) - np.pi / 4)


def pick_and_place(host: str, pick: tuple[float, ...], place: tuple[float, ...]) -> bool:
    """Do it; return whether the hand has told of a grasp."""
    robot = franka.Robot(host, franka.RealtimeConfig.kIgnore)
    hand = franka.Gripper(host)
    hand.move(0.08, 0.1)
    grasped = False
    for (x, y, heading), closes in ((pick, True), (place, False)):
        pose_motion(robot, np.array([x, y, UP]), quarter(heading))
        pose_motion(robot, np.array([x, y, ON_TABLE]), quarter(heading))
        if closes:
            grasped = bool(hand.grasp(0.04, 0.05, 30.0, 0.005, 0.005))
        else:
            hand.move(0.08, 0.1)
        pose_motion(robot, np.array([x, y, UP]), quarter(heading))
    joint_motion(robot, np.array(HOME))
    return grasped


def main() -> int:
    parser = ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--host", default="127.0.0.1")
    for name, y in (("--pick", 0.2), ("--place", -0.2)):
        parser.add_argument(name, type=float, nargs=3, default=(0.4, y, 0.0))
    given = parser.parse_args()
    grasped = pick_and_place(given.host, tuple(given.pick), tuple(given.place))
    print("grasped" if grasped else "nothing was grasped")
    return 0 if grasped else 1


if __name__ == "__main__":
    sys.exit(main())
