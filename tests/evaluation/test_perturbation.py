"""Perturbations: ranges, and what is drawn from them."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console

from robo47_qp.cli import main
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.evaluation.perturbation import (
    PRESETS,
    Perturbation,
    options,
    perturbation_table,
)
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.tasks.table import add_table
from tests.runs import Reach

ROOT = Path(__file__).resolve().parents[2]
LEVELS = ("moderate", "severe")
WIDE = Perturbation(
    object_mass=(-0.3, 0.3),
    object_com=0.01,
    friction=(0.3, 0.9),
    link_mass=(-0.05, 0.05),
    link_com=5e-3,
    link_inertia=(-0.2, 0.1),
    joint_friction=(0.2, 0.6),
    joint_damping=(-0.3, 0.5),
    armature=(0.1, 0.2),
    payload_error=(-0.2, 0.4),
    object_size=(-0.02, 0.01),
    pushes=3,
    push_force=10.0,
    push_time=4.0,
)


def test_nothing_is_wrong_by_default() -> None:
    drawn, nothing = Perturbation().draw(np.random.default_rng(1)), Disturbance()
    for item in dataclasses.fields(Disturbance):
        assert getattr(drawn, item.name) == getattr(nothing, item.name), item.name
    assert not drawn.noisy
    assert not drawn.camera_errs
    assert PRESETS["none"] == Perturbation()


def test_draws_fill_their_ranges_evenly() -> None:
    drawn = [WIDE.draw(np.random.default_rng([seed, 1])) for seed in range(400)]
    columns = {}
    for name, low, high in (
        ("object_mass_factor", 0.7, 1.3),
        ("object_com_shift", -0.01, 0.01),
        ("friction", 0.3, 0.9),
        ("link_mass_factor", 0.95, 1.05),
        ("link_com_shift", -5e-3, 5e-3),
        ("link_inertia_factor", 0.8, 1.1),
        ("dry_friction", 0.2, 0.6),
        ("damping_factor", 0.7, 1.5),
        ("armature_factor", 1.1, 1.2),
        ("payload_factor", 0.8, 1.4),
        ("object_size_factor", 0.98, 1.01),
    ):
        values = np.array([np.ravel(getattr(one, name)) for one in drawn])
        columns[name] = values[:, :8]
        assert columns[name].shape[1] == (1 if name in ("friction", "payload_factor") else 8)
        span = high - low
        assert low <= values.min() < low + 0.02 * span
        assert high - 0.02 * span < values.max() <= high
        assert values.mean() == pytest.approx((low + high) / 2, abs=0.05 * span)
        assert values.std() == pytest.approx(span / np.sqrt(12), rel=0.06)
    # Each link, joint and object has a value of its own.
    together = np.hstack(list(columns.values()))
    assert np.abs(np.corrcoef(together.T) - np.eye(together.shape[1])).max() < 0.25
    forces = np.array([push.force for one in drawn for push in one.pushes])
    sizes = np.linalg.norm(forces, axis=1)
    assert 9.8 < sizes.max() <= 10.0
    assert sizes.mean() == pytest.approx(5.0, rel=0.06)
    assert forces.mean(axis=0) == pytest.approx(np.zeros(3), abs=0.4)
    starts = np.array([push.start for one in drawn for push in one.pushes])
    assert 3.9 < starts.max() <= 4.0
    assert starts.mean() == pytest.approx(2.0, rel=0.06)
    usual = dataclasses.replace(WIDE, push_time=None).draw(np.random.default_rng([0, 1]), 40.0)
    found = [push.start / 10.0 for push in usual.pushes]
    assert found == pytest.approx([push.start for push in drawn[0].pushes])


def test_a_number_is_the_same_for_everything_in_every_episode() -> None:
    fixed = Perturbation(link_mass=0.05, joint_friction=0.5, object_mass=-0.2, friction=0.4)
    drawn = fixed.draw(np.random.default_rng(1))
    assert drawn.link_mass_factor == 1.05
    assert (drawn.dry_friction, drawn.wrist_friction) == (0.5, 0.6)
    assert (drawn.object_mass_factor, drawn.friction) == (0.8, 0.4)


def test_what_is_asked_for_does_not_change_what_else_is_drawn() -> None:
    """Paired: the world of a seed has the same friction with and without pushes."""
    full, less = (
        one.draw(np.random.default_rng(5))
        for one in (WIDE, dataclasses.replace(WIDE, object_mass=0.0, link_com=0.0, pushes=1))
    )
    assert full.friction == less.friction
    assert np.array_equal(full.link_mass_factor, less.link_mass_factor)
    assert less.object_mass_factor == 1.0
    assert less.pushes[0].force.tolist() == full.pushes[0].force.tolist()
    rngs = [np.random.default_rng(5), np.random.default_rng(5)]
    for rng, one in zip(rngs, (WIDE, Perturbation()), strict=True):
        one.draw(rng)
    assert rngs[0].integers(2**62) == rngs[1].integers(2**62)


def test_the_levels_are_as_told() -> None:
    """As docs/evaluation.md has them, in its units."""
    page = (ROOT / "docs" / "evaluation.md").read_text()
    assert perturbation_table() in page
    rows = [line.split("|")[1:-1] for line in perturbation_table().splitlines()[2:]]
    told = {row[0].split("`")[1].strip("-"): [cell.strip() for cell in row[2:]] for row in rows}
    assert told["link-mass"] == ["±0.05", "±0.1"]
    assert told["joint-friction"] == ["0.2 to 0.6", "0.4 to 1.2"]
    assert told["torque-delay"] == ["0.5 to 1", "1 to 2"]
    assert told["occlusion"] == ["0", "0"]
    assert len(rows) == len(options())
    moderate, severe = (PRESETS[name].draw(np.random.default_rng(1)) for name in LEVELS)
    for one in dataclasses.fields(Disturbance):
        is_told = one.name.endswith("_tolerance")
        if not is_told and one.name not in ("payload", "pushes", "velocity_cutoff"):
            milder, worse = (
                np.ravel(getattr(drawn, one.name)).astype(float) for drawn in (moderate, severe)
            )
            neutral = np.ravel(getattr(Disturbance(), one.name)).astype(float)[0]
            if one.name not in ("friction", "dry_friction", "state_delay", "torque_delay"):
                assert np.abs(worse - neutral).max() >= np.abs(milder - neutral).max(), one.name
    assert (moderate.mass_tolerance, severe.mass_tolerance) == (0.3, 0.6)


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
        ({"object_mass": -1.0}, "object_mass must be above -1 and finite: .*; found -1"),
        ({"friction": (-0.1, 0.3)}, "friction must be 0 or more and finite: .*; found"),
        ({"outliers": 1.5}, "outliers must be at least 0 and below 1; found 1.5"),
        ({"pose_bias": (0.0, 1.0)}, "pose_bias must be 0 or more and finite; found .0.0, 1.0"),
        ({"object_size": -0.95}, "object_size must be -0.9 or more and finite"),
        ({"camera_rate": 1e-320}, "camera_rate must be 0.001 or more and finite"),
        ({"camera_rate": 0.0}, "camera_rate must be 0.001 or more and finite; found 0"),
        ({"pushes": 4}, "pushes must be a whole number, at least 0 and at most 3; found 4"),
        ({"push_force": 1e308}, r"push_force must be at most 1e\+06 N; found 1e\+308"),
        ({"link_mass": (0.0, 1e7)}, r"link_mass must be at most 1e\+06; found \(0.0, 1"),
        ({"camera_latency": 1e9}, "camera_latency must be at most 10 s; found 1"),
    ],
)
def test_other_ranges_are_refused(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        Perturbation(**setting)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"mass": -1.5}, r"^--mass must be above -1 and finite: .*; found -1.5\.$"),
        ({"state_delay": "-2"}, r"^--state-delay must be 0 or more and finite: .*; found -2\.$"),
        ({"link_mass": "a:b"}, r"^--link-mass must be a number, or a range such as 0.1:0.2; f"),
        ({"link_mass": "0.1:0.2:0.3"}, r"^--link-mass must be .* two in rising order; found 0.1:"),
        ({"link_mass": "0.1:-0.1"}, r"^--link-mass must be .* in rising order; found 0.1:-0.1\.$"),
        ({"pose_noise": np.nan}, r"^--pose-noise must be 0 or more and finite; found nan\.$"),
        ({"pushes": 4}, r"^--pushes must be a whole number, at least 0 and at most 3; found 4\.$"),
        ({"torque_delay": "1e9"}, r"^--torque-delay must be at most 10 s; found 1e9\.$"),
    ],
)
def test_an_option_is_refused_by_its_own_name(chosen: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        _ = EvaluateOptions(perturbations=chosen).perturbation


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"pushes": 2}, r"^--push-force must be given, too, with --pushes 2; found 0.0\.$"),
        ({"push_force": 9.5}, r"^--pushes must be given, too, with --push-force 9.5; found 0\.$"),
    ],
)
def test_pushes_without_a_force_and_a_force_without_pushes_are_refused(
    chosen: dict[str, float], message: str
) -> None:
    with pytest.raises(InvalidValueError, match=message):
        PRESETS["moderate"].with_options(chosen)
    # A level that has both, or both options, say what the other one is.
    nothing = dict.fromkeys(chosen, 0)
    for level, allowed in (
        ("severe", chosen),
        ("severe", nothing),
        ("none", nothing),
        ("none", {"pushes": 0, "push_force": 0.0, **chosen}),
    ):
        preset = PRESETS[level]
        assert preset.with_options(allowed) == dataclasses.replace(preset, **allowed)


def test_an_option_that_is_not_there_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="No perturbation is called 'object_mass'; known: "):
        Perturbation().with_options({"object_mass": 0.1})


def test_a_rate_is_refused_by_its_own_name() -> None:
    with pytest.raises(
        InvalidValueError, match=r"^--rate must be at least 0.001 and at most 1000; "
    ):
        EvaluateOptions(policy=("mine.py:Mine",), rate=0.0)


@dataclass(frozen=True)
class Effect:
    """What a perturbation is tried with, and what it changes."""

    option: float | str
    """Value of its option."""
    changes: set[str]
    beside: Mapping[str, object] = field(default_factory=dict)
    """Fields without which it does nothing."""
    flags: tuple[str, ...] = ()
    """Options without which it is refused."""


PUSHED = {"pushes": 1, "push_force": 30.0, "push_time": 0.0}
EFFECTS = {
    "pose_noise": Effect(0.01, {"seen frame", "seen position", "seen goal"}),
    "heading_noise": Effect(0.1, {"seen frame", "seen heading", "seen goal"}),
    "pose_noise_time": Effect(0.3, {"seen position", "seen goal"}, {"pose_noise": 0.01}),
    "pose_bias": Effect(0.01, {"seen frame", "seen position", "seen goal"}),
    "rotation_bias": Effect(0.05, {"seen frame", "seen position", "seen heading", "seen goal"}),
    "camera_rate": Effect(3.0, {"seen frame", "seen position"}),
    "camera_latency": Effect(50.0, {"seen frame"}),
    "dropped_frames": Effect(0.5, {"seen frame"}),
    "outliers": Effect(0.5, {"seen position", "seen goal", "seen frame"}),
    "outlier_size": Effect(0.05, {"seen position", "seen goal"}, {"outliers": 0.5}),
    "occlusion": Effect(1, {"seen frame", "hidden"}),
    "object_mass": Effect("-0.5:0.5", {"mass"}),
    "object_com": Effect(0.01, {"mass", "seen position", "seen heading"}),
    "object_size": Effect(0.05, {"size", "seen position"}),
    "friction": Effect("0.3:0.9", {"friction"}),
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
    "pushes": Effect(1, {"motion"}, PUSHED, ("--push-force", "30")),
    "push_force": Effect(30.0, {"motion"}, PUSHED, ("--pushes", "1")),
    "push_time": Effect(0.05, {"motion", "measured force"}, PUSHED),
}
"""Every perturbation has an entry: whoever adds one says here what it changes."""
NO_ZERO = {
    "camera_rate",
    "push_time",
    "pose_noise_time",
    "wrist_friction",
    "velocity_cutoff",
    "outlier_size",
    "friction",
}
"""Those that say how, and not how much."""


def brick(spec: mujoco.MjSpec) -> None:
    add_table(spec)
    body = spec.worldbody.add_body(name="brick", pos=[0.5, 0.2, 0.02])
    body.add_freejoint()
    body.add_geom(name="brick", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02] * 3, mass=0.2)
    goal = spec.worldbody.add_body(name="goal", mocap=True, pos=[0.4, -0.2, 0.0])
    goal.add_geom(size=[0.01, 0.0, 0.0], contype=0, conaffinity=0)


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
        age = world.time - world.seen_time("brick")
        goal = world.seen_marker("goal").wxyz_xyz
        seen[-1] = np.concatenate([seen[-1], said.v - true.v, felt, goal, [age]])
    rows, m = np.round(seen, 6), world.model
    dofs, links = slice(0, 7), slice(1, 12)
    return {
        "seen position": rows[:, :3],
        "seen heading": rows[:, 3:4],
        "motion": rows[:, 4:11],
        "measured q": rows[:, 11:18],
        "measured v": rows[:, 18:25],
        "measured force": rows[:, 25:28],
        "seen goal": rows[:, 28:35],
        "seen frame": rows[:, 35:],
        "hidden": np.array([_hides_in_the_hand(world)]),
        "size": m.geom("brick").size.copy(),
        "links": np.c_[m.body_mass, m.body_inertia, m.body_ipos][links],
        "joints": np.c_[m.dof_frictionloss, m.dof_damping, m.dof_armature][dofs],
        "payload told": np.array(world.payload_factor),
        "mass": np.array([*m.body("brick").mass, *m.body("brick").ipos]),
        "friction": m.geom_friction.copy(),
    }


def _hides_in_the_hand(world: DisturbedSimulation) -> bool:
    """Whether a brick that the fingers close on is not seen any more."""
    placed = 0.0
    for k in range(700):
        if k == 450:
            world.place_object("brick", world.tool_pose())
            placed = world.time
        world.command_grip(Grip(width=0.045 if k < 450 else 0.0, force=30.0))
        world.step(world.motor_torque())
    return world.seen_time("brick") < placed + 0.034


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

    flags = [f"--{option.replace('_', '-')}", str(effect.option), *effect.flags]
    assert main(EvaluateOptions, run, "", args=flags) == 0
    numbers = [float(part) * about.scale for part in str(effect.option).split(":")]
    value: object = tuple(numbers) if len(numbers) > 1 else numbers[0]
    if isinstance(effect.option, int):
        value = effect.option
    beside = {"push_force": 30.0, "pushes": 1} if effect.flags else {}
    assert seen[0].perturbation == Perturbation(**{**beside, name: value})  # type: ignore[arg-type]
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
