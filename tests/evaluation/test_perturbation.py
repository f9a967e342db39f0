"""Perturbations: ranges, and what is drawn from them."""

import dataclasses

import numpy as np
import pytest

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.evaluation.perturbation import PRESETS, Perturbation

WIDE = Perturbation(object_mass=0.3, friction=0.5, pushes=3, push_force=10.0, push_time=4.0)


def test_nothing_is_wrong_by_default() -> None:
    drawn = Perturbation().draw(np.random.default_rng(1))
    assert (drawn.object_mass_factor, drawn.friction_factor) == (1.0, 1.0)
    assert (drawn.delay, tuple(drawn.pushes), drawn.noisy) == (0, (), False)
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
    assert (drawn.pose_noise, drawn.heading_noise, drawn.delay) == (5e-3, 0.0, 2)
    assert PRESETS["moderate"].object_mass == PRESETS["moderate"].friction == 0.3
    for name, value in vars(PRESETS["severe"]).items():
        assert value >= getattr(PRESETS["moderate"], name)


def test_single_options_stand_in_place_of_those_of_the_level() -> None:
    options = EvaluateOptions(perturb="moderate", latency=1.0, mass=0.1, pose_noise=0.0, pushes=1)
    assert options.perturbation == dataclasses.replace(
        PRESETS["moderate"], latency=1e-3, object_mass=0.1, pose_noise=0.0, pushes=1
    )
    assert EvaluateOptions(perturb="severe").perturbation == PRESETS["severe"]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"pose_noise": -1.0}, "pose_noise must be finite and not negative"),
        ({"latency": np.nan}, "latency must be finite and not negative"),
        ({"object_mass": 1.0}, "object_mass must be below 1"),
        ({"friction": 1.5}, "friction must be below 1"),
        ({"camera_rate": 0.0}, "camera_rate must be above 0"),
        ({"pushes": 4}, "pushes must be 3 at most"),
    ],
)
def test_other_ranges_are_refused(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        Perturbation(**setting)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"mass": 1.5}, r"^--mass must be below 1; found 1.5\.$"),
        ({"latency": -2.0}, r"^--latency must be finite and not negative; found -2.0\.$"),
        ({"pose_noise": np.nan}, r"^--pose-noise must be finite and not negative; found nan\.$"),
        ({"pushes": 4}, r"^--pushes must be 3 at most; found 4\.$"),
    ],
)
def test_an_option_is_refused_by_its_own_name(chosen: dict[str, float], message: str) -> None:
    options = EvaluateOptions(**chosen)  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match=message):
        _ = options.perturbation


def test_a_rate_is_refused_by_its_own_name() -> None:
    with pytest.raises(InvalidValueError, match=r"^--rate must be above 0 and at most 1000; found"):
        EvaluateOptions(policy=("mine.py:Mine",), rate=0.0)
