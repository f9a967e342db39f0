"""A short program on a driven arm, and faults that are planted in it."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.model.robots import load_robot
from robo47_qp.motion.waypoint import Motion, Place, Waypoint
from robo47_qp.run.failure import Failure
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.steps import Grasp, Release
from robo47_qp.run.task import Program, Task
from robo47_qp.sim.franka.driven_arm import DrivenArm
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack

FR3 = load_robot("fr3")


@dataclass(frozen=True, kw_only=True)
class Nudge(Task):
    """Move the tool down and home; close the fingers on nothing."""

    grips: bool = False
    name: str = "nudge"

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        pass

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        pass

    def program(self, sensed: Sensed) -> Program:
        pose = sensed.tool_pose()
        down = pose.translation() - [0.0, 0.0, 0.004]
        yield Waypoint(
            name="down",
            target=type(pose).from_rotation_and_translation(pose.rotation(), down),
            motion=Motion.LIN,
        )
        if self.grips:
            yield Grasp(force=20.0)
            yield Release()
        yield Waypoint(name="home", target=Place.HOME)
        return None

    def verdict(self, simulation: Simulation) -> Failure | None:
        return None


def run(
    host: str, plant: Callable[[DrivenArm], None] = lambda _: None, *, grips: bool = False
) -> Run:
    """Run the program on the arm, with a fault planted."""
    task = Nudge(grips=grips)
    arm = DrivenArm(FR3, task.build_scene, host)
    try:
        runner = Runner(ClassicalStack().scenario(FR3, task), arm)
        plant(arm)
        result = runner.run()
    finally:
        arm.close()
    assert not arm.link.active
    rows = result.rows
    np.testing.assert_allclose(np.diff(rows["time"][:, 0]), 1e-3, atol=1e-12)
    assert np.isfinite(rows.values).all()
    return result


def adds(tau: Callable[[int], Vector], *, blind: bool = False) -> Callable[[DrivenArm], None]:
    """Torques that are added after every limit of ours, from the 100th period on.

    Where `blind`, ours are then those of that period.
    """

    def plant(arm: DrivenArm) -> None:
        exchange, count, first = arm.link.exchange, 0, np.zeros(7)

        def wrong(ours: Vector) -> None:
            nonlocal count, first
            count += 1
            if count == 100:
                first = ours.copy()
            base = first if blind and count >= 100 else ours
            exchange(base + tau(count - 100) if count >= 100 else base)

        arm.link.exchange = wrong  # type: ignore[assignment, method-assign]

    return plant


def one(joint: int, size: float) -> Vector:
    return np.where(np.arange(7) == joint, size, 0.0)
