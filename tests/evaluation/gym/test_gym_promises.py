"""What an environment promises as an evaluation does: its audit, its time, what is measured."""

from dataclasses import dataclass

import pytest

from robo47_qp.evaluation.perturbation import Perturbation
from robo47_qp.tasks.pick_place.pick_place import PickPlace

pytest.importorskip("gymnasium", reason="the extra gym is not installed")

from robo47_qp.evaluation.gym.env import TaskEnv
from tests.evaluation.gym.environments import HOME, TURNED, Turn, env, until_the_end


def test_an_object_that_is_moved_by_hand_breaks_the_audit() -> None:
    made = env(task=PickPlace(), seconds=0.5)
    made.reset(seed=0)
    made.step(made.scale.numbers(HOME))
    world = made._simulation
    world.place_object("cube", world.marker_pose("goal"))
    _, _, _, _, info = until_the_end(made, made.scale.numbers(HOME))
    assert not info["audit_ok"]
    assert any(signal.startswith("object jump") for signal in info["broken_promises"])


def test_an_object_that_is_moved_before_the_first_step_breaks_it_too() -> None:
    made = env(task=PickPlace(), seconds=0.5)
    made.reset(seed=0)
    made._simulation.place_object("cube", made._simulation.marker_pose("goal"))
    _, _, _, _, info = until_the_end(made, made.scale.numbers(HOME))
    assert "object jump (cube)" in info["broken_promises"]


def test_velocities_that_are_not_measured_are_not_there() -> None:
    made = env(perturbation=Perturbation(velocity_cutoff=0.0))
    seen, _ = made.reset(seed=0)
    assert "v" not in seen
    assert made.observation_space.contains(seen)


def test_the_limit_of_the_task_itself_is_for_acting_not_for_coming_to_rest() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Brief(Turn):
        @property
        def time_limit(self) -> float:
            return 0.8

    made = TaskEnv(Brief())
    made.reset(seed=0)
    steps, reward, _, truncated, info = until_the_end(made, made.scale.numbers(TURNED))
    assert (steps, reward, truncated, info["cause"]) == (24, 1.0, True, None)
