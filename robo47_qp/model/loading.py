"""Robots from any MJCF file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from robo47_qp.arrays import Range, Vector, checked_vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError, ModelError, UnknownNameError
from robo47_qp.model import ratings as defaults
from robo47_qp.model.arm import Arm
from robo47_qp.model.gripper import Gripper
from robo47_qp.model.menagerie import menagerie_file
from robo47_qp.model.mjcf import compiled, spec_with_hand
from robo47_qp.model.robot import Hand, MotionProfile, Robot, ToolFrame


@dataclass(frozen=True, kw_only=True, eq=False)
class Ratings:
    """Known ratings of a robot; None takes the default of module `ratings`."""

    rated: MotionProfile | None = None
    """See `Robot.rated`."""
    profile: MotionProfile | None = None
    """See `Robot.profile`."""
    tau_max: ArrayLike | None = None
    """Torque limits (n,) [N·m]; None takes those of the file's actuators, where it has them."""
    tau_rate_max: ArrayLike | None = None
    """Torque-rate limits (n,) [N·m/s]."""
    stiffness: ArrayLike | None = None
    """Joint impedance stiffness (n,) [N·m/rad]."""


_NOTHING_KNOWN = Ratings()


def robot_from_mjcf(
    mjcf: Path | str,
    *,
    tcp: str | ToolFrame,
    home: ArrayLike,
    name: str | None = None,
    joints: Sequence[str] | None = None,
    gripper: Gripper | Hand | None = None,
    ratings: Ratings = _NOTHING_KNOWN,
) -> Robot:
    """Return an arm from a file, with torque motors in place of the file's actuators.

    Args:
        mjcf: The file.
        tcp: The tool frame: a site of the file, or a pose on one of its bodies.
        home: Rest configuration (n,) [rad; m where a joint slides].
        name: Name of the robot; None takes that of the file.
        joints: The arm's joints, base to tip; None takes all between the world and the tool.
        gripper: The gripper of the file, or a hand with a file of its own, whose names then begin
            with "hand_"; with None, all joints except the arm's are welded.
        ratings: Known ratings.

    Raises:
        UnknownNameError: The file lacks the site, a body or a joint.
        InvalidValueError: A vector is not of n finite numbers, home is outside the limits, no joint
            is named, or one twice, or the fingers do not open along the tool's y axis.
        ModelError: The file does not exist, MuJoCo cannot read it, or it holds no arm.
    """
    path = Path(mjcf)
    if not path.is_file():
        raise ModelError(f"The robot's model {path} is no file. Give the path of an MJCF file.")
    hand = gripper if isinstance(gripper, Hand) else None
    if isinstance(gripper, Hand):
        gripper = gripper.gripper.prefixed(Hand.PREFIX)
    spec = spec_with_hand(path, hand)
    site, tool = _tool_frame(spec, tcp)
    chain = _chain(spec, site, tool) if joints is None else _named(joints)
    kinds = {joint.name: joint.type for joint in spec.joints}
    n, still = len(chain), MotionProfile.uniform(len(chain), v=1.0, a=1.0, j=1.0)
    draft = Robot(
        name=path.stem if name is None else name,
        mjcf=path.resolve(),
        joints=chain,
        slides=tuple(j for j in chain if kinds.get(j) == mujoco.mjtJoint.mjJNT_SLIDE),
        motors=tuple(f"{joint}_torque" for joint in chain),
        has_motors=False,
        tcp=site,
        tool=tool,
        home=checked_vector("home", home, n),
        rated=still,
        profile=still,
        tau_max=np.ones(n),
        tau_rate_max=np.ones(n),
        stiffness=np.ones(n),
        gripper=gripper,
        hand=hand,
    )
    model, arm = compiled(spec, path), Arm(draft)
    if gripper is not None:
        _check_fingers(gripper, model, arm)
    return _rated(draft, arm, _file_torques(model, chain), ratings)


def robot_from_menagerie(
    model: str,
    *,
    tcp: str | ToolFrame,
    home: ArrayLike,
    joints: Sequence[str] | None = None,
    gripper: Gripper | Hand | None = None,
    ratings: Ratings = _NOTHING_KNOWN,
) -> Robot:
    """Return an arm of MuJoCo Menagerie, e.g. "kuka_iiwa_14/iiwa14"; see `robot_from_mjcf`.

    Raises:
        MenagerieError, MissingExtraError: See `menagerie_file`.
        UnknownNameError, InvalidValueError, ModelError: See `robot_from_mjcf`.
    """
    file = menagerie_file(model)
    robot = robot_from_mjcf(
        file, tcp=tcp, home=home, joints=joints, gripper=gripper, ratings=ratings
    )
    return replace(robot, menagerie=model)


def _check_fingers(gripper: Gripper, model: mujoco.MjModel, arm: Arm) -> None:
    """Check that open fingers are apart along the tool's y axis, the first on its side."""
    joints = [model.joint(i).name for i in range(model.njnt)]
    bodies = [model.body(i).name for i in range(model.nbody)]
    for kind, names, known in (
        ("joint", gripper.joints, joints),
        ("body", gripper.fingers, bodies),
    ):
        for name in names:
            if name not in known:
                raise UnknownNameError(kind, name, known)
    data = mujoco.MjData(model)
    for joint in arm.robot.joints:
        data.joint(joint).qpos = 0.0
    for joint in gripper.joints:
        data.joint(joint).qpos = 0.5 * gripper.width_max
    mujoco.mj_kinematics(model, data)
    first, second = (data.body(finger).xpos for finger in gripper.fingers)
    apart = arm.pose(np.zeros(arm.n)).rotation().inverse().apply(first - second)
    if apart[1] <= 0.9 * np.linalg.norm(apart):
        found = f"open, the first is at {apart.round(4).tolist()} m from the second, in the tool"
        expected = "apart along the tool's y axis, that on the side of y first"
        raise InvalidValueError(f"fingers {gripper.fingers}", found, expected)


