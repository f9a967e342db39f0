"""Settings without sense are refused by every solver, and by the scenarios before they run."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from robo47_qp.cli import RunOptions
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import Tolerance
from robo47_qp.ik.stream.stream import StreamIk
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.motion.branch_choice import BranchChoice
from robo47_qp.motion.following.tracking import Tracking
from robo47_qp.motion.paths.segments import PathProfile
from scenarios.check_motions import CheckOptions
from scenarios.collision_ik import CollisionIkOptions
from scenarios.compare_controllers import ControllersOptions
from scenarios.settling import SettlingOptions
from scenarios.step_cost import StepCostOptions

SOLVERS: list[Callable[..., Any]] = [DlsIk, LmIk, QpIk]


@pytest.mark.parametrize("kind", SOLVERS)
@pytest.mark.parametrize("steps", [-1, 1.5, float("nan"), None])
def test_steps_are_a_whole_number(kind: Callable[..., Any], steps: object) -> None:
    with pytest.raises(InvalidValueError, match="max_iterations must be a whole number, 0 or more"):
        kind(max_iterations=steps)
    assert kind(max_iterations=0).max_iterations == 0


@pytest.mark.parametrize(
    ("kind", "name"),
    [(DlsIk, "damping"), (LmIk, "damping"), (QpIk, "lm_damping"), (QpIk, "posture_cost")],
)
@pytest.mark.parametrize("bad", [-1.0, float("nan"), float("inf")])
def test_weights_are_finite_and_not_negative(
    kind: Callable[..., Any], name: str, bad: float
) -> None:
    with pytest.raises(InvalidValueError, match=f"{name} must be 0 or more and finite"):
        kind(**{name: bad})
    assert getattr(kind(**{name: 0.0}), name) == 0.0


def test_an_obstacle_stands_at_a_pose() -> None:
    with pytest.raises(InvalidValueError, match=r"pose of obstacle 'a' must be a mink\.SE3"):
        Obstacle(name="a", shape=Shape.SPHERE, size=(0.1,), T_world_obstacle=np.eye(4))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "change", "message"),
    [
        (CollisionIkOptions, {"n": 0}, "--n must be a whole number, 1 or more; found 0"),
        (CollisionIkOptions, {"cluttered": -1}, "--cluttered must be a whole number, 0 or more"),
        (CollisionIkOptions, {"seed": -1}, "--seed must be a whole number, 0 or more"),
        (CollisionIkOptions, {"exhaustive": -1}, "--exhaustive must be a whole number, 0 or more"),
        (CollisionIkOptions, {"clearance": 5.0}, "--clearance must be above 0 and at most"),
        (CollisionIkOptions, {"clearance": float("nan")}, "--clearance must be above 0"),
        (CollisionIkOptions, {"report": "a.png"}, r"--report must be a file that ends with \.json"),
        (CheckOptions, {"ptp": -1}, "--ptp must be a whole number, 0 or more; found -1"),
        (ControllersOptions, {"log": "a.png"}, r"--log must be a file that ends with \.rrd"),
        (SettlingOptions, {"report": "a.rrd"}, r"--report must be a file that ends with \.json"),
        (StepCostOptions, {"rounds": 0}, "--rounds must be 1 or more; found 0"),
        (RunOptions, {"ik": "dls", "qp_solver": "osqp"}, "--qp-solver must be left out unless"),
    ],
)
def test_options_without_sense_are_refused(
    options: Callable[..., Any], change: dict[str, Any], message: str, tmp_path: Any
) -> None:
    values = {k: tmp_path / v if k in ("report", "log") else v for k, v in change.items()}
    with pytest.raises(InvalidValueError, match=message):
        options(**values)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), "a"])
def test_what_counts_as_reached_is_above_zero(bad: object) -> None:
    for field in ("position", "orientation"):
        with pytest.raises(InvalidValueError, match=f"{field} must be above 0"):
            Tolerance(**{field: bad})  # type: ignore[arg-type]
    assert Tolerance(orientation=float("inf")).orientation == float("inf")


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        (BranchChoice, {"candidates": 0}),
        (BranchChoice, {"crowding": float("nan")}),
        (Tracking, {"knot_spacing": 0.0}),
        (Tracking, {"deviation": float("nan")}),
        (PathProfile, {"linear": (0.25, 0.0, 5.0)}),
        (PathProfile, {"angular": (1.0, float("nan"), 5.0)}),
        (StreamIk, {"frozen": "joint3"}),
    ],
)
def test_settings_of_paths_and_streams_are_checked(
    kind: Callable[..., Any], settings: dict[str, Any]
) -> None:
    with pytest.raises(InvalidValueError, match=next(iter(settings))):
        kind(**settings)
