"""Contact sensing: contact forces on the tool, the links and the fingers."""

from math import hypot

import mujoco
import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.errors import UnknownNameError
from robo47_qp.model.robot import Robot
from robo47_qp.sim.signal import XYZ, Signal

_PARAMETERS = [1 << 1, 3, 1]
"""Of MuJoCo's contact sensor: the force field, reduced to the net force, in one slot."""
_TOOL, _WITHIN_TOOL, _LINK = "contact/tool", "contact/within tool", "contact/link"


def contact_sensor(finger: str) -> str:
    """Return the name of the sensor of the net contact force on a finger."""
    return f"{finger}_contact"


def add_contact_sensors(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add contact force sensors of tool, links and fingers to a spec with all bodies.

    The tool is the body of the last joint with all that it carries. Unnamed bodies get names.

    Raises:
        UnknownNameError: The spec lacks a joint of the robot.
    """
    links, tool = _links_and_tool(spec, robot)
    body, subtree = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_XBODY
    for finger in () if robot.gripper is None else robot.gripper.fingers:
        _add(spec, contact_sensor(finger), body, finger)
    _add(spec, _TOOL, subtree, tool)
    # Contacts between bodies of the tool count in the first sensor too.
    _add(spec, _WITHIN_TOOL, subtree, tool, other=tool)
    for i, link in enumerate(links):
        _add(spec, f"{_LINK} {i}", body, link)


class ContactSensing:
    """Reads the contact forces on an arm; part of `Simulation`."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Take views of the sensors' values in `data`."""
        # MuJoCo reports the force of the named body on others.
        self._by_tool = data.sensor(_TOOL).data
        self._within_tool = data.sensor(_WITHIN_TOOL).data
        names = [model.sensor(i).name for i in range(model.nsensor)]
        links = [i for i, name in enumerate(names) if name.startswith(_LINK)]
        # Added one after the other, their values are contiguous.
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
        """See `Simulation.last_tool_force`."""
        self.update()
        return self._tool.copy()

    def links_force(self) -> float:
        """See `Simulation.last_links_force`."""
        self.update()
        return float(self._links[0])


def _links_and_tool(spec: mujoco.MjSpec, robot: Robot) -> tuple[list[str], str]:
    """Return the names of the links before the last joint's body, and of that body."""
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
