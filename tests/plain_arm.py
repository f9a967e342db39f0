"""An arm by MuJoCo and elementary mechanics alone: what `Arm` and the solvers are judged by."""

import xml.etree.ElementTree as ET
from math import atan2
from pathlib import Path

import mujoco
import numpy as np
from mink import SE3
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Hand, Robot

_CIRCLE = (-np.pi, np.pi)
_H = 1e-5
"""Half the width of central differences of poses [rad]."""


class PlainArm:
    """The robot's own MJCF with its fingers held still; quantities from first principles.

    `full` is the file as it is. `welded` is the file with every other joint struck out of the
    text, without actuators, stops and contacts: MuJoCo's forward dynamics of n joints.
    """

    def __init__(self, robot: Robot, payload: Payload | None = None) -> None:
        self.robot = robot
        self.payload = payload
        self.full = mujoco.MjModel.from_xml_string(_text_of(robot))
        self.welded = mujoco.MjModel.from_xml_string(_welded(robot, payload))
        self._full, self._welded = mujoco.MjData(self.full), mujoco.MjData(self.welded)
        joints = [_joint(self.full, name) for name in robot.joints]
        self._q = [int(joint.qposadr[0]) for joint in joints]
        dofs = [int(joint.dofadr[0]) for joint in joints]
        self.n = len(joints)
        ranges = [joint.range if self.full.jnt_limited[joint.id] else _CIRCLE for joint in joints]
        self.q_min: Vector = np.array([low for low, _ in ranges])
        self.q_max: Vector = np.array([high for _, high in ranges])
        self.armature: Vector = self.full.dof_armature[dofs].copy()
        self.damping: Vector = self.full.dof_damping[dofs].copy()

    def at(self, fractions: Vector) -> Vector:
        """Configuration at fractions of the joint ranges; takes as many as there are joints."""
        q = self.q_min + fractions[: self.n] * (self.q_max - self.q_min)
        inside: Vector = np.clip(q, self.q_min, self.q_max)
        return inside

    def tool(self, q: Vector) -> tuple[Vector, Matrix]:
        """Position and rotation matrix of the tool in the world."""
        data, tool = self._at(q), self.robot.tool
        if tool is None:
            site = data.site(self.robot.tcp)
            return site.xpos.copy(), site.xmat.reshape(3, 3).copy()
        body = data.body(tool.body)
        R, T_body_tcp = body.xmat.reshape(3, 3), tool.T_body_tcp.as_matrix()
        return body.xpos + R @ T_body_tcp[:3, 3], R @ T_body_tcp[:3, :3]

    def errors(self, q: Vector, T_world_target: SE3) -> tuple[float, float]:
        """Distance [m] and angle [rad] of the tool from a target."""
        position, R = self.tool(q)
        here, back, turn = np.zeros((3, 4))
        mujoco.mju_mat2Quat(here, R.ravel())
        mujoco.mju_negQuat(back, here)
        mujoco.mju_mulQuat(turn, back, T_world_target.wxyz_xyz[:4])
        away = np.linalg.norm(position - T_world_target.wxyz_xyz[4:])
        return float(away), 2.0 * atan2(np.linalg.norm(turn[1:]), abs(turn[0]))

    def inside(self, q: Vector) -> bool:
        """True where no joint is outside its range."""
        return bool((q >= self.q_min).all() and (q <= self.q_max).all())

    def jacobian(self, q: Vector) -> Matrix:
        """Twist of the tool in the tool frame per joint (6, n), by differences of poses."""
        _, R = self.tool(q)
        before, after = ([self.tool(q + h * e) for e in np.eye(self.n)] for h in (-_H, _H))
        (p0, R0), (p1, R1) = _stacked(before), _stacked(after)
        return np.hstack([(p1 - p0) @ R, _turned(R0, R1)]).T / (2 * _H)

    def kinetic_energy(self, q: Vector, v: Vector) -> float:
        """Sum over all bodies and rotors, velocities by differences of poses [J]."""
        before, after = self._bodies(q - _H * v), self._bodies(q + _H * v)
        (m, moments, p0, R0), (_, _, p1, R1) = before, after
        linear, angular = (p1 - p0) / (2 * _H), _turned(R0, R1) / (2 * _H)
        energy = m @ (linear**2).sum(axis=1) + (moments * angular**2).sum()
        return 0.5 * float(v @ (self.armature * v) + energy)

    def potential_energy(self, q: Vector) -> float:
        """Of gravity [J]."""
        m, _, p, _ = self._bodies(q)
        return -float(m @ p @ self.full.opt.gravity)

    def mass_matrix(self, q: Vector) -> Matrix:
        """From kinetic energies: T(u + w) - T(u) - T(w) = u'Mw."""
        unit = np.eye(self.n)
        own = [self.kinetic_energy(q, e) for e in unit]
        M = 2.0 * np.diag(own)
        for i in range(self.n):
            for k in range(i):
                both = self.kinetic_energy(q, unit[i] + unit[k])
                M[i, k] = M[k, i] = both - own[i] - own[k]
        return M

    def gravity_torque(self, q: Vector) -> Vector:
        """Gradient of the potential energy (n,) [N·m]."""
        h = 1e-4
        up = [self.potential_energy(q + h * e) for e in np.eye(self.n)]
        down = [self.potential_energy(q - h * e) for e in np.eye(self.n)]
        slope: Vector = (np.array(up) - np.array(down)) / (2 * h)
        return slope

    def acceleration(self, q: Vector, v: Vector, tau: Vector) -> Vector:
        """Forward dynamics of the welded model (n,) [rad/s²]."""
        d = self._welded
        mujoco.mj_resetData(self.welded, d)
        d.qpos[:], d.qvel[:], d.qfrc_applied[:] = q, v, tau
        mujoco.mj_forward(self.welded, d)
        return d.qacc.copy()

    def _at(self, q: Vector) -> mujoco.MjData:
        self._full.qpos[:] = 0.0
        self._full.qpos[self._q] = q
        mujoco.mj_kinematics(self.full, self._full)
        return self._full

    def _bodies(self, q: Vector) -> tuple[Vector, Matrix, Matrix, NDArray[np.float64]]:
        """Masses, principal moments, centres of mass and principal axes of all bodies."""
        m, d = self.full, self._at(q)
        masses, moments = m.body_mass[1:].copy(), m.body_inertia[1:].copy()
        p, R = d.xipos[1:].copy(), d.ximat[1:].reshape(-1, 3, 3).copy()
        if self.payload is None:
            return masses, moments, p, R
        position, R_tool = self.tool(q)
        T_tcp_com = self.payload.T_tcp_com
        p_com = position + R_tool @ T_tcp_com.translation()
        R_com = R_tool @ T_tcp_com.rotation().as_matrix()
        return (
            np.append(masses, self.payload.mass),
            np.vstack([moments, self.payload.inertia]),
            np.vstack([p, p_com]),
            np.concatenate([R, R_com[None]]),
        )


