"""Identify what a Panda does not know of itself: payload, dry friction and heavier links.

The arm makes a motion of a few seconds that turns the tool about horizontal axes and moves each
joint both ways, in a world that is wrong as the options say; the controller believes none of it.
What its disturbance observer sees is explained by least squares (`Identification`), and told beside
what the world has.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from robo47_qp.report.importing import importing

with importing():
    import mujoco
    import numpy as np
    from mink import SE3
    from rich.console import Console

    from robo47_qp.arrays import Checked, NotNegative, Range
    from robo47_qp.cli import LOGS, OK, main
    from robo47_qp.constants import TIMESTEP
    from robo47_qp.control.active import ActiveController
    from robo47_qp.control.computed_torque import ComputedTorque
    from robo47_qp.control.identification import Identification, Identified
    from robo47_qp.control.observer import DisturbanceObserver
    from robo47_qp.files import check_writable, write_json
    from robo47_qp.model.arm import Arm, JointReference
    from robo47_qp.model.payload import Payload
    from robo47_qp.model.robots.panda import PANDA
    from robo47_qp.motion.timing.rest_to_rest import plan_ptp
    from robo47_qp.report.figures_table import FiguresTable
    from robo47_qp.report.provenance import provenance
    from robo47_qp.report.terminal import print_files
    from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation

_WAYS = 0.5 * np.array(
    [
        [1.0, 0.6, -0.8, 0.8, 1.2, -0.8, 1.0],
        [-1.0, -0.3, 0.8, -0.4, -1.2, 1.0, -1.0],
        [0.4, 0.5, 0.9, 0.6, 0.9, 0.8, 0.6],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)
"""Joint positions of the motion, from home [rad]."""
_EVERY, _FROM = 10, 100
"""Periods between two samples, and those at the start of a way that are left out."""
_WRIST = 0.6
"""Dry friction of joints 5 to 7, as a part of that of the first four; see `Disturbance`."""
_BEYOND = 0.05
"""Distance of the payload's centre from the tool point [m]."""


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions(Checked):
    """Options of this scenario."""

    report: Path = LOGS / "identify.json"
    """File for the figures (JSON)."""
    payload: NotNegative = 0.5
    """Mass in the hand, 50 mm beyond the tool point [kg]."""
    joint_friction: NotNegative = 0.5
    """Dry friction of joints 1 to 4 [N·m]; 0.6 of it in the others."""
    link_mass: NotNegative = 0.0
    """By how much every link is heavier, as a share."""
    noise_q: NotNegative = 0.0
    """Standard deviation of the noise of joint positions [rad]."""
    seed: Annotated[int, Range(at_least=0, whole=True)] = 0
    """Of the noise."""


def identified(wrong: Disturbance, rng: np.random.Generator) -> Identified:
    """Move the arm in a world that is wrong, and explain what the observer sees.

    Raises:
        InvalidValueError: Something is not of this robot.
    """
    arm, found = Arm(PANDA), Identification(Arm(PANDA))
    simulation = DisturbedSimulation(PANDA, _nothing_else, wrong, rng)
    # What is to be found must not be learned and fed forward meanwhile.
    observer = DisturbanceObserver(noise_q=wrong.noise_q, friction=None)
    active = ActiveController(ComputedTorque(), arm, dt=TIMESTEP, observer=observer)
    start = arm.home
    for offset in _WAYS:
        way = plan_ptp(start, arm.home + offset, PANDA.profile, TIMESTEP)
        start = arm.home + offset
        for k, (q, v, a) in enumerate(zip(way.q, way.v, way.a, strict=True)):
            simulation.step(active.torque(JointReference(q, v, a), simulation.state()))
            if k % _EVERY == 0 and k > _FROM and active.observed is not None:
                found.add(q, v, a, active.observed.disturbance)
    return found.solve()


def run(options: IdentifyOptions, console: Console) -> int:
    """Identify, print, write; returns the exit code."""
    check_writable(options.report)
    wrong = Disturbance(
        payload=_payload(options.payload) if options.payload else None,
        dry_friction=options.joint_friction,
        link_mass_factor=1.0 + options.link_mass,
        noise_q=options.noise_q,
    )
    made = provenance()
    found = identified(wrong, np.random.default_rng(options.seed))
    table = FiguresTable(("parameter", "in the world", "found"), texts=("parameter",))
    friction = options.joint_friction * np.array([1.0] * 4 + [_WRIST] * 3)
    table.add_row("payload, kg", f"{options.payload:.3f}", f"{found.payload_mass:.3f}")
    z = (_BEYOND if options.payload else 0.0, found.payload_com[2])
    table.add_row("its centre beyond the tool point, mm", *(f"{1e3 * one:.0f}" for one in z))
    for joint, true, one in zip(PANDA.joints, friction, found.friction, strict=True):
        table.add_row(f"dry friction of {joint}, N·m", f"{true:.2f}", f"{one:.2f}")
    masses = (options.link_mass, found.link_mass)
    table.add_row("links heavier by, %", *(f"{100 * one:.1f}" for one in masses))
    console.print(table)
    console.print(f"unexplained: {found.deviation:.3f} N·m (root mean square)")
    report = {
        "world": {
            "payload_kg": options.payload,
            "friction_Nm": friction.tolist(),
            "link_mass": options.link_mass,
            "noise_q_rad": options.noise_q,
        },
        "found": {
            "payload_kg": found.payload_mass,
            "payload_com_m": np.asarray(found.payload_com).tolist(),
            "friction_Nm": np.asarray(found.friction).tolist(),
            "link_mass": found.link_mass,
            "deviation_Nm": found.deviation,
        },
    }
    write_json(options.report, {**made, **report})
    print_files(console, {"report": options.report})
    return OK


def _payload(mass: float) -> Payload:
    at = SE3.from_translation(np.array([0.0, 0.0, _BEYOND]))
    return Payload(mass=mass, inertia=(1e-3 * mass,) * 3, T_tcp_com=at)


def _nothing_else(spec: mujoco.MjSpec) -> None:
    """The arm is alone."""


if __name__ == "__main__":
    sys.exit(main(IdentifyOptions, run, __doc__))
