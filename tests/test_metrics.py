"""Metrics: figures recomputed by hand from rows with known numbers."""

from dataclasses import replace

import numpy as np
import pytest

from robo47_qp.metrics import metrics
from robo47_qp.recording import Rows
from tests.runs import picked_and_placed


def test_figures_of_made_up_rows() -> None:
    run = picked_and_placed()
    rows = Rows(run.rows.signals, np.zeros((2000, run.rows.values.shape[1])))
    rows["errors/q"][100, 3] = -0.7
    rows["errors/q"][200, 1] = 0.5
    rows["errors/tool_position"][:1000, 0] = 3.0
    rows["errors/tool_position"][5, 0] = 4.0
    made_up = replace(run, rows=rows, loop_seconds=0.25, measures={"place_error_m": 0.125})
    figures = metrics(made_up)
    assert figures.pop("rms_tool_error_m") == pytest.approx(np.sqrt((999 * 9 + 16) / 2000))
    assert figures == pytest.approx(
        {
            "place_error_m": 0.125,
            "max_joint_error_rad": 0.7,
            "max_tool_error_m": 4.0,
            "cycle_time_s": 2.0,
            "real_time_factor": 8.0,
            "step_us": 125.0,
        }
    )


def test_figures_of_a_real_run() -> None:
    run = picked_and_placed()
    rows, figures = run.rows, metrics(run)
    error = np.abs(rows["joints/q_ref"] - rows["joints/q"]).max()
    assert figures["max_joint_error_rad"] == pytest.approx(error)
    off = np.linalg.norm(rows["tool/pose_ref"][:, :3] - rows["tool/pose"][:, :3], axis=1)
    assert figures["max_tool_error_m"] == pytest.approx(off.max())
    assert figures["rms_tool_error_m"] <= figures["max_tool_error_m"] < 1e-3
    assert figures["cycle_time_s"] == pytest.approx(rows["time"][-1, 0] + 1e-3)
    assert figures["place_error_m"] == run.measures["place_error_m"]
    assert figures["real_time_factor"] * figures["step_us"] == pytest.approx(1000.0)
    assert all(isinstance(value, float) for value in figures.values())
