"""Mean settling time of the controlled arm over random steps of its reference.

The arm stands at home, alone in its world, held by joint impedance control. At the instant 0
the reference jumps by a random offset, drawn evenly from ±`offset` in every joint, and stays.
The error is the Euclidean norm over the joints |q_ref - q|, sampled at 1 kHz; the band is 2 % of
the offset's norm, the settling time the last time at which the error is outside the band. The
motors' limits of torque and torque rate act as in every run.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from robo47_qp.report.importing import importing

with importing():
    import mujoco
    import numpy as np
    from rich.console import Console

    from robo47_qp.arrays import Vector
    from robo47_qp.cli import FAILED, LOGS, OK, main
    from robo47_qp.constants import TIMESTEP
    from robo47_qp.control.joint_impedance import JointImpedance
    from robo47_qp.errors import InvalidValueError
    from robo47_qp.evaluation.benchmarks.settling.settling import settling_time
    from robo47_qp.evaluation.benchmarks.settling.study import StudyOptions, conclude
    from robo47_qp.files import check_writable
    from robo47_qp.model.arm import Arm, JointReference
    from robo47_qp.model.robots.panda import PANDA
    from robo47_qp.report.provenance import provenance
    from robo47_qp.run.control_loop import ControlLoop
    from robo47_qp.sim.simulation import Simulation


@dataclass(frozen=True, kw_only=True)
class SettlingOptions(StudyOptions):
    """Options of this scenario."""

    report: Path = LOGS / "settling.json"
    """File for the figures (JSON)."""
    seconds: float = 2.0
    """How long each start is watched [s]."""
    offset: float = 0.04
    """Largest offset of a joint [rad]."""

    def __post_init__(self) -> None:
        """Check what no type can.

        Raises:
            InvalidValueError: A number is out of range.
        """
        super().__post_init__()
        # The nearest joint limit of the arm at home is 0.7 rad away.
        if not 0.0 < self.offset <= 0.2:
            raise InvalidValueError("--offset", self.offset, "above 0 and at most 0.2 [rad]")


@dataclass(frozen=True, kw_only=True)
class Response:
    """How the arm answered one step of its reference."""

    errors: Vector
    """|q_ref - q| at 0, 1 ms, 2 ms, ... (N,) [rad]."""
    torque_use: float
    """Largest torque of a motor as a share of its limit [-]."""


def step_response(simulation: Simulation, arm: Arm, offset: Vector, seconds: float) -> Response:
    """Let the reference jump from home by an offset (n,) [rad], and record the response."""
    simulation.reset()
    loop = ControlLoop(arm, JointImpedance(), simulation)
    still = np.zeros(arm.n)
    loop.take_over(JointReference(arm.home + offset, still, still))
    loop.hold(seconds)
    rows = loop.recording.rows()
    q = np.vstack([rows["joints/q"], simulation.state().q])
    return Response(
        errors=np.linalg.norm(arm.home + offset - q, axis=1),
        torque_use=float(np.max(np.abs(rows["joints/tau"]) / arm.robot.tau_max)),
    )


def run(options: SettlingOptions, console: Console) -> int:
    """Measure, print, write; returns the exit code."""
    check_writable(options.report)
    others = {"robot": PANDA.name, **provenance()}
    arm, simulation = Arm(PANDA), Simulation(PANDA, _nothing_else)
    rng = np.random.default_rng(options.seed)
    offsets = rng.uniform(-options.offset, options.offset, (options.starts, arm.n))
    responses = [step_response(simulation, arm, o, options.seconds) for o in offsets]
    times = np.array([settling_time(response.errors, TIMESTEP) for response in responses])
    columns = {
        "offset mrad": [f"{1e3 * response.errors[0]:.1f}" for response in responses],
        "largest torque %": [f"{100 * response.torque_use:.0f}" for response in responses],
    }
    return OK if conclude(options, times, columns, others, console) else FAILED


def _nothing_else(spec: mujoco.MjSpec) -> None:
    """The arm is alone."""


if __name__ == "__main__":
    sys.exit(main(SettlingOptions, run, __doc__))
