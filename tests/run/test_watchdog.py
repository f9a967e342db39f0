"""The watchdog: what ends a run at once, and that nothing else does."""

from dataclasses import dataclass, replace
from functools import partial

import mujoco
import numpy as np
import pytest
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import Motion, Place, Waypoint, tool_down
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.runner import Runner
from robo47_qp.run.task import Program
from robo47_qp.run.watchdog import Watchdog
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from tests.examples import shifted
from tests.runs import ZEROS, Meddler, Reach, Witness, carry_out, no_objects


def failure_of(task: Reach, *meddlers: Meddler) -> Failure:
    run = carry_out(task, observers=list(meddlers))
    assert run.failure is not None
    assert run.failure.time is not None
    return run.failure


def test_an_arm_held_back_is_a_failure_to_track() -> None:
    def pull(simulation: Simulation) -> None:
        joint = simulation.model.joint(PANDA.joints[0])
        simulation.data.qfrc_applied[joint.dofadr[0]] = 80.0

    failure = failure_of(Reach(rise=0.2), Meddler("up", pull, after=0.2))
    assert failure.cause is Cause.TRACK
    assert "joint1 is 0.2" in failure.evidence
    assert "from its reference; allowed are 0.200" in failure.evidence
    assert failure.time is not None
    assert 0.2 < failure.time < 1.0


def test_an_arm_that_gives_way_need_not_follow() -> None:
    simulation, arm = Simulation(PANDA, no_objects), Arm(PANDA)
    away = JointReference(PANDA.home + 0.3, ZEROS, ZEROS)
    check = partial(Watchdog().check, simulation, arm, away, force_max=60.0)
    assert check(stiff=False) is None
    failure = check(stiff=True)
    assert failure is not None
    assert failure.cause is Cause.TRACK


@pytest.mark.parametrize(("force", "told"), [(59.9, False), (60.1, True)])
def test_the_tool_may_be_pushed_up_to_its_limit(force: float, told: bool) -> None:
    class Pushed(Simulation):
        def last_tool_force(self, tool: int = 0) -> Vector:
            return np.array([0.0, 0.6, 0.8]) * force

    simulation, arm = Pushed(PANDA, no_objects), Arm(PANDA)
    there = JointReference(PANDA.home, ZEROS, ZEROS)
    failure = Watchdog().check(simulation, arm, there, stiff=True, force_max=60.0)
    assert (failure is not None) is told
    assert failure is None or failure.cause is Cause.COLLISION


@pytest.mark.parametrize(
    ("signal", "size", "told"),
    [
        ("contact/tool", 59.9, None),
        ("contact/tool", 60.1, "on the tool is 60.1 N"),
        ("contact/links", 0.9, None),
        ("contact/links", 1.1, "before the tool is 1.1 N"),
    ],
)
def test_contact_in_any_period_since_the_last_check_counts(
    signal: str, size: float, told: str | None
) -> None:
    simulation, arm = Simulation(PANDA, no_objects), Arm(PANDA)

    def lately(name: str) -> np.ndarray:
        rows = np.zeros((20, 3 if name == "contact/tool" else 1))
        rows[7, -1] = size if name == signal else 0.0
        return rows

    simulation.lately = lately
    there = JointReference(PANDA.home, ZEROS, ZEROS)
    failure = Watchdog().check(simulation, arm, there, stiff=True, force_max=60.0)
    assert (failure is None) == (told is None)
    assert failure is None or (told or "") in failure.evidence


def test_a_joint_outside_its_limits_ends_the_run() -> None:
    def bend(simulation: Simulation) -> None:
        joint = simulation.model.joint("joint4")
        simulation.data.qpos[joint.qposadr[0]] = joint.range[1] + 0.01

    witness = Witness()
    run = carry_out(Reach(), observers=[Meddler("up", bend, after=0.2), witness])
    assert run.failure is not None
    assert run.failure.cause is Cause.LIMIT
    assert "joint4 is at -0.0" in run.failure.evidence
    assert "outside its limits" in run.failure.evidence
    assert [text.split(":")[0] for _, text, _ in witness.notes] == ["stopped", "failed (limit)"]
    # What was recorded up to then is there.
    assert len(run.rows) == pytest.approx(1e3 * (run.failure.time or 0.0))