def _stacked(poses: list[tuple[Vector, Matrix]]) -> tuple[Matrix, NDArray[np.float64]]:
    """Positions (N, 3) and rotation matrices (N, 3, 3)."""
    return np.array([p for p, _ in poses]), np.array([R for _, R in poses])


def _turned(before: NDArray[np.float64], after: NDArray[np.float64]) -> Matrix:
    """Rotation vectors (N, 3) from rotation matrices (N, 3, 3) to others, in their own axes."""
    turned: Matrix = Rotation.from_matrix(before.transpose(0, 2, 1) @ after).as_rotvec()
    return turned


def _joint(model: mujoco.MjModel, name: str) -> mujoco._structs._MjModelJointViews:
    """A joint without a name in the file goes by that of its body."""
    if name.endswith("_joint0"):
        return model.joint(int(model.body(name.removesuffix("_joint0")).jntadr[0]))
    return model.joint(name)


def welded_file(robot: Robot, folder: Path) -> Path:
    """The welded model as a file, to be changed by a test."""
    path = folder / "welded.xml"
    path.write_text(_welded(robot, None), encoding="utf-8")
    return path


def _welded(robot: Robot, payload: Payload | None) -> str:
    root = _robot(robot)
    for tag in ("actuator", "tendon", "equality", "sensor", "keyframe"):
        for section in root.findall(tag):
            root.remove(section)
    for body in root.iter("body"):
        if robot.tool is not None and body.get("name") == robot.tool.body:
            pose = robot.tool.T_body_tcp.wxyz_xyz
            ET.SubElement(body, "site", name=robot.tcp, pos=_text(pose[4:]), quat=_text(pose[:4]))
        for joint in body.findall("joint"):
            # A joint without a name goes by that of its body.
            if joint.get("name", f"{body.get('name')}_joint0") not in robot.joints:
                body.remove(joint)
        if payload is not None and any(site.get("name") == robot.tcp for site in body):
            body.append(_held(body, robot.tcp, payload))
    option = ET.SubElement(root, "option", integrator="implicitfast", timestep="0.001")
    ET.SubElement(option, "flag", constraint="disable", contact="disable")
    return ET.tostring(root, encoding="unicode")


