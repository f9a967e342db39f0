"""Contact sensing: what presses on the tool, on the rest of the arm and on the fingers."""

from math import hypot

import mujoco
import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.errors import UnknownNameError
from robo47_qp.model.robot import Robot
from robo47_qp.sim.signal import XYZ, Signal

_FORCE_FIELD, _NET_FORCE, _ONE_SLOT = 1 << 1, 3, 1
"""Parameters of MuJoCo's contact sensor: report the force, summed over all contacts."""
_PARAMETERS = [_FORCE_FIELD, _NET_FORCE, _ONE_SLOT]
_TOOL, _WITHIN_TOOL, _LINK = "contact/tool", "contact/within tool", "contact/link"


def contact_sensor(finger: str) -> str:
    """Name of the sensor that sums the contact forces on a finger."""
    return f"{finger}_contact"


def add_contact_sensors(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add sensors of the contact forces on tool, links and fingers to a spec with all bodies.

    The tool is the body of the last joint with all that it carries. A body without a name
    gets one.

    Raises:
        UnknownNameError: The spec lacks a joint of the robot.
    """
    links, tool = _links_and_tool(spec, robot)
    body, subtree = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_XBODY
    for finger in () if robot.gripper is None else robot.gripper.fingers:
        _add(spec, contact_sensor(finger), body, finger)
    _add(spec, _TOOL, subtree, tool)
    # Bodies of the tool that touch each other match the first sensor too.
    _add(spec, _WITHIN_TOOL, subtree, tool, other=tool)
    for i, link in enumerate(links):
        _add(spec, f"{_LINK} {i}", body, link)


class ContactSensing:
    """Reads the contact forces on an arm; part of `Simulation`."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Take the views of the sensors' numbers in `data`."""
        # MuJoCo reports the force of the named body on others: the opposite of what it feels.
        self._by_tool = data.sensor(_TOOL).data
        self._within_tool = data.sensor(_WITHIN_TOOL).data
        names = [model.sensor(i).name for i in range(model.nsensor)]
        links = [i for i, name in enumerate(names) if name.startswith(_LINK)]
        # They were added one after the other, so that their numbers lie side by side.
        start = model.sensor_adr[links[0]] if links else 0
        self._on_links = data.sensordata[start : start + 3 * len(links)]
        self._tool, self._links = np.zeros(3), np.zeros(1)
        self.signals_last = {
            Signal(name="contact/tool", labels=XYZ, unit="N"): (self._tool,),
            Signal(name="contact/links", labels=("sum",), unit="N"): (self._links,),
        }

    def update(self) -> None:
        """Read the sensors into the views of `signals_last`."""
        np.subtract(self._within_tool, self._by_tool, out=self._tool)
        forces = self._on_links.tolist()
        # Scalars, because numpy takes several times the time for so few numbers.
        self._links[0] = (
            sum(map(hypot, forces[::3], forces[1::3], forces[2::3])) if any(forces) else 0.0
        )

    def tool_force(self) -> Vector:
        """Net contact force of the rest of the world on the tool (3,), in the world [N]."""
        self.update()
        return self._tool.copy()

    def links_force(self) -> float:
        """Sizes of the net contact forces on the links before the tool, added up [N]."""
        self.update()
        return float(self._links[0])


def _links_and_tool(spec: mujoco.MjSpec, robot: Robot) -> tuple[list[str], str]:
    """Names of the bodies from the first joint up to the last one's body, and of that body."""
    first, last = (_carrier(spec, robot.joints[i]) for i in (0, -1))
    arm = [first, *first.find_all("body")]
    for i, body in enumerate(arm):
        body.name = body.name or f"{robot.name} body {i}"
    tool = {last.name, *(body.name for body in last.find_all("body"))}
    return [body.name for body in arm if body.name not in tool], last.name


def _carrier(spec: mujoco.MjSpec, joint: str) -> mujoco.MjsBody:
    found = spec.joint(joint)
    if found is None:
        raise UnknownNameError("joint", joint, [known.name for known in spec.joints])
    return found.parent


def _add(
    spec: mujoco.MjSpec, name: str, kind: mujoco.mjtObj, body: str, other: str | None = None
) -> None:
    sensor = spec.add_sensor(
        name=name,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=kind,
        objname=body,
        intprm=_PARAMETERS,
    )
    if other is not None:
        sensor.reftype, sensor.refname = kind, other
