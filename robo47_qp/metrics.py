"""Figures that sum up a run."""

import numpy as np

from robo47_qp.run import Run
from robo47_qp.scene import TIMESTEP


def metrics(run: Run) -> dict[str, float]:
    """Tracking, time and cost of a run, with the task's own figures.

    Returns:
        By name with unit; see the README for what each means.
    """
    rows = run.rows
    simulated = len(rows) * TIMESTEP
    return {
        **run.measures,
        "max_joint_error_rad": float(np.abs(rows["errors/q"]).max()),
        "max_tool_error_m": float(rows["errors/tool_position"].max()),
        "rms_tool_error_m": float(np.sqrt((rows["errors/tool_position"] ** 2).mean())),
        "cycle_time_s": simulated,
        "real_time_factor": simulated / run.loop_seconds,
        "step_us": 1e6 * run.loop_seconds / len(rows),
    }
