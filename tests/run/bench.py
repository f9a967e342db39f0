"""A bench with a plate that a tool comes down on, and programs that do it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from robo47_qp.motion.waypoint import Motion, Waypoint
from robo47_qp.run.failure import Cause, Condition
from robo47_qp.run.scenario import Run
from robo47_qp.run.task import Program
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from tests.examples import shifted
from tests.runs import Reach, carry_out

PLATE = 0.05
"""How far a soft plate is below the fingertips at home [m]."""


DOWN = np.array([0.0, 0.0, -1.0])


Writes = Callable[[Sensed], Program]


@dataclass(frozen=True, kw_only=True, eq=False)
class Bench(Reach):
    """A plate under the tool at home, and a program of the test."""

    writes: Writes
    name: str = "bench"

    @property
    def fixed_force_max(self) -> float:
        return 500.0

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        plate = spec.worldbody.add_body(name="plate", mocap=True, pos=[0.55, 0.0, 0.0])
        plate.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[0.0, 0.0, -0.05],
            size=[0.2, 0.2, 0.05],
            friction=[0.1, 0.005, 1e-4],
            solref=[-200.0, -10.0],
            solimp=[0.9, 0.9, 1e-3, 0.5, 2.0],
            priority=1,
        )

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        fingertips = simulation.tool_pose().translation() - [0.0, 0.0, 0.009]
        at = shifted(simulation.marker_pose("plate"), fingertips - [0.55, 0.0, PLATE])
        simulation.place_marker("plate", at)

    def preview(self, sensed: Sensed) -> Sequence[Waypoint]:
        return []

    def program(self, sensed: Sensed) -> Program:
        return self.writes(sensed)


def run_program(writes: Writes) -> Run:
    return carry_out(Bench(writes=writes))


def line(sensed: Sensed, by: Sequence[float], name: str = "line") -> Waypoint:
    target = shifted(sensed.tool_pose(), np.array(by))
    return Waypoint(name=name, target=target, motion=Motion.LIN)


def rows_of(run: Run, name: str, signal: str) -> np.ndarray:
    """Rows of a signal in the phases of a name."""
    ends = [phase.start for phase in run.phases[1:]] + [len(run.rows)]
    spans = [
        run.rows[signal][phase.start : end]
        for phase, end in zip(run.phases, ends, strict=True)
        if phase.name == name
    ]
    return np.concatenate(spans)


def touched(sensed: Sensed, force: float, cause: Cause = Cause.TIMEOUT) -> Condition:
    def against() -> str | None:
        felt = float(sensed.felt_force()[2])
        return None if felt >= force else f"{felt:.1f} N"

    return Condition(name="touched", cause=cause, against=against)