def _named(joints: Sequence[str]) -> tuple[str, ...]:
    """Return the names of joints as they were chosen.

    Raises:
        InvalidValueError: There are none, or one is named twice.
    """
    if isinstance(joints, str) or not joints or len(set(joints)) < len(joints):
        found = repr(joints) if isinstance(joints, str) else list(joints)
        raise InvalidValueError("joints", found, "names of one joint or more, each of them once")
    return tuple(joints)


def _rated(draft: Robot, arm: Arm, file_torques: Vector, known: Ratings) -> Robot:
    if arm.limit_margin(draft.home) < 0.0:
        ranges = np.column_stack([arm.q_min, arm.q_max]).round(4).tolist()
        raise InvalidValueError("home", draft.home.tolist(), f"inside the joint ranges {ranges}")

    def given(field: str) -> Vector | None:
        value = getattr(known, field)
        if value is None:
            return None
        vector = arm.checked_q(field, value)
        Range(above=0.0).check(field, vector)
        return vector

    tau_max, rates, stiffness = given("tau_max"), given("tau_rate_max"), given("stiffness")
    if tau_max is None:
        tau_max = np.where(np.isnan(file_torques), defaults.torque_limits(arm), file_torques)
    rated = known.rated or defaults.rated_profile(arm, tau_max)
    return replace(
        draft,
        rated=rated,
        profile=known.profile or defaults.default_profile(rated),
        tau_max=tau_max,
        tau_rate_max=defaults.torque_rates(tau_max) if rates is None else rates,
        stiffness=defaults.stiffness(arm, tau_max, TIMESTEP) if stiffness is None else stiffness,
    )


def _tool_frame(spec: mujoco.MjSpec, tcp: str | ToolFrame) -> tuple[str, ToolFrame | None]:
    """Return the name of the site, and the frame to add if the file lacks it."""
    sites = [site.name for site in spec.sites]
    if isinstance(tcp, str):
        if tcp not in sites:
            raise UnknownNameError("site", tcp, sites)
        return tcp, None
    if spec.body(tcp.body) is None:
        raise UnknownNameError("body", tcp.body, [body.name for body in spec.bodies])
    name = "tcp"
    while name in sites:
        name += "_"
    return name, tcp


def _chain(spec: mujoco.MjSpec, site: str, tool: ToolFrame | None) -> tuple[str, ...]:
    """Return the joints between the world and the tool, base to tip."""
    carrier: Any = spec.site(site)
    body: Any = carrier.parent if tool is None else spec.body(tool.body)
    chain: list[Any] = []
    while body is not None and body != spec.worldbody:
        chain = [*body.joints, *chain]
        body = body.parent
    moves = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    wrong = [joint.name for joint in chain if joint.type not in moves]
    if wrong or not chain:
        found = f"the joints {wrong} neither turn nor slide" if wrong else "there is no joint"
        raise ModelError(
            f"Between the world and the tool frame {site!r} {found}. An arm is fixed to the "
            "world and has joints that turn or slide; name those of the arm as `joints`."
        )
    return tuple(joint.name for joint in chain)


def _is_motor(model: mujoco.MjModel, drive: int) -> bool:
    """Return whether the force of an actuator is its control."""
    plain = model.actuator_dyntype[drive] == mujoco.mjtDyn.mjDYN_NONE
    unit = model.actuator_gaintype[drive] == mujoco.mjtGain.mjGAIN_FIXED
    unit = unit and model.actuator_gainprm[drive, 0] == 1.0
    return bool(plain and unit and model.actuator_biastype[drive] == mujoco.mjtBias.mjBIAS_NONE)


def _file_torques(model: mujoco.MjModel, joints: Sequence[str]) -> Vector:
    """Return the torque limits of the file's actuators (n,) [N·m]; NaN where unlimited."""
    limits = np.full(len(joints), np.nan)
    for drive in range(model.nu):
        # What others act on are tendons, sites and bodies, with numbers of their own.
        if model.actuator_trntype[drive] != mujoco.mjtTrn.mjTRN_JOINT:
            continue
        name = model.joint(int(model.actuator_trnid[drive, 0])).name
        limited, force = model.actuator_forcelimited[drive], model.actuator_forcerange[drive]
        if _is_motor(model, drive) and not limited:
            limited, force = model.actuator_ctrllimited[drive], model.actuator_ctrlrange[drive]
        if name in joints and limited:
            force = np.abs(force).max()
            i = joints.index(name)
            limits[i] = np.nanmax([limits[i], force * abs(model.actuator_gear[drive, 0])])
    for i, name in enumerate(joints):
        joint = model.joint(name)
        if model.jnt_actfrclimited[joint.id]:
            limits[i] = np.nanmin([limits[i], np.abs(model.jnt_actfrcrange[joint.id]).max()])
    return limits