def _text_of(robot: Robot) -> str:
    root = _robot(robot)
    if robot.hand is not None:
        # The keyframes have no numbers for the hand.
        for section in root.findall("keyframe"):
            root.remove(section)
    return ET.tostring(root, encoding="unicode")


def _robot(robot: Robot) -> ET.Element:
    """The robot's file with its hand and the inertia of its rotors, by text."""
    root = _whole(robot.mjcf)
    for compiler in root.findall("compiler"):
        if "meshdir" in compiler.attrib:
            compiler.set("meshdir", str(robot.mjcf.parent / compiler.attrib["meshdir"]))
    if robot.armature is not None:
        for joint in root.iter("joint"):
            if joint.get("name") in robot.joints:
                inertia = robot.armature[robot.joints.index(joint.attrib["name"])]
                joint.set("armature", repr(float(inertia)))
    if robot.hand is not None:
        _add_hand(root, robot.hand)
    return root


def _add_hand(root: ET.Element, hand: Hand) -> None:
    part = _whole(hand.mjcf)
    root.extend([*part.findall("default"), *part.findall("asset")])
    (body,) = part.findall("worldbody/body")
    for element in body.iter():
        if "name" in element.attrib:
            element.set("name", hand.PREFIX + element.attrib["name"])
    turned = Rotation.from_euler("z", hand.turn).as_quat()[[3, 0, 1, 2]]
    body.set("quat", _text(turned))
    for parent in root.iter("body"):
        for site in parent.findall(f"site[@name='{hand.site}']"):
            at = {key: text for key, text in site.items() if key in {"pos", "quat"}}
            ET.SubElement(parent, "frame", at).append(body)
            return


def _whole(mjcf: Path) -> ET.Element:
    """A file with what it attaches from others in its place, by text."""
    root = ET.parse(mjcf).getroot()
    for assets in root.findall("asset"):
        for model in assets.findall("model"):
            assets.remove(model)
            other = ET.parse(mjcf.parent / model.attrib["file"]).getroot()
            root.extend([*other.findall("default"), *other.findall("asset")])
            for parent in list(root.iter()):
                for attach in parent.findall(f"attach[@model='{model.attrib['name']}']"):
                    part = other.find(f".//body[@name='{attach.attrib['body']}']")
                    assert part is not None
                    for element in part.iter():
                        if "name" in element.attrib:
                            element.set("name", attach.attrib["prefix"] + element.attrib["name"])
                    parent.remove(attach)
                    parent.append(part)
    return root


def _held(hand: ET.Element, tcp: str, payload: Payload) -> ET.Element:
    """The payload as two frames in one another: that of the tool, then that of its own."""
    site = next(site for site in hand if site.get("name") == tcp)
    placed = {key: text for key, text in site.items() if key in {"pos", "quat", "euler"}}
    frame = ET.Element("frame", placed)
    p, wxyz = payload.T_tcp_com.translation(), payload.T_tcp_com.rotation().wxyz
    body = ET.SubElement(frame, "body", name="payload", pos=_text(p), quat=_text(wxyz))
    moments = _text(np.array(payload.inertia))
    ET.SubElement(body, "inertial", mass=repr(payload.mass), pos="0 0 0", diaginertia=moments)
    return frame


def _text(numbers: Vector) -> str:
    return " ".join(repr(float(number)) for number in numbers)
