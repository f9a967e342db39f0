"""Objects that something else than physics has moved break the audit."""

from collections.abc import Callable

import numpy as np
import pytest
from mink import SE3, SO3
from scipy.spatial.transform import Rotation

from robo47_qp.constants import TIMESTEP
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.audit.objects import object_jumps
from robo47_qp.run.policy.drivers import PolicyTiming
from robo47_qp.run.policy.policy import JointTarget, Observation
from robo47_qp.run.scenario import Run
from robo47_qp.run.task import Task
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.item import Item
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from robo47_qp.tasks.stack.stack import Stack
from tests.policies import Scripted, follow
from tests.runs import picked_and_placed


class Tossed(PickPlace):
    """A cylinder with its centre of mass off its middle is thrown onto the table."""

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """See `Task.reset`."""
        super().reset(simulation, rng)
        joint = simulation.data.joint(simulation.model.body(self.item.name).jntadr[0])
        joint.qvel[:] = [0.5, 0.2, 1.0, 15.0, -9.0, 12.0]


def meddled(
    meddle: Callable[[Simulation], None] | None,
    task: Task | None = None,
    *,
    rate: float = 20.0,
    until: float = 0.11,
) -> Run:
    """A policy in the process of the run, which reaches the world from 0.1 s on."""
    task = PickPlace() if task is None else task
    simulation = Simulation(PANDA, task.build_scene)

    def act(seen: Observation) -> JointTarget:
        if meddle is not None and 0.0999 < seen.time < until:
            meddle(simulation)
        return JointTarget(q=np.array(PANDA.home))

    timing = PolicyTiming(rate=rate, seconds=0.3)
    return follow(Scripted(act), task=task, timing=timing, simulation=simulation)


def broken(run: Run) -> dict[str, float]:
    return {f.signal: f.extreme for f in object_jumps(run) if not f.ok}


def shift(by: float) -> Callable[[Simulation], None]:
    def move(simulation: Simulation) -> None:
        aside = SE3.from_translation(np.array([by, 0.0, 0.0]))
        simulation.place_object("cube", aside @ simulation.object_pose("cube"))

    return move


def turn(simulation: Simulation) -> None:
    about = SE3.from_rotation(SO3.from_z_radians(0.01))
    simulation.place_object("cube", simulation.object_pose("cube") @ about)


def kick(simulation: Simulation) -> None:
    simulation.data.joint(simulation.model.body("cube").jntadr[0]).qvel[0] += 0.01


def drift(simulation: Simulation) -> None:
    """Moves it along the table by 1 µm/s."""
    simulation.data.joint(simulation.model.body("cube").jntadr[0]).qpos[0] += 1e-9


def spin(*speed: float) -> Callable[[Simulation], None]:
    """Turns it at a speed in the world [rad/s], with the pose that this speed leads to."""

    def act(simulation: Simulation) -> None:
        joint = simulation.data.joint(simulation.model.body("cube").jntadr[0])
        R, before = SO3(joint.qpos[3:]), joint.qvel[3:].copy()
        turning = R.inverse().apply(np.array(speed))
        turned = SO3.exp(-TIMESTEP * before) @ SO3.exp(TIMESTEP * turning)
        joint.qpos[3:], joint.qvel[3:] = (R @ turned).wxyz, turning

    return act


def tilt(run: Run) -> float:
    """How far the cube's upright axis has turned from where it was, at most [rad]."""
    wxyz = run.rows["objects/cube"][:, 3:]
    upright = Rotation.from_quat(wxyz, scalar_first=True).apply([0, 0, 1])
    return float(np.arccos(np.clip(upright @ upright[0], -1.0, 1.0)).max())


def test_what_grippers_tables_and_gravity_do_is_no_jump() -> None:
    found = object_jumps(picked_and_placed())
    assert [finding.signal for finding in found] == [
        "object jump (cube)",
        "object turn (cube)",
        "object kick (cube)",
        "object spin (cube)",
    ]
    assert all(finding.ok for finding in found)
    # The solver of contacts leaves a residual, the integrator rounds only.
    for finding, bound in zip(found, (1e-15, 1e-14, 2e-5, 2e-4), strict=True):
        assert finding.extreme < bound
    assert broken(meddled(None)) == {}


