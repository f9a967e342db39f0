import json
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from robo47_qp.arrays import Vector
from robo47_qp.errors import UnknownNameError
from robo47_qp.evaluation.statistics import wilson
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.solver import IkResult
from robo47_qp.ik.tool_demand import FULL
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.tool_poses import Target
from robo47_qp.motion.waypoint import tool_down
from scenarios.free_axis import FreeAxisOptions, _error, drawn, measured, run


def test_a_free_axis_reaches_more_from_one_start_and_all_tight(tmp_path: Path) -> None:
    screen, out = StringIO(), tmp_path / "free.json"
    options = FreeAxisOptions(n=12, solvers=("lm", "dls-single"), box="tabletop", report=out)
    assert run(options, Console(file=screen, width=80)) == 0
    told = json.loads(out.read_text())
    lm, dls = (told["figures"][f"{name}, free axis"] for name in ("lm", "dls-single"))
    fixed = told["figures"]["dls-single, fixed axis"]
    assert lm["tight"] == told["known_to_be_reachable"] == 12
    assert fixed["tight"] <= dls["tight"] <= 12
    assert fixed["outside_limits"] == 0
    assert told["missed_by_the_first"] == 0
    assert "commit" in told


def test_the_wide_box_goes_beyond_reach() -> None:
    arm = Arm(PANDA)
    beyond = [
        [arm.target_beyond_reach(one) > 0.0 for one in drawn(arm, FreeAxisOptions(n=60, box=box))]
        for box in ("tabletop", "wide")
    ]
    assert not any(beyond[0])
    assert 0 < sum(beyond[1]) < 60


def test_the_error_is_that_of_the_direction_or_of_the_whole_pose() -> None:
    arm = Arm(PANDA)
    target = tool_down([0.5, 0.0, 0.3], 0.3)
    q = arm.home.copy()
    pose = arm.pose(q)
    axis = pose.rotation().as_matrix()[:, 2]
    away = float(np.linalg.norm(pose.translation() - target.translation()))
    lean = float(np.arccos(-axis[2]))
    assert _error(arm, target, q, whole=False) == pytest.approx(max(away, lean))
    assert _error(arm, target, q, whole=True) >= max(away, lean) - 1e-9
    up = tool_down(pose.translation())
    q[5] += np.pi / 2.0
    assert _error(arm, up, q, whole=False) > 1.0


def test_an_unknown_solver_is_refused() -> None:
    with pytest.raises(UnknownNameError):
        run(FreeAxisOptions(solvers=("ppo",)), Console(quiet=True))


def test_the_interval_is_that_of_what_was_reached() -> None:
    """An answer that is not tight counts as reached."""

    class Near(LmIk):
        def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
            found = super().solve(arm, T_world_target, q_seed)
            return replace(found, q=found.q + 1e-3)

    arm = Arm(PANDA)
    targets = [arm.pose(arm.home)] * 4
    figures, tight = measured(arm, Near(), FULL, targets)
    assert (figures["reached"], figures["tight"], int(tight.sum())) == (4, 0, 0)
    assert figures["interval"] == list(wilson(4, 4))
