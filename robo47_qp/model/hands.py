"""Hands that arms can be given: their MJCF files and grippers."""

from pathlib import Path

from robo47_qp.errors import UnknownNameError
from robo47_qp.model.gripper import Gripper
from robo47_qp.model.robot import Hand

_MODELS = Path(__file__).parent / "robots" / "models"
TCP = f"{Hand.PREFIX}tcp"
"""Name of the tool frame of each of them."""


def _gripper(width_max: float, speed_max: float, force_max: float) -> Gripper:
    return Gripper(
        joints=("finger_joint1", "finger_joint2"),
        fingers=("left_finger", "right_finger"),
        actuator="gripper",
        width_max=width_max,
        speed_max=speed_max,
        force_max=force_max,
        force_gain=1.0,
    )


FRANKA_HAND = _gripper(0.08, 0.1, 70.0)
"""Gripper of `franka_hand.xml`."""
PARALLEL_GRIPPER = _gripper(0.095, 0.136, 160.0)
"""Gripper of `parallel_gripper.xml`, with the data of a DH-Robotics AG-95."""
XARM_GRIPPER = _gripper(0.085, 0.1, 30.0)
"""Gripper of `xarm_gripper.xml`; its speed is a choice."""


FILES: dict[str, tuple[Path, Gripper]] = {
    "franka_hand": (_MODELS / "franka_hand.xml", FRANKA_HAND),
    "parallel_gripper": (_MODELS / "parallel_gripper.xml", PARALLEL_GRIPPER),
    "xarm_gripper": (_MODELS / "xarm_gripper.xml", XARM_GRIPPER),
}
"""The hands by name, each with its file."""


def hand(name: str, site: str, turn: float = 0.0) -> Hand:
    """Return a hand of the package at a site of an arm; see `Hand`.

    Raises:
        UnknownNameError: No hand has this name.
    """
    if name not in FILES:
        raise UnknownNameError("hand", name, tuple(FILES))
    mjcf, gripper = FILES[name]
    return Hand(mjcf=mjcf, site=site, turn=turn, gripper=gripper)
