"""Perturbations: ranges, and what is drawn from them."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console

from robo47_qp.cli import main
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.evaluation.perturbation import PRESETS, Perturbation, options
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.disturbance import DisturbedSimulation
from robo47_qp.tasks.table import add_table
from tests.controlled import LOAD
from tests.runs import Reach

WIDE = Perturbation(object_mass=0.3, friction=0.5, pushes=3, push_force=10.0, push_time=4.0)


def test_nothing_is_wrong_by_default() -> None:
    drawn = Perturbation().draw(np.random.default_rng(1))
    assert (drawn.object_mass_factor, drawn.friction_factor) == (1.0, 1.0)
    assert (drawn.torque_delay, tuple(drawn.pushes), drawn.noisy) == (0.0, (), False)
    assert PRESETS["none"] == Perturbation()


def test_draws_fill_their_ranges_evenly() -> None:
    drawn = [WIDE.draw(np.random.default_rng([seed, 1])) for seed in range(400)]
    for name, width in (("object_mass_factor", 0.3), ("friction_factor", 0.5)):
        values = np.array([getattr(one, name) for one in drawn])
        assert 1 - width <= values.min() < 1 - 0.97 * width
        assert 1 + 0.97 * width < values.max() <= 1 + width
        assert values.mean() == pytest.approx(1.0, abs=0.1 * width)
        assert values.std() == pytest.approx(width / np.sqrt(3), rel=0.06)
    factors = [(one.object_mass_factor, one.friction_factor) for one in drawn]
    assert abs(np.corrcoef(np.transpose(factors))[0, 1]) < 0.15
    forces = np.array([push.force for one in drawn for push in one.pushes])
    sizes = np.linalg.norm(forces, axis=1)
    assert 9.8 < sizes.max() <= 10.0
    assert sizes.mean() == pytest.approx(5.0, rel=0.06)
    assert forces.mean(axis=0) == pytest.approx(np.zeros(3), abs=0.4)
    starts = np.array([push.start for one in drawn for push in one.pushes])
    assert 3.9 < starts.max() <= 4.0
    assert starts.mean() == pytest.approx(2.0, rel=0.06)


def test_what_is_asked_for_does_not_change_what_else_is_drawn() -> None:
    """Paired: the world of a seed has the same friction with and without pushes."""
    full, less = (
        one.draw(np.random.default_rng(5))
        for one in (WIDE, dataclasses.replace(WIDE, object_mass=0.0, pushes=1))
    )
    assert full.friction_factor == less.friction_factor
    assert less.object_mass_factor == 1.0
    assert less.pushes[0].force.tolist() == full.pushes[0].force.tolist()
    rngs = [np.random.default_rng(5), np.random.default_rng(5)]
    for rng, one in zip(rngs, (WIDE, Perturbation()), strict=True):
        one.draw(rng)
    assert rngs[0].integers(2**62) == rngs[1].integers(2**62)


def test_the_levels_are_as_told() -> None:
    drawn = PRESETS["moderate"].draw(np.random.default_rng(1))
    assert (drawn.pose_noise, drawn.heading_noise, drawn.torque_delay) == (5e-3, 0.0, 2e-3)
    assert PRESETS["moderate"].object_mass == PRESETS["moderate"].friction == 0.3
    for name, value in vars(PRESETS["severe"]).items():
        assert value is None or value >= getattr(PRESETS["moderate"], name)


def test_single_options_stand_in_place_of_those_of_the_level() -> None:
    single: dict[str, float | str] = {
        "torque_delay": "1:2",
        "mass": 0.1,
        "pose_noise": 0.0,
        "link_mass": "0.05",
    }
    chosen = EvaluateOptions(perturb="moderate", perturbations=single)
    assert chosen.perturbation == dataclasses.replace(
        PRESETS["moderate"],
        torque_delay=(1e-3, 2e-3),
        object_mass=0.1,
        pose_noise=0.0,
        link_mass=0.05,
    )
    assert EvaluateOptions(perturb="severe").perturbation == PRESETS["severe"]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"pose_noise": -1.0}, "pose_noise must be 0 or more and finite; found -1"),
        ({"torque_delay": np.nan}, "torque_delay must be 0 or more and finite: .* found nan"),
        ({"link_mass": (-1.5, 0.1)}, "link_mass must be above -1 and finite: one number, or two"),
        ({"joint_friction": (0.6, 0.2)}, "joint_friction must be .* two in rising order; found"),
        ({"object_mass": 1.0}, "object_mass must be at least 0 and below 1; found 1"),
        ({"friction": 1.5}, "friction must be at least 0 and below 1; found 1.5"),
        ({"camera_rate": 0.0}, "camera_rate must be above 0 and finite; found 0"),
        ({"pushes": 4}, "pushes must be a whole number, at least 0 and at most 3; found 4"),
    ],
)
def test_other_ranges_are_refused(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        Perturbation(**setting)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"mass": 1.5}, r"^--mass must be at least 0 and below 1; found 1.5\.$"),
        ({"state_delay": "-2"}, r"^--state-delay must be 0 or more and finite: .*; found -2\.$"),
        ({"link_mass": "a:b"}, r"^--link-mass must be a number, or a range such as 0.1:0.2; f"),
        ({"link_mass": "0.1:0.2:0.3"}, r"^--link-mass must be .* two in rising order; found 0.1:"),
        ({"link_mass": "0.1:-0.1"}, r"^--link-mass must be .* in rising order; found 0.1:-0.1\.$"),
        ({"pose_noise": np.nan}, r"^--pose-noise must be 0 or more and finite; found nan\.$"),
        ({"pushes": 4}, r"^--pushes must be a whole number, at least 0 and at most 3; found 4\.$"),
    ],
)
def test_an_option_is_refused_by_its_own_name(chosen: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        _ = EvaluateOptions(perturbations=chosen).perturbation


def test_an_option_that_is_not_there_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="No perturbation is called 'object_mass'; known: "):
        Perturbation().with_options({"object_mass": 0.1})


def test_a_rate_is_refused_by_its_own_name() -> None:
    with pytest.raises(InvalidValueError, match=r"^--rate must be above 0 and at most 1000; found"):
        EvaluateOptions(policy=("mine.py:Mine",), rate=0.0)


@dataclass(frozen=True)
class Effect:
    """What a perturbation is tried with, and what it changes."""

    option: float | str
    """Value of its option."""
    changes: set[str]
    beside: Mapping[str, object] = field(default_factory=dict)
    """Fields without which it does nothing."""


PUSHED = {"pushes": 1, "push_force": 30.0, "push_time": 0.0}
EFFECTS = {
    "pose_noise": Effect(0.01, {"seen position"}),
    "heading_noise": Effect(0.1, {"seen heading"}),
    "pose_bias": Effect(0.01, {"seen position"}),
    "camera_rate": Effect(60.0, {"seen position"}, {"pose_noise": 0.01}),
    "object_mass": Effect(0.5, {"mass"}),
    "friction": Effect(0.5, {"friction"}),
    "link_mass": Effect("-0.05:0.05", {"motion", "links"}),
    "link_inertia": Effect("-0.1:0.1", {"motion", "links"}),
    "link_com": Effect(0.005, {"motion", "links"}),
    "joint_friction": Effect("0.2:0.6", {"motion", "joints"}),
    "wrist_friction": Effect(0.5, {"motion", "joints"}, {"joint_friction": 0.5}),
    "joint_damping": Effect("-0.3:0.3", {"motion", "joints"}),
    "armature": Effect("-0.2:0.2", {"motion", "joints"}),
    "payload_error": Effect("-0.2:0.2", {"payload told"}),
    "state_delay": Effect("0.5:1", {"measured q", "measured v"}),
    "torque_delay": Effect("1:2", {"motion"}),
    "noise_q": Effect(1e-3, {"measured q", "measured v"}),
    "velocity_cutoff": Effect(20.0, {"measured v"}),
    "noise_force": Effect(0.3, {"measured force"}),
    "force_drift": Effect(1.0, {"measured force"}),
    "pushes": Effect(1, {"motion"}, PUSHED),
    "push_force": Effect(30.0, {"motion"}, PUSHED),
    "push_time": Effect(0.05, {"motion"}, PUSHED),
}
"""Every perturbation has an entry: whoever adds one says here what it changes."""
NO_ZERO = {"camera_rate", "push_time", "wrist_friction", "velocity_cutoff"}
"""Those that say how, and not how much."""


def brick(spec: mujoco.MjSpec) -> None:
    add_table(spec)
    body = spec.worldbody.add_body(name="brick", pos=[0.5, 0.2, 0.02])
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02] * 3, mass=0.2)


@cache
def observed(perturbation: Perturbation) -> dict[str, NDArray[np.float64]]:
    """What can be seen of a world under changing torques."""
    rng = np.random.default_rng([3, 1])
    world = DisturbedSimulation(PANDA, brick, perturbation.draw(rng), rng)
    held, seen = world.motor_torque(), []
    for k in range(450):
        world.step(held + np.sin(0.1 * k))
        if k < 300:  # until the brick has settled
            continue
        pose, true, said = world.seen_pose("brick"), world.true_state(), world.state()
        yaw = pose.rotation().compute_yaw_radians()
        # An object at rest: what is seen of it does not depend on the arm.
        seen.append(np.concatenate([pose.translation(), [yaw], true.q, said.q - true.q]))
        felt = world.felt_force() - world.last_tool_force()
        seen[-1] = np.concatenate([seen[-1], said.v - true.v, felt])
    rows, m = np.round(seen, 6), world.model
    told = world.told_payload(LOAD)
    dofs, links = slice(0, 7), slice(1, 12)
    return {
        "seen position": rows[:, :3],
        "seen heading": rows[:, 3:4],
        "motion": rows[:, 4:11],
        "measured q": rows[:, 11:18],
        "measured v": rows[:, 18:25],
        "measured force": rows[:, 25:],
        "links": np.c_[m.body_mass, m.body_inertia, m.body_ipos][links],
        "joints": np.c_[m.dof_frictionloss, m.dof_damping, m.dof_armature][dofs],
        "payload told": np.array([told.mass, *told.inertia]),
        "mass": m.body("brick").mass.copy(),
        "friction": m.geom_friction.copy(),
    }


@pytest.mark.parametrize("option", options())
def test_every_perturbation_is_an_option_that_changes_what_it_says_and_is_reported(
    option: str,
) -> None:
    name, _, about = options()[option]
    effect = EFFECTS[name]
    seen: list[EvaluateOptions] = []

    def run(chosen: EvaluateOptions, _: Console) -> int:
        seen.append(chosen)
        return 0

    flags = [f"--{option.replace('_', '-')}", str(effect.option)]
    assert main(EvaluateOptions, run, "", args=flags) == 0
    numbers = [float(part) * about.scale for part in str(effect.option).split(":")]
    value: object = tuple(numbers) if len(numbers) > 1 else numbers[0]
    if isinstance(effect.option, int):
        value = effect.option
    assert seen[0].perturbation == Perturbation(**{name: value})  # type: ignore[arg-type]
    settings = seen[0].evaluation(Reach(), PANDA).evaluation.settings
    assert settings["perturbation"][name] == pytest.approx(numbers if numbers[1:] else value)
    assert about.text
    assert about.unit

    def world(**chosen: object) -> dict[str, NDArray[np.float64]]:
        return observed(Perturbation(**{**effect.beside, **chosen}))  # type: ignore[arg-type]

    default = getattr(Perturbation(), name)
    changed, before = world(**{name: value}), world(**{name: default})
    assert {k for k in before if not np.array_equal(changed[k], before[k])} == effect.changes
    if name not in NO_ZERO:
        assert default == 0
        zero = world(**{name: 0})
        still = observed(Perturbation())
        assert {k for k in still if not np.array_equal(zero[k], still[k])} == set()
