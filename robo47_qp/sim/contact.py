"""Contact sensing: contact forces on the tool, the links and the fingers."""

from collections.abc import Sequence
from math import hypot
from typing import Any

import mujoco
import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import UnknownNameError
from robo47_qp.model.robot import Robot
from robo47_qp.sim.signal import XYZ, Signal

_NET = [1 << 1, 3, 1]
"""Of MuJoCo's contact sensor: the force field, reduced to the net force, in one slot."""
_EACH = [1 << 1, 2, 16]
"""The same of the contacts with the largest forces, each in a slot of its own: opposite forces,
as of fingers that close on a wall, cancel in their sum."""
_LINK, _FIXED = "contact/link", "contact/fixed"


def _tool_sensors(label: str) -> tuple[str, str]:
    """Return the names of the sensors on a tool and inside it."""
    return f"contact/{label}tool", f"contact/within {label}tool"


def contact_sensor(finger: str) -> str:
    """Return the name of the sensor of the net contact force on a finger."""
    return f"{finger}_contact"


def add_contact_sensors(spec: mujoco.MjSpec, robot: Robot, fixed: Sequence[str] = ()) -> None:
    """Add contact force sensors of tools, links and fingers to a spec with all bodies.

    Args:
        spec: Robot and scene.
        robot: The robot.
        fixed: Names of the bodies that stand fixed in the scene, such as "world".

    A tool is the body of the last joint with all that it carries. Unnamed bodies get names.

    Raises:
        UnknownNameError: The spec lacks a joint of the robot.
    """
    links, tools = _links_and_tools(spec, robot)
    body, subtree = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_XBODY
    for finger in (finger for gripper in robot.grippers for finger in gripper.fingers):
        _add(spec, contact_sensor(finger), body, finger)
    for (label, _), tool in zip(robot.tool_labels(), tools, strict=True):
        whole, within = _tool_sensors(label)
        _add(spec, whole, subtree, tool)
        # Contacts between bodies of the tool count in the first sensor too.
        _add(spec, within, subtree, tool, other=tool)
    for i, link in enumerate(links):
        _add(spec, f"{_LINK} {i}", body, link)
    # Grouped by the tool, so that the sensors of one are contiguous.
    for (label, _), tool in zip(robot.tool_labels(), tools, strict=True):
        for i, other in enumerate(fixed):
            name = f"{_FIXED} {label}{i}"
            _add(spec, name, subtree, tool, other=other, other_kind=body, parameters=_EACH)


class ContactSensing:
    """Reads the contact forces on an arm; part of `Simulation`."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, labels: Sequence[str] = ("",)
    ) -> None:
        """Take views of the sensors' values in `data`, given what names of tools begin with."""
        # MuJoCo reports the force of the named body on others.
        sensors = [[data.sensor(name).data for name in _tool_sensors(label)] for label in labels]
        self._forces = np.zeros((len(labels), 3))
        self._tools = [(*two, force) for two, force in zip(sensors, self._forces, strict=True)]
        names = [model.sensor(i).name for i in range(model.nsensor)]
        links = [i for i, name in enumerate(names) if name.startswith(_LINK)]
        self._on_links = _together(model, data, links)
        self.sums = np.zeros(1 + len(labels))
        """Sums of magnitudes on the links, then of each tool on what is fixed [N]."""
        self._links = self.sums[:1]
        fixed = [_views(model, data, f"{_FIXED} {label}") for label in labels]
        self._fixed = [(view, self.sums[i : i + 1]) for i, view in enumerate(fixed, start=1)]
        summed = [i for i, name in enumerate(names) if name.startswith((_LINK, _FIXED))]
        self.summed: Vector = _together(model, data, summed)
        """The values that `sums` come from, all zero where nothing touches."""
        standing = {int(model.sensor_refid[i]) for i, n in enumerate(names) if n.startswith(_FIXED)}
        self.fixed_geoms = [
            geom
            for geom in range(model.ngeom)
            if int(model.geom_bodyid[geom]) in standing
            and (model.geom_contype[geom] or model.geom_conaffinity[geom])
        ]
        """Geoms of the bodies that stand fixed, which can be touched."""
        self._peaks = np.zeros(len(self._fixed))
        self.signals_last = {
            **{
                Signal(name=f"contact/{label}tool", labels=XYZ, unit="N"): (force,)
                for label, (_, _, force) in zip(labels, self._tools, strict=True)
            },
            Signal(name="contact/links", labels=("sum",), unit="N"): (self._links,),
            **{
                Signal(name=f"contact/{label}fixed", labels=("sum",), unit="N"): (force,)
                for label, (_, force) in zip(labels, self._fixed, strict=True)
            },
        }

    @property
    def tool_forces(self) -> tuple[list[Vector], list[Vector], Matrix]:
        """Views of two sensors of each tool, and the forces (tools, 3), second less first."""
        whole, within = ([tool[i] for tool in self._tools] for i in (0, 1))
        return whole, within, self._forces

    def update(self) -> None:
        """Read the sensors into the views of `signals_last`."""
        for whole, within, force in self._tools:
            np.subtract(within, whole, out=force)
        self._links[0] = _total(self._on_links)
        for i, (values, total) in enumerate(self._fixed):
            total[0] = _total(values)
            self._peaks[i] = max(self._peaks[i], total[0])

    def tool_force(self, tool: int = 0) -> Vector:
        """See `Simulation.last_tool_force`."""
        whole, within, _ = self._tools[tool]
        force: Vector = within - whole
        return force

    def fixed_peak(self, tool: int) -> float:
        """See `Simulation.fixed_force_peak`."""
        self.update()
        peak = float(self._peaks[tool])
        self._peaks[tool] = self._fixed[tool][1][0]
        return peak

    def reset(self) -> None:
        """Forget the peaks."""
        self._peaks[:] = 0.0

    def links_force(self) -> float:
        """See `Simulation.last_links_force`."""
        return _total(self._on_links)


