"""Kinematic chain of an arm for other packages, read from its model."""

from dataclasses import dataclass
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import ModelError
from robo47_qp.model.arm import Arm

BASE, TIP = "base", "tip"
"""Links of the URDF: the world, and the tool frame."""


@dataclass(frozen=True, kw_only=True, eq=False)
class KinematicChain:
    """Joints in series at position zero, as a product of exponentials.

    (Brockett, "Robotic manipulators and the product of exponentials formula", 1984.)
    """

    anchors: Matrix
    """A point on each joint's axis (n, 3), in the world [m]."""
    axes: Matrix
    """Direction of each joint's axis (n, 3), in the world, of unit length."""
    slides: tuple[bool, ...]
    """True for sliding joints, False for hinges."""
    q_min: Vector
    q_max: Vector
    T_world_tcp: SE3
    """T_world_tcp with all joints at zero."""

    def urdf(self) -> str:
        """Return the chain as URDF, with link frames that have the orientation of the world."""
        robot = ET.Element("robot", name="chain")
        names = [BASE, *(f"link{i}" for i in range(1, len(self.axes) + 1))]
        for name in (*names, TIP):
            _link(robot, name)
        origin = np.zeros(3)
        for i, (anchor, axis) in enumerate(zip(self.anchors, self.axes, strict=True)):
            kind = "prismatic" if self.slides[i] else "revolute"
            joint = _joint(robot, f"joint{i + 1}", kind, names[i], names[i + 1])
            ET.SubElement(joint, "origin", xyz=_text(anchor - origin), rpy="0 0 0")
            ET.SubElement(joint, "axis", xyz=_text(axis))
            low, high = repr(float(self.q_min[i])), repr(float(self.q_max[i]))
            # No limit on speed or effort: the comparison is about positions.
            ET.SubElement(joint, "limit", lower=low, upper=high, velocity="1e6", effort="1e6")
            origin = anchor
        joint = _joint(robot, "tool", "fixed", names[-1], TIP)
        rpy = np.array(self.T_world_tcp.rotation().as_rpy_radians())
        xyz = self.T_world_tcp.translation() - origin
        ET.SubElement(joint, "origin", xyz=_text(xyz), rpy=_text(rpy))
        return ET.tostring(robot, encoding="unicode")


def kinematic_chain(arm: Arm) -> KinematicChain:
    """Return the kinematic chain of an arm.

    Raises:
        ModelError: The joints are not in series from base to tool.
    """
    m, d = arm.model, mujoco.MjData(arm.model)
    tcp = m.site(arm.robot.tcp).id
    path, body = set(), int(m.site_bodyid[tcp])
    while body != 0:
        path.add(body)
        body = int(m.body_parentid[body])
    if not set(m.jnt_bodyid.tolist()) <= path:
        raise ModelError(f"Robot {arm.robot.name!r} branches between its base and its tool.")
    # Forward kinematics at zero is defined also where zero is outside the limits.
    d.qpos[:] = 0.0
    mujoco.mj_kinematics(m, d)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, d.site_xmat[tcp])
    return KinematicChain(
        anchors=d.xanchor.copy(),
        axes=d.xaxis.copy(),
        slides=tuple(bool(kind == mujoco.mjtJoint.mjJNT_SLIDE) for kind in m.jnt_type),
        q_min=arm.q_min.copy(),
        q_max=arm.q_max.copy(),
        T_world_tcp=SE3(np.concatenate([quaternion, d.site_xpos[tcp]])),
    )


def _link(robot: ET.Element, name: str) -> None:
    """Return a URDF link with some mass, as parsers reject links without."""
    inertial = ET.SubElement(ET.SubElement(robot, "link", name=name), "inertial")
    ET.SubElement(inertial, "mass", value="1")
    moments = {"ixx": "0.01", "iyy": "0.01", "izz": "0.01", "ixy": "0", "ixz": "0", "iyz": "0"}
    ET.SubElement(inertial, "inertia", moments)


def _joint(robot: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    return joint


def _text(numbers: Vector) -> str:
    return " ".join(repr(float(number)) for number in numbers)
