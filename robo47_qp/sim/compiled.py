"""CompiledWorld: the periods of a simulation as the compiled core runs them."""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from robo47_qp._core.library import Structure, backend
from robo47_qp._core.mujoco_functions import function, structure
from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.model.robot import Robot
from robo47_qp.sim.columns import Columns
from robo47_qp.sim.contact import ContactSensing
from robo47_qp.sim.gripper import SimulatedGripper


class CompiledWorld:
    """What `r47_run` needs to know of a simulation without disturbances; part of `Simulation`."""

    def __init__(
        self,
        robot: Robot,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        joints: tuple[Columns, Columns, Columns],
        hands: Sequence[SimulatedGripper],
        contact: ContactSensing,
        views: tuple[Sequence[Vector], Sequence[Vector]],
    ) -> None:
        """Take the addresses of everything, which keeps its place.

        Args:
            robot: The robot.
            model: The scene.
            data: Its state.
            joints: Their positions, velocities and motors' torques.
            hands: The grippers.
            contact: What reads contact forces.
            views: What a row holds of the start of a period, and of what happened in it.
        """
        q, v, ctrl = (column.whole for column in joints)
        pieces = _pieces(*joints)
        self._hands = hands
        self._courses = np.zeros((4, len(hands)))
        width, speed, unloaded, unloading = self._courses
        whole, within, force = contact.tool_forces
        first, late = views
        self.structure = Structure(
            "r47_world",
            n=len(q),
            model=structure(model),
            data=structure(data),
            step1=function("mj_step1"),
            step2=function("mj_step2"),
            clock=function("mjcb_time"),
            q=q,
            v=v,
            ctrl=ctrl,
            **pieces,
            most=robot.tau_max.copy(),
            rate=robot.tau_rate_max * TIMESTEP,
            grippers=len(hands),
            all_ctrl=data.ctrl,
            servo=np.array([hand.servo for hand in hands], dtype=np.int32),
            width=width,
            speed=speed,
            unloaded=unloaded,
            unloading=unloading,
            tools=len(whole),
            whole=_addresses(whole),
            within=_addresses(within),
            force=force,
            sums=contact.sums,
            summed=len(contact.sums),
            touch=contact.summed,
            touches=len(contact.summed),
            firsts=len(first),
            lates=len(late),
            size=np.array([len(view) for view in (*first, *late)], dtype=np.int32),
            **{"from": _addresses([*first, *late])},
        )
        self._views = [*first, *late, *whole, *within]
        self._senses: Structure | None = None

    def sense(self, senses: Structure) -> None:
        """Let sensors and lines have errors, by the structure `r47_senses`."""
        self._senses, self.structure.pointer.senses = senses, senses.pointer

    def prepare(self, first: int, late: int) -> None:
        """Take over what the grippers were told, and the columns of a row that `views` go to."""
        for i, hand in enumerate(self._hands):
            self._courses[:, i] = hand.course
        c = self.structure.pointer
        c.first, c.late = first, late


def compiled_world(
    robot: Robot,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    joints: tuple[Columns, Columns, Columns],
    hands: Sequence[SimulatedGripper],
    contact: ContactSensing,
    views: tuple[Sequence[Vector], Sequence[Vector]],
) -> CompiledWorld | None:
    """Return the world; None where numpy was chosen, or joints do not lie alike in all arrays."""
    alike = len({tuple(map(len, column.views)) for column in joints}) == 1
    if backend() == "numpy" or not alike:
        return None
    return CompiledWorld(robot, model, data, joints, hands, contact, views)


def _pieces(q: Columns, v: Columns, ctrl: Columns) -> dict[str, Any]:
    """Return the fields that lead to joints in several pieces, which are the same in all arrays."""
    if len(q.views) == 1:
        return {}
    return {
        "pieces": len(q.views),
        "q_at": _addresses(q.views),
        "v_at": _addresses(v.views),
        "ctrl_at": _addresses(ctrl.views),
        "length": np.array([len(view) for view in q.views], dtype=np.int32),
    }


def _addresses(views: Sequence[Vector]) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    return np.array([view.ctypes.data for view in views], dtype=np.int64)
