"""Time profiles compared on the simulated arm: why jerk limits matter."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from robo47_qp.report.importing import importing

with importing():
    import numpy as np
    from rich.console import Console

    from robo47_qp.arrays import CheckedOptions, Matrix, Ratio, Suffix
    from robo47_qp.cli import LOGS, main
    from robo47_qp.constants import TIMESTEP
    from robo47_qp.control.joint_impedance import JointImpedance
    from robo47_qp.files import check_writable, write_json
    from robo47_qp.model.arm import Arm
    from robo47_qp.model.robot import MotionProfile, Robot
    from robo47_qp.model.robots.panda import PANDA
    from robo47_qp.motion.timing.rest_to_rest import (
        Cubic,
        Quintic,
        SCurve,
        TimeLaw,
        Trapezoid,
        plan_ptp,
    )
    from robo47_qp.motion.trajectory import Trajectory
    from robo47_qp.report.drawing import draw_curves
    from robo47_qp.report.figures_table import FiguresTable
    from robo47_qp.report.terminal import print_files
    from robo47_qp.run.control_loop import ControlLoop
    from robo47_qp.sim.simulation import Simulation

LAWS: Mapping[str, TimeLaw] = {
    "trapezoid": Trapezoid(),
    "cubic": Cubic(),
    "quintic": Quintic(),
    "S-curve": SCurve(),
}
_SETTLE = 0.4
"""Time at rest after the motion [s]."""
_SWING = np.array([0.9, 0.5, -0.4, 0.7, 0.5, 0.6, -0.8])
"""From home to the goal [rad]."""


@dataclass(frozen=True, kw_only=True)
class ProfileOptions(CheckedOptions):
    """Options of this scenario."""

    speed: Ratio = 1.0
    """Pace in (0, 1]."""
    equal_time: bool = False
    """Slow all down to the time of the slowest, instead of each as fast as it can."""
    report: Annotated[Path, Suffix(".json")] = LOGS / "profiles.json"
    """Where to write the figures; the plot goes beside it, with the ending .png."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tried:
    """One law on the simulated arm."""

    plan: Trajectory
    error: Matrix
    """Joint errors (N, n) [rad]."""
    tau: Matrix
    """Torques (N, n) [N·m]."""
    tool: Matrix
    """Distance of the tool from its reference (N, 1) [m]."""


def tried(robot: Robot, plan: Trajectory) -> Tried:
    """Follow a plan and then hold its end."""
    simulation = Simulation(robot, lambda _: None)
    loop = ControlLoop(Arm(robot), JointImpedance(), simulation)
    loop.track(plan)
    loop.hold(_SETTLE)
    rows = loop.recording.rows()
    tool = (rows["tool/pose_ref"] - rows["tool/pose"])[:, :3]
    return Tried(
        plan=plan,
        error=rows["joints/q_ref"] - rows["joints/q"],
        tau=rows["joints/tau_command"],
        tool=np.linalg.norm(tool, axis=1, keepdims=True),
    )


def figures(one: Tried) -> dict[str, float]:
    """What a learner compares; jerk and torque rate by differences over one control period."""
    plan = one.plan
    # Before and after the motion the arm is at rest: jumps of the acceleration there count.
    a = np.vstack([np.zeros(plan.a.shape[1]), plan.a, np.zeros(plan.a.shape[1])])
    return {
        "duration_s": plan.duration,
        "peak_v_rad_s": float(np.abs(plan.v).max()),
        "peak_a_rad_s2": float(np.abs(plan.a).max()),
        "peak_jerk_rad_s3": float(np.abs(np.diff(a, axis=0)).max() / plan.dt),
        "peak_torque_rate_Nm_s": float(np.abs(np.diff(one.tau, axis=0)).max() / plan.dt),
        "peak_joint_error_mrad": 1e3 * float(np.abs(one.error).max()),
        "peak_tool_error_mm": 1e3 * float(one.tool.max()),
    }


def planned(robot: Robot, options: ProfileOptions) -> dict[str, Trajectory]:
    """The same way under each law."""
    home, profile = np.array(robot.home), robot.profile.slowed(options.speed)

    def by(law: TimeLaw, bounds: MotionProfile) -> Trajectory:
        return plan_ptp(home, home + _SWING, bounds, TIMESTEP, law)

    plans = {name: by(law, profile) for name, law in LAWS.items()}
    if options.equal_time:
        slowest = max(plan.duration for plan in plans.values())
        plans = {
            name: by(law, profile.slowed(plans[name].duration / slowest))
            for name, law in LAWS.items()
        }
    return plans


def run(options: ProfileOptions, console: Console) -> int:
    """Compare, print, plot; returns the exit code."""
    plot = options.report.with_suffix(".png")
    for path in (options.report, plot):
        check_writable(path)
    results = {name: tried(PANDA, plan) for name, plan in planned(PANDA, options).items()}
    summary = {name: figures(one) for name, one in results.items()}
    headings = ("time s", "v rad/s", "a rad/s²", "jerk rad/s³", "N·m/s", "joint mrad", "tool mm")
    table = FiguresTable(("profile", *headings), texts=("profile",), title="Time profiles")
    for name, row in summary.items():
        table.add_row(name, *(f"{value:.4g}" for value in row.values()))
    console.print(table)
    write_json(options.report, summary)
    panels: dict[str, dict[str, tuple[Matrix, Matrix]]] = {}
    for name, one in results.items():
        joint = int(np.abs(_SWING).argmax())
        t = TIMESTEP * np.arange(0.0, len(one.error))
        moving = t[: one.plan.steps + 1]
        rate = np.diff(one.tau[:, joint], prepend=one.tau[0, joint]) / TIMESTEP
        for panel, x, y in (
            ("v [rad/s]", moving, one.plan.v[:, joint]),
            ("a [rad/s²]", moving, one.plan.a[:, joint]),
            ("torque rate [N·m/s]", t, rate),
            ("tool error [mm]", t, 1e3 * one.tool[:, 0]),
        ):
            panels.setdefault(panel, {})[name] = (x, y)
    draw_curves(panels).savefig(plot)
    print_files(console, {"report": options.report, "plot": plot})
    return 0


if __name__ == "__main__":
    sys.exit(main(ProfileOptions, run, __doc__))
