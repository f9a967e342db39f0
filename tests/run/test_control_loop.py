"""The control loop: what the controller is told of payloads."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.control.joint_impedance import JointImpedance
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.control.pressing import Presser
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.run.compliance import Compliance, CompliantMode
from robo47_qp.run.control_loop import SETTLING, ControlLoop
from robo47_qp.run.failure import Cause, Condition, StepFailed
from robo47_qp.run.steps import Wait
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from tests.controlled import LOAD
from tests.runs import no_objects


@pytest.mark.parametrize("factor", [1.0, 1.25])
def test_the_controller_believes_the_payload_that_it_is_told(factor: float) -> None:
    world = DisturbedSimulation(PANDA, no_objects, Disturbance(payload_factor=factor))
    loop = ControlLoop(Arm(PANDA), JointImpedance(), world)
    loop.set_payload(LOAD)
    believed = loop.control.arm.payload
    assert believed is not None
    assert believed.mass == pytest.approx(factor * LOAD.mass, rel=1e-12)
    np.testing.assert_allclose(believed.inertia, factor * np.array(LOAD.inertia), rtol=1e-12)
    assert believed.T_tcp_com == LOAD.T_tcp_com
    before = loop.control.arm
    loop.set_payload(LOAD)
    assert loop.control.arm is before, "the torque would run to the same load again"
    loop.let_go(0)
    assert loop.control.arm.payload is None
    loop.set_payload(LOAD)
    again = loop.control.arm.payload
    assert again is not None
    assert again.mass == believed.mass


class Hanging(Simulation):
    """A sensor that feels a hanging payload, which touches nothing."""

    def felt_force(self, tool: int = 0) -> Vector:
        return np.array(LOAD.mass * self.model.opt.gravity)


def test_the_weight_of_a_known_payload_presses_on_nothing() -> None:
    loop = ControlLoop(Arm(PANDA), JointImpedance(), Hanging(PANDA, no_objects))
    loop.set_payload(LOAD)
    down = np.array([0.0, 0.0, -1.0])
    CompliantMode(loop).soften(Compliance(axis=down, force=5.0))
    loop.begin("press")
    loop.hold(0.002)
    presser = loop.control.controller
    assert isinstance(presser, Presser)
    assert presser.pressed == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("share", "follows"), [(0.45, True), (0.55, False)])
def test_in_contact_is_what_feels_more_than_half_its_payload_and_four_newtons(
    share: float, follows: bool
) -> None:
    class Pulled(Simulation):
        def felt_force(self, tool: int = 0) -> Vector:
            weight = np.array(LOAD.mass * self.model.opt.gravity)
            pulled = share * weight + 4.0 * weight / np.linalg.norm(weight)
            return weight + (pulled if self.time > 0.03 else 0.0)

    observer = DisturbanceObserver()
    loop = ControlLoop(Arm(PANDA), JointImpedance(), Pulled(PANDA, no_objects), observer=observer)
    loop.set_payload(LOAD)
    loop.begin("hold")
    loop.hold(0.06)
    assert loop.control.observed is not None
    assert loop.control.observed.compensating is follows


@pytest.mark.parametrize(
    ("reads", "follows"),
    [
        (lambda time: 9.0 + 0.0 * time, True),
        (lambda time: 9.0 + time, True),
        (lambda time: 9.0 + 4.5 * (time > 5.9), False),
        (lambda time: 9.0 + 2.0 * max(0.0, time - 2.0), False),
    ],
    ids=["off from the start", "drifts", "leaps", "pushed ever harder"],
)
def test_a_free_wrist_that_drifts_touches_nothing(
    reads: Callable[[float], float], follows: bool
) -> None:
    class Drifting(Simulation):
        def felt_force(self, tool: int = 0) -> Vector:
            return np.array([0.0, 0.0, reads(self.time)])

    observer = DisturbanceObserver()
    loop = ControlLoop(Arm(PANDA), JointImpedance(), Drifting(PANDA, no_objects), observer=observer)
    loop.begin("hold")
    loop.hold(6.0)
    assert loop.control.observed is not None
    assert loop.control.observed.compensating is follows


class Felt(Simulation):
    """A wrist that feels a force of the test."""

    force = 0.0

    def felt_force(self, tool: int = 0) -> Vector:
        return np.array([0.0, 0.0, self.force])


def test_what_a_tool_presses_with_for_long_is_no_drift() -> None:
    world, observer = Felt(PANDA, no_objects), DisturbanceObserver()
    loop = ControlLoop(Arm(PANDA), JointImpedance(), world, observer=observer)
    loop.begin("all")
    for force, seconds in ((0.0, 0.1), (3.5, 9.0), (-2.0, 0.1)):
        world.force = force
        loop.compensate(on=True, in_contact=force > 0.0)
        loop.hold(seconds)
    assert loop.control.observed is not None
    assert loop.control.observed.compensating


@pytest.mark.parametrize("told", [True, False])
def test_what_a_wrist_reads_where_nothing_is_known_to_be_touched_is_its_zero(told: bool) -> None:
    world, observer = Felt(PANDA, no_objects), DisturbanceObserver()
    loop = ControlLoop(Arm(PANDA), JointImpedance(), world, observer=observer)
    loop.begin("all")
    loop.hold(0.1)
    # It drifted while the tool pressed.
    world.force, loop.untouched = 6.0, told
    loop.hold(0.2)
    loop.untouched = False
    loop.hold(0.1)
    observed = loop.control.observed
    assert observed is not None
    assert observed.compensating is told
    world.force = 0.0
    loop.hold(0.1)
    assert observed.compensating is not told


@pytest.mark.parametrize("way", ["touching", "pressing", "yielding"])
def test_friction_is_learned_only_when_contact_has_been_over_for_a_while(way: str) -> None:
    world = Felt(PANDA, no_objects)
    loop = ControlLoop(Arm(PANDA), JointImpedance(), world, observer=DisturbanceObserver())
    observed = loop.control.observed
    assert observed is not None

    def learns(seconds: float) -> bool:
        loop.hold(seconds)
        return observed.compensating and observed._learns

    loop.begin("free")
    assert learns(0.02)
    world.force = 50.0 if way == "touching" else 1.0
    if way != "touching":
        loop.compensate(on=way == "pressing", in_contact=way == "pressing")
    assert not learns(0.1)
    assert observed._free is (way != "pressing")
    world.force = 0.0
    loop.compensate(on=True)
    assert not learns(SETTLING - 0.05)
    assert learns(0.1)


def test_a_compliant_arm_that_becomes_stiff_turns_no_friction() -> None:
    world = DisturbedSimulation(PANDA, no_objects, Disturbance(dry_friction=0.5))
    observer = DisturbanceObserver(noise_q=0.0)
    loop = ControlLoop(Arm(PANDA), JointImpedance(), world, observer=observer)
    loop.begin("all")
    mode = CompliantMode(loop)
    mode.soften(Compliance(stiffness=np.ones(6)))
    way = plan_ptp(PANDA.home, PANDA.home + 0.1, PANDA.profile, TIMESTEP)
    loop.track(way)
    loop.hold(0.3)
    assert np.abs(loop.reference.q - loop.state().q).min() > 0.1e-3, "joints follow"
    observed = loop.control.observed
    assert observed is not None
    assert observed._friction is not None
    turned = observed._friction._z.copy()
    assert np.abs(turned).min() > 0.1
    mode.stiffen()
    loop.hold(0.03)
    np.testing.assert_array_equal(observed._friction._z, turned)


def test_only_joints_that_move_are_brought_to_rest_when_an_arm_becomes_stiff() -> None:
    wrong = Disturbance(noise_q=5e-5)
    world = DisturbedSimulation(PANDA, no_objects, wrong, np.random.default_rng(3))
    loop = ControlLoop(Arm(PANDA), JointImpedance(), world, observer=DisturbanceObserver())
    loop.begin("all")
    mode = CompliantMode(loop)
    mode.soften(Compliance(stiffness=np.ones(6)))
    loop.hold(0.1)
    world.data.qvel[0] = 0.1
    loop.hold(0.02)
    mode.stiffen()
    assert loop.phases[-1].name == "stop"
    moved = np.ptp(loop.recording.rows()["joints/q_ref"][loop.phases[-1].start :], axis=0)
    assert moved[0] > 0.0
    assert (moved == 0.0).sum() >= 2


def test_what_one_hand_lets_go_the_other_keeps() -> None:
    pair = panda_pair()
    loop = ControlLoop(Arm(pair), JointImpedance(), Simulation(pair, no_objects))
    loop.set_payload({"left": LOAD, "right": LOAD})
    loop.let_go(1)
    assert [*loop.control.arm.payloads] == ["left"]


@pytest.mark.parametrize("untouched", [True, False])
def test_only_as_long_as_it_waits_nothing_is_known_to_be_touched(untouched: bool) -> None:
    class Loop:
        untouched = False
        begin = staticmethod(lambda *_, **__: None)
        held: ClassVar[list[bool]] = []

        def hold(self, _: float) -> None:
            self.held.append(self.untouched)

    executor: Any = SimpleNamespace(loop=Loop())
    Wait(seconds=0.05, untouched=untouched).carry_out(executor)
    never = Condition(name="never", cause=Cause.TIMEOUT, against=lambda: "not yet")
    with pytest.raises(StepFailed):
        Wait(seconds=0.05, until=never, untouched=untouched).carry_out(executor)
    assert set(Loop.held) == {untouched}
    assert not executor.loop.untouched
