"""Peg into hole: it is found, the peg goes in, what goes wrong is noticed."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.perturbation import Perturbation
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.contact_steps import Comply, Press
from robo47_qp.run.failure import Cause, Failure, StepFailed
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.steps import Release, Wait
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.wrist import FreeWrist
from robo47_qp.tasks.peg_insert.feeling_inserter import FeelingInserter
from robo47_qp.tasks.peg_insert.peg import (
    ANGLE_ERROR,
    CLEARANCE,
    DEPTH,
    DIAMETER,
    LENGTH,
    POSITION_ERROR,
)
from robo47_qp.tasks.peg_insert.peg_insert import PegInsert
from robo47_qp.tasks.peg_insert.sinking import Sinking
from tests.examples import shifted
from tests.robots import GRIPPER
from tests.runs import Meddler, at_rest, carry_out, live


@cache
def inserted(seed: int) -> Run:
    return carry_out(PegInsert(), seed=seed)


def names(run: Run) -> list[str]:
    return [phase.name for phase in run.phases]


# Searched for, and straight in.
@pytest.mark.parametrize("seed", [0, 551])
def test_the_peg_goes_in_within_all_limits(seed: int) -> None:
    run = inserted(seed)
    assert run.failure is None
    assert run.measures["depth_m"] == pytest.approx(DEPTH, abs=2e-4)
    assert run.measures["aside_m"] <= 0.5 * CLEARANCE + 5e-5
    assert [finding.signal for finding in audit(run) if not finding.ok] == []


def test_the_hole_is_not_where_it_is_thought_to_be() -> None:
    """The peg comes down on the block and finds the hole by searching."""
    run = inserted(0)
    assert "search 1" in names(run)
    z = run.rows["objects/peg"][:, 2]
    searching = next(phase.start for phase in run.phases if phase.name == "search 2")
    assert z[searching] - 0.5 * LENGTH == pytest.approx(0.04, abs=1.2e-3)
    assert z[-1] - 0.5 * LENGTH == pytest.approx(0.04 - DEPTH, abs=2e-4)


def test_where_camera_and_wrist_err_the_block_is_felt_and_the_peg_goes_in_at_once() -> None:
    """The hole is seen some millimetres beside where it is, and turned."""
    erring = Perturbation(
        pose_bias=2e-3, rotation_bias=0.0087, pose_noise=2e-3, noise_force=0.3, force_drift=1.0
    )
    episode = TaskEpisode(robot=PANDA, task=PegInsert(), perturbation=erring)
    scenario = episode.scenario(80064)
    # Another one of the same seed: looking draws noise.
    simulation = episode.simulation(scenario, 80064)
    off = simulation.seen_marker("hole seen").inverse() @ simulation.marker_pose("hole")
    assert np.linalg.norm(off.translation()) > 4e-3
    assert np.degrees(np.linalg.norm(off.rotation().log())) > 1.0
    run = Runner(scenario, episode.simulation(scenario, 80064)).run()
    assert run.failure is None
    names = [phase.name for phase in run.phases]
    assert names.count("insert") == 1
    assert "draw out" not in names
    # Three touches beside the hole, and one over it; it is lifted off where the wrist is read anew.
    assert names.count("touch") == names.count("lift off") + 1 >= 4
    level = rows_of(run, "insert", "objects/peg")[:, 3:]
    tilt = [SO3(wxyz).as_matrix()[2, 2] for wxyz in level]
    assert np.degrees(np.arccos(np.clip(min(tilt), -1.0, 1.0))) < 1.5
    assert np.linalg.norm(run.rows["contact/tool"], axis=1).max() < 30.0


class Tool(Sensed):
    """A tool at a height, and what its wrist feels."""

    def __init__(self) -> None:
        self.at, self.felt = np.zeros(3), np.zeros(3)

    @property
    def time(self) -> float:
        return 0.0

    def tool_pose(self, tool: int = 0) -> SE3:
        return SE3.from_translation(self.at)

    def felt_force(self, tool: int = 0) -> np.ndarray:
        return self.felt


def test_a_peg_that_creeps_between_the_fingers_has_not_sunk_into_a_hole() -> None:
    tool = Tool()
    sinking = Sinking(tool, np.array([0.0, 0.0, 1.0]))
    for _ in range(6000):
        tool.at = tool.at - np.array([0.0, 0.0, 5e-7])
        sinking.read()
    assert sinking.sunk == pytest.approx(5e-5, rel=0.02)
    before = tool.at
    for _ in range(30):
        tool.at = tool.at + np.array([4e-5, 0.0, -3e-5])
        sinking.read()
    assert sinking.sunk == pytest.approx(0.95e-3, abs=0.05e-3)
    # The hole has held its end since it was 0.3 mm deep.
    off = sinking.caught.translation() - before
    assert -0.3e-3 < off[2] < -0.2e-3
    assert off[0] < 0.4e-3


def feeling(tool: Tool) -> FeelingInserter:
    """Return who inserts a peg into a hole in the origin."""
    return FeelingInserter(
        sensed=tool,
        item=PegInsert().peg,
        above=0.2,
        search_force=2.0,
        insert_force=5.0,
        T_world_hole=SE3.identity(),
    )


def lanes_of(step: Press) -> np.ndarray:
    """Return the ends of the lanes of a search (n, 3)."""
    targets = [waypoint.target for waypoint in step.waypoints]
    return np.array([one.translation() for one in targets if isinstance(one, SE3)])


@pytest.mark.parametrize(
    ("aside", "pressing", "found"),
    [(2.5, 0.0, False), (9.0, 8.0, False), (5.0, 4.0, False), (8.0, 4.0, True)],
)
def test_a_wall_of_the_hole_stops_a_peg_and_friction_does_not(
    aside: float, pressing: float, found: bool
) -> None:
    """In every direction; friction is at most 0.9 times what presses."""
    tool = Tool()
    hand = feeling(tool)
    free = np.array([1.0, 8.0, 2.0])
    for angle in np.linspace(0.0, 2.0 * np.pi, 7):
        condition = hand._found(Sinking(tool, hand._axis), FreeWrist(force=free, time=0.0))
        push = [aside * np.cos(angle), aside * np.sin(angle), pressing]
        tool.felt = free + np.array(push)
        said = [condition.against() for _ in range(4)]
        assert None not in said[:-1]
        assert (said[-1] is None) == found


@pytest.mark.parametrize("sinks", [False, True])
def test_a_peg_that_a_wall_stops_beside_the_hole_is_searched_with_on_the_lanes_beyond(
    sinks: bool,
) -> None:
    tool, gap = Tool(), 0.4e-3
    hand = feeling(tool)
    searches, starts = list[np.ndarray](), list[np.ndarray]()
    for step in hand.insert(np.zeros(2), 1.2e-3, gap):
        if isinstance(step, Press) and step.name == "search":
            if len(searches) == 2:
                break
            ways = lanes_of(step)
            searches.append(ways)
            # On the way along the second lane, or further on, it is stopped.
            k = 1 if len(searches) == 1 else 3
            tool.at = 0.7 * ways[k] + 0.3 * ways[k + 1]
            starts.append(tool.at)
            assert step.observe is not None
            step.observe()
            assert step.until is not None
            tool.felt = np.array([0.0, -6.0, 3.0])
            for _ in range(3):
                assert step.until.against() is not None
            assert step.until.against() is None
            # The arm stops, and nothing pushes it any more.
            tool.felt = np.zeros(3)
        if isinstance(step, Press) and step.name == "insert":
            tool.at = tool.at - [0.0, 0.0, DEPTH if sinks else 1e-5]
    assert len(searches) == (1 if sinks else 2)
    if not sinks:
        first, beyond = searches
        # Beside where it is, back to where it came from, and all that was left.
        across = first[2] - first[1]
        assert np.linalg.norm(across) == pytest.approx(2.0 * 1.2e-3)
        way = first[3] - first[2]
        assert np.linalg.norm(way) == pytest.approx(gap)
        assert beyond[0] == pytest.approx(starts[0] + way, abs=1e-9)
        assert beyond[1] == pytest.approx(first[4], abs=1e-9)
        assert beyond[2:] == pytest.approx(first[3:], abs=1e-9)


def test_fingers_let_go_of_a_peg_that_sticks_only_after_they_press_no_more() -> None:
    """Under load, the arm would spring back."""
    tool, pressed = Tool(), list[Press]()
    for step in feeling(tool).insert(np.zeros(2), 1.2e-3, 0.4e-3):
        if isinstance(step, Release):
            break
        if isinstance(step, Press):
            pressed.append(step)
            tool.felt = np.zeros(3)
        if isinstance(step, Press) and step.name == "search":
            assert step.observe is not None
            step.observe()
            assert step.until is not None
            tool.felt = np.array([0.0, -6.0, 3.0])
            for _ in range(4):
                step.until.against()
        if [one.name for one in pressed].count("insert") == 1 and pressed[-1].name == "insert":
            # It sinks once, deep enough to stand, and no further.
            tool.at = tool.at - [0.0, 0.0, 9e-3]
    else:
        pytest.fail("the fingers never let go")
    inserts = [one.force for one in pressed if one.name == "insert"]
    assert len(inserts) > 1
    assert pressed[-1].force <= 0.1 * inserts[-1]


def test_in_a_long_search_the_wrist_is_read_anew_as_it_drifts() -> None:
    tool, gap = Tool(), 0.4e-3
    searches, between = list[np.ndarray](), list[str]()
    for step in feeling(tool).insert(np.zeros(2), 1.6e-3, gap):
        name = step.name if isinstance(step, Press | Wait) else ""
        if isinstance(step, Press) and name == "search":
            searches.append(lanes_of(step))
            assert step.until is not None
            assert step.until.against() is not None
            # Friction holds it a little before the end.
            tool.at = searches[-1][-1] + [0.0, 0.3e-3, 0.0]
            if len(searches) == 2:
                # After the last lane, nothing was found.
                assert step.until.against() is not None
                break
            assert step.until.against() is None
        elif searches and between[-1:] != [name]:
            between.append(name)
    assert between == ["lift off", "tare", "touch"]
    ways = np.concatenate(searches)
    assert len(ways) == 17
    x = np.round((ways[:, 0] - ways[0, 0]) / gap).astype(int)
    np.testing.assert_array_equal(x, np.repeat(np.arange(9), 2)[1:] - x[0])


def test_the_mass_of_a_peg_that_is_off_its_axis_stays_over_its_foot() -> None:
    task = PegInsert()
    off = Disturbance(object_com_shift=(0.01, -0.01, 0.01))
    world = DisturbedSimulation(PANDA, task.build_scene, off)
    task.reset(world, None)
    com = world.model.body("peg").ipos
    assert np.hypot(com[0], com[1]) == pytest.approx(0.7 * 0.5 * DIAMETER)
    assert com[0] == pytest.approx(-com[1])


def rows_of(run: Run, name: str, signal: str) -> np.ndarray:
    """Rows of a signal in the first phase of a name."""
    i = next(i for i, phase in enumerate(run.phases) if phase.name == name)
    return run.rows[signal][run.phases[i].start : run.phases[i + 1].start]


def test_a_peg_lost_on_the_way_is_a_drop() -> None:
    def take(simulation: Simulation) -> None:
        simulation.place_object("peg", SE3.from_translation(np.array([0.3, 0.3, 0.03])))

    run = carry_out(PegInsert(retries=0), observers=[Meddler("touch", take, after=0.2)])
    assert run.failure is not None
    assert (run.failure.cause, run.failure.step) == (Cause.DROP, "touch")
    assert names(run)[-4:] == ["back off", "open gripper", "home", "end"]


def test_a_hole_that_is_not_found_is_told() -> None:
    def shift(simulation: Simulation) -> None:
        moved = shifted(simulation.marker_pose("hole"), np.array([0.0, 0.025, 0.0]))
        simulation.place_marker("hole", moved)

    task = PegInsert(retries=0, search_radius=5e-4)
    run = carry_out(task, observers=[Meddler("lower", shift)])
    assert run.failure is not None
    assert (run.failure.cause, run.failure.step) == (Cause.TIMEOUT, "search")
    assert "2.0 mm are the hole" in run.failure.evidence
    assert names(run)[-3:] == ["draw out", "home", "end"]


@pytest.fixture
def done() -> tuple[PegInsert, Simulation]:
    """A world in which all is as it should be at the end."""
    task = PegInsert()
    simulation = Simulation(PANDA, task.build_scene)
    task.reset(simulation, None)
    put(simulation, np.zeros(3))
    at_rest(simulation)
    return task, simulation


def put(simulation: Simulation, by: np.ndarray, tilt: float = 0.0) -> None:
    """Put the peg into the hole, its end so far from the middle of the bottom."""
    end = simulation.marker_pose("hole") @ SE3.from_translation(by - [0.0, 0.0, DEPTH])
    turned = SE3.from_rotation(SO3.from_x_radians(tilt))
    up = SE3.from_translation(np.array([0.0, 0.0, 0.5 * LENGTH]))
    simulation.place_object("peg", end @ turned @ up)


def test_all_as_it_should_be_is_success(done: tuple[PegInsert, Simulation]) -> None:
    task, simulation = done
    assert task.verdict(simulation) is None
    assert task.measures(simulation) == {
        "depth_m": pytest.approx(DEPTH),
        "aside_m": pytest.approx(0.0, abs=1e-9),
        "tilt_rad": pytest.approx(0.0, abs=1e-6),
    }


@pytest.mark.parametrize(
    ("by", "tilt", "ok", "message"),
    [
        ((0.0, 0.0, 2.9e-3), 0.0, True, ""),
        ((0.0, 0.0, 3.1e-3), 0.0, False, "the peg is 26.9 mm deep"),
        ((0.9e-3, 0.0, 0.0), 0.0, True, ""),
        ((0.0, 1.1e-3, 0.0), 0.0, False, "1.10 mm beside the axis"),
        ((0.03, 0.0, 0.0), 0.0, False, "30.00 mm beside the axis"),
        ((0.0, 0.0, 0.0), 0.029, True, ""),
        ((0.0, 0.0, 0.0), 0.031, False, "tilted by 0.031 rad"),
        ((0.0, 0.0, DEPTH - 1e-4), 0.0, False, "the peg is 0.1 mm deep"),
    ],
)
def test_near_misses_are_refused(
    done: tuple[PegInsert, Simulation],
    by: tuple[float, float, float],
    tilt: float,
    ok: bool,
    message: str,
) -> None:
    task, simulation = done
    put(simulation, np.array(by), tilt)
    failure = task.verdict(simulation)
    assert (failure is None) == ok
    if failure is not None:
        assert failure.cause is Cause.PLACE
        assert message in failure.evidence


def test_peg_arm_and_gripper_have_to_be_at_rest_and_away(
    done: tuple[PegInsert, Simulation],
) -> None:
    task, simulation = done
    peg = simulation.data.joint(simulation.model.body("peg").jntadr[0])
    peg.qvel[2] = 0.002
    failure = task.verdict(simulation)
    assert failure is not None
    assert "moves at 2.0 mm/s" in failure.evidence
    peg.qvel[2] = 0.0
    simulation.data.joint(PANDA.joints[0]).qpos[0] += 0.011
    failure = task.verdict(simulation)
    assert failure is not None
    assert "a joint is 0.011 rad from home" in failure.evidence
    simulation.data.joint(PANDA.joints[0]).qpos[0] -= 0.011
    simulation.data.joint(GRIPPER.joints[1]).qpos[0] = 0.03
    failure = task.verdict(simulation)
    assert failure is not None
    assert "the gripper is open 70.0 mm" in failure.evidence


def pushed(force: tuple[float, float, float]) -> tuple[np.ndarray, float]:
    """Offset of the peg's middle in the hole, pushed there without a robot, and how deep the
    deepest contact is [m]."""
    spec = mujoco.MjSpec()
    task = PegInsert()
    task.build_scene(spec)
    spec.option.timestep = 1e-3
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    model = spec.compile()
    data = mujoco.MjData(model)
    hole = model.body("hole").mocapid[0]
    data.mocap_pos[hole] = [0.5, 0.0, 0.04]
    data.joint(model.body("peg").jntadr[0]).qpos[:3] = [0.5, 0.0, 0.0405]
    peg = model.body("peg").id
    for _ in range(1500):
        # At the middle of the part that is in the hole, so that it is not levered out.
        arm = np.array([0.0, 0.0, 0.025]) - [0.0, 0.0, data.xipos[peg][2]]
        data.xfrc_applied[peg, :3] = force
        data.xfrc_applied[peg, 3:] = np.cross(arm, force)
        mujoco.mj_step(model, data)
    deepest = float(np.min(data.contact.dist))
    return data.xipos[peg] - [0.5, 0.0, 0.04], -deepest


@pytest.mark.parametrize("angle", [0.0, 0.1, np.pi / 16, 0.3])
def test_the_hole_is_as_wide_as_it_says(angle: float) -> None:
    """The clearance in any direction; between the middles of facets up to 2 % more."""
    way = np.array([np.cos(angle), np.sin(angle), 0.0])
    (x, y, _), deep = pushed(tuple(20.0 * way))
    assert deep < 0.05e-3
    room = float(np.hypot(x, y))
    assert 0.5 * CLEARANCE - 1e-6 <= room <= 0.5 * CLEARANCE / np.cos(np.pi / 16) + 5e-5


def test_the_hole_is_as_deep_as_it_says() -> None:
    (_, _, z), deep = pushed((0.0, 0.0, -20.0))
    assert deep < 0.05e-3
    assert z == pytest.approx(0.5 * LENGTH - DEPTH, abs=5e-5)


@pytest.mark.parametrize("seed", range(20))
def test_what_is_known_of_the_hole_is_off_by_no_more_than_said(seed: int) -> None:
    task, simulation = PegInsert(), _world()
    task.reset(simulation, np.random.default_rng(seed))
    off = simulation.marker_pose("hole").inverse() @ simulation.marker_pose("hole seen")
    assert (np.abs(off.translation()) <= POSITION_ERROR).all()
    assert (np.abs(off.rotation().log()) <= 1.05 * ANGLE_ERROR).all()
    assert np.abs(off.translation()).max() > 1e-5
    peg, hole = simulation.object_pose("peg"), simulation.marker_pose("hole")
    assert np.linalg.norm((peg.translation() - hole.translation())[:2]) > 0.04 + DIAMETER


@cache
def _world() -> Simulation:
    return Simulation(PANDA, PegInsert().build_scene)


@pytest.mark.parametrize("name", ["grip_force", "search_force", "insert_force", "search_radius"])
@pytest.mark.parametrize("value", [0.0, np.nan])
def test_impossible_settings_are_refused(name: str, value: float) -> None:
    with pytest.raises(InvalidValueError, match=f"{name} must be above 0 and finite; found"):
        replace(PegInsert(), **{name: value})  # type: ignore[arg-type]


class Weighing(Simulation):
    """A wrist that feels the weight of the peg."""

    def felt_force(self, tool: int = 0) -> np.ndarray:
        return np.array([0.0, 0.0, -1.5])


def test_a_search_in_vain_is_followed_by_one_that_is_wider_and_finer() -> None:
    task = PegInsert()
    simulation = Weighing(PANDA, task.build_scene)
    task.reset(simulation, None)
    program, searches = task.program(live(simulation)), list[np.ndarray]()
    step = next(program)
    while len(searches) < 3:
        if isinstance(step, Comply) and step.name == "search":
            targets = [waypoint.target for waypoint in step.waypoints]
            poses = [simulation.tool_pose(), *(one for one in targets if isinstance(one, SE3))]
            searches.append(np.array([pose.translation() for pose in poses]))
            vain = Failure(cause=Cause.TIMEOUT, evidence="not found", step="search")
            step = program.throw(StepFailed(vain))
        else:
            if isinstance(step, Comply) and step.observe is not None:
                step.observe()
            step = next(program)
    rng = np.random.default_rng(3)
    for corners, gap, radius in zip(
        searches, (0.4e-3, 0.28e-3, 0.196e-3), (3.2e-3, 4.8e-3, 7.2e-3), strict=True
    ):
        # Whatever is within the radius, but for a last turn, is passed within half the gap.
        ways = np.concatenate([np.linspace(a, b, 400) for a, b in pairwise(corners)])[:, :2]
        middle = simulation.tool_pose().translation()[:2]
        angle, far = rng.uniform(0.0, 2.0 * np.pi, 99), (radius - gap) * np.sqrt(rng.random(99))
        for place in middle + np.column_stack([far * np.cos(angle), far * np.sin(angle)]):
            assert np.linalg.norm(ways - place, axis=1).min() < 0.5 * gap + 0.02e-3
        sides = np.abs(np.diff(corners, axis=0)).max(axis=1)
        assert np.unique(np.round(np.diff(sides), 9)).max() == pytest.approx(gap)


def test_a_peg_that_goes_straight_in_is_not_searched_with() -> None:
    """From this seed the hole is nearly where it is thought to be."""
    run = inserted(551)
    assert run.failure is None
    assert not [name for name in names(run) if name.startswith("search")]
    assert names(run).count("touch") == 1
