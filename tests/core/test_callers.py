"""What Python hands to the compiled core: sizes, types, threads, arms of any number of joints."""

import subprocess
import sys
from collections.abc import Callable
from ctypes import CDLL, c_void_p
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import mujoco
import numpy as np
import pytest
from mink import SE3

from robo47_qp._core.library import using
from robo47_qp.arrays import Matrix
from robo47_qp.collision.closest_approach import ClosestApproach
from robo47_qp.control.active import ActiveController
from robo47_qp.control.computed_torque import ComputedTorque
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.many import solve_many
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.stream.joint_bounds import JointBounds
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.model.chain import Chain
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robot import MotionProfile, Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.collision_check import Collisions
from robo47_qp.motion.tool_motion import tool_motion, tool_rates
from robo47_qp.run.control_loop import ControlLoop
from robo47_qp.run.signals import Samples, reference_rows
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from tests.controlled import DT
from tests.runs import no_objects

WALL = Obstacle(
    name="wall",
    shape=Shape.BOX,
    size=(0.1, 1.0, 1.0),
    T_world_obstacle=SE3.from_translation(np.array([0.9, 0.0, 0.5])),
)


def chain(n: int, folder: Path) -> Robot:
    """An arm of n hinges, each about another axis than the one before."""
    axes, names = ("0 0 1", "0 1 0", "1 0 0"), tuple(f"j{i}" for i in range(n))
    bodies = "".join(
        f'<body pos="0 0 0.06"><joint name="{name}" axis="{axes[i % 3]}" range="-2 2" '
        'damping="0.1" armature="0.05"/><inertial mass="0.2" pos="0 0 0.03" '
        'diaginertia="1e-3 1e-3 1e-3"/>'
        for i, name in enumerate(names)
    )
    path = folder / f"chain{n}.xml"
    end = f'<site name="tool" pos="0 0 0.05"/>{"</body>" * n}'
    path.write_text(
        f'<mujoco><compiler autolimits="true" angle="radian"/><worldbody>{bodies}{end}'
        "</worldbody></mujoco>"
    )
    profile = MotionProfile.uniform(n, v=1.0, a=2.0, j=20.0)
    return Robot(
        name=path.stem,
        mjcf=path,
        joints=names,
        motors=names,
        has_motors=False,
        tcp="tool",
        home=np.full(n, 0.1),
        rated=profile,
        profile=profile,
        tau_max=np.full(n, 200.0),
        tau_rate_max=np.full(n, 5000.0),
        stiffness=np.full(n, 100.0),
    )


def test_rows_of_an_arm_with_more_joints_than_the_core_controls(tmp_path: Path) -> None:
    arm = Arm(chain(65, tmp_path))
    q, v, a = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 3, 65))
    assert arm.n == 65
    told = []
    for name in ("compiled", "numpy"):
        with using(name):
            told.append(reference_rows(arm, (q, v, a)))
    assert told[0].tolist() == told[1].tolist()


def test_a_robot_without_joints_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="joints must be one name or more"):
        chain(0, tmp_path)


def of_wall() -> ClosestApproach:
    return ClosestApproach(PANDA, (WALL,))


def rows(*counts: int) -> list[Matrix]:
    return [np.zeros((count, 7)) for count in counts]


def samples(*counts: int) -> Samples:
    q, v, a = rows(*counts)
    return q, v, a


SHAPES: dict[str, Callable[[Arm], object]] = {
    r"q must be of shape \(any, 9\); found shape \(3, 7\)": lambda _: of_wall().along(*rows(3)),
    r"q must be one row or more": lambda _: of_wall().along(np.zeros((0, 9))),
    r"q must be of shape \(7\); found shape \(3,\)": lambda _: Collisions(PANDA, no_objects).at(
        np.zeros(3)
    ),
    r"q must be of shape \(any, 7\); found shape \(4, 3\)": lambda arm: tool_rates(
        arm, np.zeros((4, 3)), DT
    ),
    r"a motion must be of shape \(3, 7\); found shape \(2, 7\)": lambda arm: tool_motion(
        arm, *samples(3, 3, 2), np.zeros((3, 7))
    ),
    r"a sample must be of shape \(3, 7\); found shape \(1, 7\)": lambda arm: reference_rows(
        arm, samples(3, 1, 3)
    ),
    r"q must be of shape \(7\); found shape \(8,\)": lambda arm: Chain(arm).move(np.zeros(8)),
    r"joints must be 7; found 1 of q, 1 of v": lambda arm: JointBounds(
        arm.q_min, arm.q_max, PANDA.profile, DT, 0.01
    ).box(np.zeros(1), np.zeros(1)),
}


@pytest.mark.parametrize("words", SHAPES)
@pytest.mark.parametrize("name", ["compiled", "numpy"])
def test_arrays_of_another_size_are_refused(words: str, name: str) -> None:
    """The core would read beyond their end."""
    with using(name), pytest.raises(InvalidValueError, match=words):
        SHAPES[words](Arm(PANDA))


