"""What a file ties joints together by: an arm's joints must be free of each other."""

from collections.abc import Iterator, Sequence
from typing import Any

import mujoco

from robo47_qp.errors import ModelError
from robo47_qp.model.robot import Robot


def check_untied(robot: Robot, spec: mujoco.MjSpec) -> None:
    """Check that no equality of a file ties joints of the arm to anything.

    Inverse kinematics and motions would set each of them alone, and the arm would not follow.
    What ties the fingers of a gripper moves no joint of the arm. A joint that follows one of the
    arm's, and is welded as the arm has no gripper, ties nothing.

    Raises:
        ModelError: One does.
    """
    for tie in spec.equalities:
        joints = sorted(_tied(robot, spec, tie), key=robot.joints.index)
        if tie.active and joints:
            kind = tie.type.name.removeprefix("mjEQ_").lower()
            raise ModelError(
                f"Robot {robot.name!r} has an equality of kind {kind} that ties "
                f"{', '.join(joints)}. Joints of an arm must be free of each other: take it out "
                "of the file, or weld all but one of them."
            )


def _tied(robot: Robot, spec: mujoco.MjSpec, tie: mujoco.MjsEquality) -> set[str]:
    """Return the joints of the arm whose motion an equality restricts."""
    names = [name for name in (tie.name1, tie.name2) if name]
    if tie.type == mujoco.mjtEq.mjEQ_JOINT:
        return _among(robot, names)
    if tie.type == mujoco.mjtEq.mjEQ_TENDON:
        paths: list[Any] = [tendon.path for tendon in spec.tendons if tendon.name in names]
        return _among(robot, [wrap.target.name for path in paths for wrap in path if wrap.target])
    if tie.type not in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
        return set()
    sites: Sequence[Any] = spec.sites if tie.objtype == mujoco.mjtObj.mjOBJ_SITE else ()
    on = {site.name: site.parent for site in sites} or {one.name: one for one in spec.bodies}
    moved = [{*_movers(robot, on[name])} for name in names]
    # A joint that moves both moves them alike; of one that is tied to the world, all do not.
    return moved[0] ^ (moved[1] if len(moved) > 1 else set())


def _among(robot: Robot, joints: Sequence[str]) -> set[str]:
    """Return which joints of the arm are among tied ones; none where all others are welded."""
    own = {*joints} & {*robot.joints}
    welded = len(own) == 1 < len(joints) and not robot.grippers
    return set() if welded else own


def _movers(robot: Robot, body: Any) -> Iterator[str]:
    while body is not None:
        yield from (joint.name for joint in body.joints if joint.name in robot.joints)
        body = body.parent
