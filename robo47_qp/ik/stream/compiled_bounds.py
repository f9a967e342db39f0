"""CompiledBounds: clearance bounds of a stream by the compiled core."""

from typing import Any

import mujoco
import numpy as np

from robo47_qp._core.library import Structure, backend, functions, pointer
from robo47_qp._core.mujoco_functions import function, structure
from robo47_qp.arrays import Vector
from robo47_qp.collision.clearance import Clearance
from robo47_qp.collision.distance import FAR
from robo47_qp.ik.stream import clearance_bounds
from robo47_qp.ik.stream.clearance_bounds import ClearanceBounds, VelocityRows
from robo47_qp.model.chain import MAX_JOINTS


class CompiledBounds(ClearanceBounds):
    """The same rows as `ClearanceBounds`, up to rounding, by the compiled core."""

    def __init__(
        self,
        clearance: Clearance,
        data: mujoco.MjData,
        a_max: Vector,
        dt: float,
        *,
        d_min: float,
        braking_share: float,
        max_pairs: int,
    ) -> None:
        """See `ClearanceBounds`."""
        super().__init__(
            *(clearance, data, a_max, dt),
            d_min=d_min,
            braking_share=braking_share,
            max_pairs=max_pairs,
        )
        m, count, n = self._model, len(self._ends), clearance.arm.n
        first, second = np.transpose(self._ends).astype(np.int32)
        kinds = [self._measure.capsule_and_box(a, b) for a, b in self._ends]
        capsule, box = np.transpose(kinds).astype(np.int32)
        self._pair, self._within = np.zeros(count, dtype=np.int64), np.zeros(count)
        self._apart, self._doubtful = np.zeros(count), np.zeros(count, dtype=np.uint8)
        # A tick has no more rows than there are pairs.
        self._rows = VelocityRows(
            np.zeros((count, n)), np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.int64)
        )
        self._core = Structure(
            "r47_clearance",
            n=n,
            pairs=count,
            most=max_pairs,
            model=structure(m),
            data=structure(data),
            distance=function("mj_geomDistance"),
            xpos=data.geom_xpos,
            xmat=data.geom_xmat,
            size=m.geom_size,
            first=first.copy(),
            second=second.copy(),
            capsule=capsule.copy(),
            box=box.copy(),
            cdof=data.cdof,
            com=data.subtree_com,
            root=m.body_rootid[m.jnt_bodyid].astype(np.int32),
            sign=self._closing.sign,
            L=self._L,
            least_brake=self._least_brake,
            a=self._a,
            dt=dt,
            d_min=d_min,
            **_constants(),
            bound=self._bound,
            A=self._A,
            stop=self._stop,
            brake=self._brake,
            unseen=self._unseen.view(np.uint8),
            looked=self._looked.view(np.uint8),
            q=self._q,
            pair=self._pair,
            within=self._within,
            apart=self._apart,
            segment=self._segment,
            doubtful=self._doubtful,
            key=np.zeros(count),
            order=np.zeros(count, dtype=np.int64),
            other=np.zeros(count, dtype=np.int64),
            row_A=self._rows.A,
            row_upper=self._rows.upper,
            row_room=self._rows.room,
            row_pair=self._rows.pair,
        )
        self._given = np.zeros((2, n))
        self._q_and_v = pointer(self._given[0]), pointer(self._given[1])

    def reset(self, q: Vector) -> None:
        """See `ClearanceBounds.reset`."""
        self._given[0] = q
        if functions().r47_clearance_reset(self._core.pointer, self._q_and_v[0]):
            self._measure_again()
        functions().r47_clearance_take(self._core.pointer)
        self.measured = self._core.pointer.measured

    def rows(self, q: Vector, v: Vector) -> VelocityRows:
        """See `ClearanceBounds.rows`; the next call overwrites the arrays."""
        self._given[:] = q, v
        core, at, call = self._core.pointer, self._q_and_v, functions()
        if call.r47_clearance_look(core, *at):
            self._measure_again()
        call.r47_clearance_take(core)
        count = call.r47_clearance_rows(core, at[1])
        self.measured = core.measured
        A, upper, room, pair = self._rows
        return VelocityRows(A[:count], upper[:count], room[:count], pair[:count])

    def _measure_again(self) -> None:
        c = self._core.pointer
        for k in np.flatnonzero(self._doubtful[: c.picked]).tolist():
            ends, far = self._ends[int(self._pair[k])], float(self._within[k]) + c.ahead
            self._apart[k] = self._measure.between(*ends, far)
            self._segment[k] = self._measure.segment


def _constants() -> dict[str, Any]:
    return {
        "far": FAR,
        "ahead": clearance_bounds.AHEAD,
        "touch": clearance_bounds.TOUCH,
        "near": clearance_bounds.NEAR,
        "least": clearance_bounds.LEAST,
        "parting": clearance_bounds.PARTING,
        "regain": clearance_bounds.REGAIN,
        "unsure": clearance_bounds.UNSURE,
        "trusted": clearance_bounds.TRUSTED,
    }


def bounds_type(n: int) -> type[ClearanceBounds]:
    """Return the class that the chosen backend has for n joints."""
    compiled = backend() == "compiled" and n <= MAX_JOINTS
    return CompiledBounds if compiled else ClearanceBounds
