"""A client of libfranka that picks a cube and places it, with franky and nothing of robo47_qp.

It runs in any environment with franky-control and numpy, against `robo47 serve-franka` as against
an arm, and is told where cube and goal are: x, y [m] and heading [rad].
"""

import sys
from argparse import ArgumentParser
from typing import Any

import franky
import numpy as np

UP, ON_TABLE = 0.16, 0.02
"""Heights of the tool on the way, and where it grasps and releases [m]."""
HOME = [0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4]
_PACE = 0.07
"""Share of the arm's own limits of the tool's velocity, acceleration and jerk [-]. Nothing in franky
looks at the joints: at 0.1, a line of one of twenty episodes takes one beyond its 10 rad/s²."""


def down(x: float, y: float, z: float, heading: float) -> Any:
    """A motion of the tool on a straight line, to a pose in which it points down."""
    turn = [np.cos(0.5 * heading), np.sin(0.5 * heading), 0.0, 0.0]
    return franky.CartesianMotion(franky.Affine([x, y, z], turn))


def quarter(angle: float) -> float:
    """The nearest heading to 0 at which a cube looks as at this one."""
    return float((angle + np.pi / 4) % (np.pi / 2) - np.pi / 4)


def pick_and_place(host: str, pick: tuple[float, ...], place: tuple[float, ...]) -> bool:
    """Do it; return whether the hand has told of a grasp."""
    robot = franky.Robot(host, _PACE, realtime_config=franky.RealtimeConfig.Ignore)
    hand = franky.Gripper(host)
    hand.open(0.1)
    grasped = False
    for (x, y, heading), closes in ((pick, True), (place, False)):
        robot.move(down(x, y, UP, quarter(heading)))
        robot.move(down(x, y, ON_TABLE, quarter(heading)))
        if closes:
            grasped = hand.grasp(0.04, 0.05, 30.0)
        else:
            hand.open(0.1)
        robot.move(down(x, y, UP, quarter(heading)))
    robot.move(franky.JointMotion(HOME))
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
