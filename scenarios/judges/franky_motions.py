"""A client of libfranka that reads, moves and grasps with franky, and says what came of it (JSON).

It runs in any environment with franky-control and numpy, against `robo47 serve-franka` as against
an arm, which needs some centimetres of room about it.
"""

import json
import sys
import time
from argparse import ArgumentParser
from typing import Any

import franky
import numpy as np

_PACE = 0.1
"""Share of the arm's own limits of velocity, acceleration and jerk [-]."""


def motions(host: str) -> dict[str, Any]:
    """Make one motion of each kind; return by how much the arm is off, and what the hand says."""
    robot = franky.Robot(host, _PACE, realtime_config=franky.RealtimeConfig.Ignore)
    hand = franky.Gripper(host)
    told: dict[str, Any] = {"home": list(robot.state.q), "mode": str(robot.state.robot_mode)}
    q = np.array(robot.state.q) + 0.02
    robot.move(franky.JointMotion(q))
    told["joints"] = float(np.abs(np.array(robot.state.q) - q).max())
    start = np.array(robot.state.O_T_EE.translation)
    up = franky.Affine([0.0, 0.0, -0.02])
    robot.move(franky.CartesianMotion(up, franky.ReferenceType.Relative))
    risen = np.array(robot.state.O_T_EE.translation) - start
    told["tool"] = float(abs(np.linalg.norm(risen) - 0.02))
    robot.move(franky.JointVelocityMotion([0.0] * 6 + [0.05], franky.Duration(200)))
    robot.move(franky.JointVelocityStopMotion())
    told["turned"] = float(robot.state.q[6] - q[6])
    held = np.array(robot.state.q)
    robot.move(franky.JointImpedanceMotion(held), asynchronous=True)
    time.sleep(0.5)
    told["controls"] = bool(robot.is_in_control)
    robot.stop()
    told["torques"] = float(np.abs(np.array(robot.state.q) - held).max())
    told["opened"] = bool(hand.move(0.06, 0.1))
    told["width"] = float(hand.width)
    told["grasped"] = bool(hand.grasp(0.04, 0.1, 20.0))
    return told


if __name__ == "__main__":
    parser = ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--host", default="127.0.0.1")
    print(json.dumps(motions(parser.parse_args().host)))
    sys.exit(0)