def test_more_ticks_to_stop_than_c_counts_are_as_many_as_in_numpy() -> None:
    profile, far = MotionProfile.uniform(7, v=1.0, a=1e-16, j=1.0), np.full(7, 1e5)
    q, v, boxes = np.linspace(0.0, 9e4, 7), np.full(7, 1e-6), []
    for name in ("compiled", "numpy"):
        with using(name):
            bounds = JointBounds(-far, far, profile, 1e-9, 1e-3)
            boxes.append(bounds.box(q, v))
            # Else Python has to bring a joint back.
            assert name == "numpy" or bounds._compiled_box(q, v) is not None
    assert not boxes[0].recovering
    np.testing.assert_allclose(boxes[0].high, boxes[1].high, rtol=1e-12)
    np.testing.assert_allclose(boxes[0].low, boxes[1].low, rtol=1e-12)


def test_a_file_that_inverts_discretely_has_the_same_torques(tmp_path: Path) -> None:
    """Accelerations of a motion are those of the joints, in both backends."""
    plain = chain(6, tmp_path)
    text = plain.mjcf.read_text().replace(
        "<worldbody>", '<option><flag invdiscrete="enable"/></option><worldbody>', 1
    )
    (tmp_path / "discrete.xml").write_text(text)
    discrete = replace(plain, mjcf=tmp_path / "discrete.xml")
    q, v, a = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 6))
    expected = Arm(plain).inverse_dynamics(q, v, a)
    assert Arm(discrete).inverse_dynamics(q, v, a).tolist() == expected.tolist()


def test_other_types_of_numbers_are_taken() -> None:
    q: Any = np.zeros((2, 9), dtype=np.int64)
    assert of_wall().along(q) == of_wall().along(q.astype(float))
    arm = Arm(PANDA)
    T = arm.pose(arm.home + 0.1)
    rough = SE3(T.wxyz_xyz.astype(np.float32))
    assert solve_many(MultiStart(solver=LmIk()), arm, [rough])[0].converged
    assert LmIk(max_iterations=2**40).solve(arm, T, arm.home).converged
    assert MultiStart(solver=LmIk(), max_restarts=2**40).solve(arm, T, arm.home).converged


FIRST_USE = """
import itertools, threading, time
from robo47_qp._core import library
from robo47_qp.ik.lm import LmIk
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA

found_one, turns = library.built, itertools.count(1)

def built_slowly():
    time.sleep(0.1 * next(turns))
    return found_one()

library.built = built_slowly
arms = [Arm(PANDA) for _ in range(8)]
T, gate, found = arms[0].pose(arms[0].home + 0.1), threading.Barrier(8), []

def solve(arm):
    gate.wait()
    found.append(LmIk().solve(arm, T, arm.home).converged)

threads = [threading.Thread(target=solve, args=(arm,)) for arm in arms]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
found += [LmIk().solve(arm, T, arm.home).converged for arm in arms]
print(found)
"""


def test_threads_that_come_first_share_one_core() -> None:
    done = subprocess.run(
        [sys.executable, "-c", FIRST_USE], capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    assert done.stdout.strip() == str([True] * 16)


def test_after_runs_on_two_threads_mujoco_has_its_clock() -> None:
    library = CDLL(str(next(Path(mujoco.__file__).parent.glob("libmujoco*.so*"))))
    clock = c_void_p.in_dll(library, "mjcb_time")
    before = clock.value
    loops = [
        ControlLoop(Arm(PANDA), ComputedTorque(), Simulation(PANDA, no_objects)) for _ in range(2)
    ]

    def hold(loop: ControlLoop) -> None:
        for _ in range(20):
            loop.hold(0.1)

    threads = [Thread(target=hold, args=(loop,)) for loop in loops]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert clock.value == before


def test_an_acceleration_after_rows_is_that_of_the_last_row() -> None:
    rng, told = np.random.default_rng(0), []
    q, v, a = PANDA.home + rng.uniform(-0.5, 0.5, (3, 3, 7))
    for name in ("compiled", "numpy"):
        with using(name):
            arm = Arm(PANDA)
            arm.inverse_dynamics(arm.home, v[0], a[0])
            reference_rows(arm, (q, v, a))
            told.append(arm.acceleration(arm.scratch.qfrc_inverse + 1.0).copy())
    np.testing.assert_allclose(told[0], told[1], rtol=1e-12)


def test_what_differs_from_the_simulations_of_the_package_is_python() -> None:
    class Watched(DisturbedSimulation):
        steps = 0

        def step(self, *given: object, **named: object) -> None:
            self.steps += 1
            super().step(*given, **named)  # type: ignore[arg-type]

    world = Watched(PANDA, no_objects, Disturbance())
    ControlLoop(Arm(PANDA), ComputedTorque(), world).hold(0.05)
    assert world.steps == 50
    assert DisturbedSimulation(PANDA, no_objects, Disturbance()).compiled is not None


@pytest.mark.parametrize("name", ["compiled", "numpy"])
def test_after_a_state_that_is_no_number_no_torque_is_free_of_its_rate(name: str) -> None:
    with using(name):
        arm = Arm(PANDA)
        active, still = ActiveController(ComputedTorque(), arm, dt=DT), np.zeros(7)
        reference = JointReference(arm.home, still, still)
        for q in (arm.home, arm.home + np.array([0, np.nan, 0, 0, 0, 0, 0])):
            active.torque(reference, JointState(q, still))
        after = active.torque(reference, JointState(arm.home + 0.2, still))
    assert np.isnan(after).all()