def _total(values: Vector) -> float:
    """Return the sum of the magnitudes of forces, given as one array (3 k,) [N]."""
    forces = values.tolist()
    # Scalars, because numpy takes several times the time for so few numbers.
    return sum(map(hypot, forces[::3], forces[1::3], forces[2::3])) if any(forces) else 0.0


def _views(model: mujoco.MjModel, data: mujoco.MjData, prefix: str) -> Vector:
    """Return the values of the sensors whose names are a prefix and a number, as one view."""
    found = [
        i
        for i in range(model.nsensor)
        if model.sensor(i).name.startswith(prefix) and model.sensor(i).name[len(prefix) :].isdigit()
    ]
    return _together(model, data, found)


def _together(model: mujoco.MjModel, data: mujoco.MjData, sensors: Sequence[int]) -> Vector:
    """Return the values of sensors that were added one after the other, as one view."""
    if not sensors:
        return data.sensordata[:0]
    end = model.sensor_adr[sensors[-1]] + model.sensor_dim[sensors[-1]]
    view: Vector = data.sensordata[model.sensor_adr[sensors[0]] : end]
    return view


def _links_and_tools(spec: mujoco.MjSpec, robot: Robot) -> tuple[list[str], list[str]]:
    """Return the names of the links before the bodies of the last joints, and of those bodies."""
    ends = _ends(spec, robot)
    arm = [body for first, _ in ends for body in (first, *first.find_all("body"))]
    for i, body in enumerate(arm):
        body.name = body.name or f"{robot.name} body {i}"
    tools = [{last.name, *(body.name for body in last.find_all("body"))} for _, last in ends]
    links = dict.fromkeys(body.name for body in arm)
    return [name for name in links if not any(name in tool for tool in tools)], [
        last.name for _, last in ends
    ]


def _ends(spec: mujoco.MjSpec, robot: Robot) -> list[tuple[mujoco.MjsBody, mujoco.MjsBody]]:
    """Return the bodies of the first and of the last joint that move each tool."""
    if len(robot.tools) == 1:
        return [(_carrier(spec, robot.joints[0]), _carrier(spec, robot.joints[-1]))]
    ends = []
    for tool in robot.tools:
        site: Any = spec.site(tool.tcp)
        body, chain = site.parent, []
        while body is not None and body != spec.worldbody:
            if any(joint.name in robot.joints for joint in body.joints):
                chain.append(body)
            body = body.parent
        ends.append((chain[-1], chain[0]))
    return ends


def _carrier(spec: mujoco.MjSpec, joint: str) -> mujoco.MjsBody:
    found = spec.joint(joint)
    if found is None:
        raise UnknownNameError("joint", joint, [known.name for known in spec.joints])
    return found.parent


def _add(
    spec: mujoco.MjSpec,
    name: str,
    kind: mujoco.mjtObj,
    body: str,
    other: str | None = None,
    other_kind: mujoco.mjtObj | None = None,
    parameters: Sequence[int] = _NET,
) -> None:
    sensor = spec.add_sensor(
        name=name,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=kind,
        objname=body,
        intprm=parameters,
    )
    if other is not None:
        sensor.reftype, sensor.refname = kind if other_kind is None else other_kind, other