@dataclass(frozen=True, kw_only=True)
class Past(Reach):
    """To the side, where a thin post may stand in the way of the forearm or of the hand."""

    where: tuple[float, float, float] | None = None
    name: str = "past"

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        super().build_scene(spec)
        if self.where is not None:
            # What a program may move is no part of the scene that motions are planned in.
            body = spec.worldbody.add_body(name="post", pos=self.where, mocap=True)
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.01, 0.1, 0.0])

    def preview(self, sensed: Sensed) -> list[Waypoint]:
        aside = shifted(sensed.tool_pose(), np.array([-0.1, 0.35, 0.0]))
        assert isinstance(aside, SE3)
        return [
            Waypoint(name="aside", target=aside),
            Waypoint(name="home", target=Place.HOME),
        ]


@dataclass(frozen=True, kw_only=True)
class Press(Reach):
    """Down onto the table, with the hand itself or with something under it."""

    held: bool = False
    depth: float = 0.0
    name: str = "press"

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        super().build_scene(spec)
        if self.held:
            body = spec.worldbody.add_body(name="block", pos=[0.45, 0.0, 0.03])
            body.add_freejoint()
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.05, 0.05, 0.03], mass=0.3)

    def program(self, sensed: Sensed) -> Program:
        at = [0.45, 0.0, 0.06 if self.held else 0.0]
        down = tool_down([*at[:2], at[2] + 0.009 - self.depth])
        yield Waypoint(name="above", target=tool_down([*at[:2], at[2] + 0.03]))
        yield Waypoint(name="down", target=down, motion=Motion.LIN)
        yield Waypoint(name="up", target=tool_down([*at[:2], 0.2]), motion=Motion.LIN)
        return None


@pytest.mark.parametrize(
    ("held", "depth", "limit"), [(False, 0.0, None), (False, 4e-3, 10.0), (True, 1e-3, None)]
)
def test_the_hand_itself_has_a_limit_of_its_own_on_the_table(
    held: bool, depth: float, limit: float | None
) -> None:
    run = carry_out(Press(held=held, depth=depth))
    pressed = run.rows["contact/fixed"][:, 0]
    if limit is None:
        assert run.failure is None
        assert pressed.max() == 0.0
        assert (np.linalg.norm(run.rows["contact/tool"], axis=1).max() > 10.0) == held
        return
    assert run.failure is not None
    assert run.failure.cause is Cause.COLLISION
    assert "the tool itself touched the table" in run.failure.evidence
    assert limit < pressed.max()
    assert f"{pressed.max():.1f} N" in run.failure.evidence
    (told,) = [f for f in audit(run) if f.signal == "tool contact with what is fixed"]
    assert (told.ok, told.limit) == (False, limit)
    assert told.extreme == pressed.max()


def test_a_free_way_is_no_collision() -> None:
    assert carry_out(Past()).failure is None


@pytest.mark.parametrize(
    ("where", "found"),
    [
        ((0.3, 0.2, 0.45), "the tool itself touched the table, or what else"),
        ((0.2, 0.1, 0.85), "the links before"),
    ],
)
def test_touching_is_a_collision(where: tuple[float, float, float], found: str) -> None:
    run = carry_out(Past(where=where, force_max=5.0))
    assert run.failure is not None
    assert run.failure.cause is Cause.COLLISION
    assert found in run.failure.evidence
    pressed = max(
        float(np.linalg.norm(run.rows["contact/tool"], axis=1).max()) / 5.0,
        float(run.rows["contact/links"].max()),
    )
    assert pressed > 1.0


def test_a_run_takes_no_longer_than_allowed() -> None:
    task = Reach(rise=0.1)
    scenario = replace(ClassicalStack().scenario(PANDA, task), watchdog=Watchdog(time_limit=0.3))
    run = Runner(scenario, Simulation(PANDA, task.build_scene)).run()
    assert run.failure is not None
    assert run.failure.cause is Cause.TIMEOUT
    assert run.failure.evidence == "the run has taken 0.3 s; allowed are 0.3 s"
    assert len(run.rows) == pytest.approx(300, abs=21)


@pytest.mark.parametrize("name", ["joint_error_max", "links_force_max", "time_limit"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_bounds_without_sense_are_refused(name: str, value: float) -> None:
    with pytest.raises(InvalidValueError, match=f"{name} must be above 0"):
        replace(Watchdog(), **{name: value})