@pytest.mark.parametrize("by", [1e-4, 0.4])
def test_an_object_that_jumps_breaks_the_audit(by: float) -> None:
    run = meddled(shift(by))
    assert broken(run)["object jump (cube)"] == pytest.approx(by, rel=1e-2)
    assert any(f.signal == "object jump (cube)" and not f.ok for f in audit(run))


def test_so_does_one_that_turns_or_is_kicked() -> None:
    assert broken(meddled(turn))["object turn (cube)"] == pytest.approx(0.01, rel=1e-3)
    kicked = broken(meddled(kick))
    assert kicked["object kick (cube)"] == pytest.approx(0.01, rel=1e-6)


def test_one_that_tumbles_about_a_centre_of_mass_off_its_middle_was_not_kicked() -> None:
    item = Item(name="cube", size=(0.05, 0.05, 0.06), round=True, com=(0.012, -0.009, 0.006))
    task = Tossed(item=item)
    *_, kicked, spun = object_jumps(meddled(None, task))
    # Bound on what the solver leaves of the landing; without its gyroscopic torque, the spin is
    # 1e-2 rad/s.
    assert kicked.extreme < 1e-6
    assert spun.extreme < 2e-5
    assert broken(meddled(kick, task))["object kick (cube)"] == pytest.approx(0.01, rel=1e-3)


def test_one_that_is_moved_a_little_in_every_period_has_drifted() -> None:
    run = meddled(drift, rate=1000.0, until=1.0)
    assert list(broken(run)) == ["object jump (cube)"]


@pytest.mark.parametrize("speed", [(0.0, 0.0, 6.0), (0.0, 12.0, 0.0)])
def test_one_that_is_turned_with_a_speed_to_match_was_spun(speed: tuple[float, ...]) -> None:
    run = meddled(spin(*speed), rate=1000.0, until=0.25)
    assert tilt(run) > 0.5 or not speed[1], "the cube tumbles"
    assert broken(run)["object spin (cube)"] == pytest.approx(np.linalg.norm(speed), rel=1e-3)


def test_one_that_creeps_around_was_spun_too() -> None:
    run = meddled(spin(0.0, 0.0, 0.01), rate=1000.0, until=0.25)
    assert broken(run) == {"object spin (cube)": pytest.approx(0.01, rel=0.1)}


BEFORE = {
    "object jump (cube)": (shift(0.01), 0.01),
    "object turn (cube)": (turn, 0.01),
    "object kick (cube)": (kick, 0.01),
    "object spin (cube)": (spin(0.0, 0.0, 0.5), 0.5),
}


@pytest.mark.parametrize("signal", BEFORE)
def test_so_does_one_that_is_moved_before_the_first_period(signal: str) -> None:
    """The task has put it there, and the policy's `reset` is the next to be called."""
    task, (meddle, size) = PickPlace(), BEFORE[signal]
    simulation = Simulation(PANDA, task.build_scene)

    class Early(Scripted):
        def reset(self, observation: Observation) -> None:
            meddle(simulation)
            super().reset(observation)

    policy = Early(lambda _: JointTarget(q=np.array(PANDA.home)))
    run = follow(policy, task=task, timing=PolicyTiming(seconds=0.1), simulation=simulation)
    assert broken(run)[signal] == pytest.approx(size, rel=1e-3)
    found = next(f for f in object_jumps(run) if f.signal == signal)
    assert found.time == 0.0


@pytest.mark.parametrize("kind", ["objects/{}", "motion/{} velocity", "motion/{} acceleration"])
@pytest.mark.parametrize("which", [0, -1])
def test_what_is_no_number_is_no_kept_promise(kind: str, which: int) -> None:
    """The largest of several objects must not hide the one that is not known."""
    task = Stack()
    simulation = Simulation(PANDA, task.build_scene)
    home = Scripted(lambda _: JointTarget(q=np.array(PANDA.home)))
    run = follow(home, task=task, timing=PolicyTiming(seconds=0.1), simulation=simulation)
    name = list(run.objects)[which]
    assert broken(run) == {}
    run.rows[kind.format(name)][50:60, 3:] = np.nan
    assert list(broken(run)) == [f"object jump ({name})"]
