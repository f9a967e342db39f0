"""Metrics: figures recomputed by hand from rows with known numbers."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest

from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import Motion, Place, Waypoint, tool_down
from robo47_qp.report.metrics import SETTLED, metrics, smoothness
from robo47_qp.run.contact_steps import Guarded
from robo47_qp.run.phase import Phase
from robo47_qp.run.recording import Rows
from robo47_qp.run.scenario import Run
from robo47_qp.run.task import Program
from robo47_qp.sim.sensed import Sensed
from tests.runs import Reach, carry_out, picked_and_placed


@dataclass(frozen=True, kw_only=True)
class TouchPad(Reach):
    """Down slowly for 0.28 m, until a pad is touched after 2 cm."""

    fixed_force_max: float = 60.0

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        super().build_scene(spec)
        box = mujoco.mjtGeom.mjGEOM_BOX
        spec.worldbody.add_geom(type=box, pos=[0.5, 0.0, 0.35], size=[0.05, 0.05, 0.02])

    def program(self, sensed: Sensed) -> Program:
        yield Waypoint(name="above", target=tool_down([0.5, 0.0, 0.4]))
        down = Waypoint(name="down", target=tool_down([0.5, 0.0, 0.12]), motion=Motion.LIN)
        yield Guarded(waypoint=down, force=3.0, speed=0.02)
        yield Waypoint(name="home", target=Place.HOME)
        return None


def test_figures_of_made_up_rows() -> None:
    run = picked_and_placed()
    rows = Rows(run.rows.signals, np.zeros((2000, run.rows.values.shape[1])))
    rows["errors/q"][100, 3] = -0.7
    rows["errors/q"][200, 1] = 0.5
    rows["errors/tool_position"][:1000, 0] = 3.0
    rows["errors/tool_position"][5, 0] = 4.0
    rows["contact/tool"][7] = [3.0, 0.0, -4.0]
    rows["contact/tool"][8] = [0.0, 1.0, 0.0]
    # One motor works with 2 N·m at 0.5 rad/s for ten periods, against itself for ten more.
    rows["joints/tau"][300:320, 2] = 2.0
    rows["joints/v"][300:311, 2], rows["joints/v"][311:321, 2] = 0.5, -0.5
    legs = [phase.leg for phase in run.phases if phase.leg is not None]
    phases = [
        Phase(name="move", start=0, leg=legs[0]),
        Phase(name="wait", start=995, leg=None),
        Phase(name="move", start=1500, leg=legs[1]),
        Phase(name="wait", start=1900, leg=None),
    ]
    made_up = replace(
        run, rows=rows, phases=phases, loop_seconds=0.25, measures={"place_error_m": 0.125}
    )
    figures = metrics(made_up)
    speed = figures.pop("max_tool_speed_m_s")
    J = Arm(PANDA).jacobian(np.zeros(7))
    assert speed == pytest.approx(0.5 * np.linalg.norm(J[:3, 2]), abs=1e-9)
    assert figures.pop("max_tool_acceleration_m_s2") < 1.0
    assert "smoothness_ldlj" in figures or speed < 1e-3
    figures.pop("smoothness_ldlj", None)
    # Neither motion is as long as it was planned.
    assert figures.pop("cycle_bound_s") == pytest.approx(2.0)
    assert figures.pop("energy_J") == pytest.approx(19 * 2.0 * 0.5 * 1e-3)
    assert figures.pop("rms_tool_error_m") == pytest.approx(np.sqrt((999 * 9 + 16) / 2000))
    assert figures == pytest.approx(
        {
            "place_error_m": 0.125,
            "failed_steps": 0.0,
            "max_joint_error_rad": 0.7,
            "max_tool_error_m": 4.0,
            "settle_time_s": 0.005,
            "peak_contact_force_N": 5.0,
            "mean_contact_force_N": 3.0,
            "cycle_time_s": 2.0,
            "real_time_factor": 8.0,
            "step_us": 125.0,
        }
    )


YIELDING = [
    {"name": "move", "start": 0},
    {"name": "press", "start": 300, "compliant": True},
    {"name": "follow", "start": 600, "streamed": True},
    {"name": "end", "start": 900},
]


def while_yielding(marks: dict[int, float], phases: list[dict[str, object]]) -> dict[str, float]:
    """Figures of 1000 rows with errors of joints and tool in some of them."""
    run = picked_and_placed()
    leg = next(phase.leg for phase in run.phases if phase.leg is not None)
    rows = Rows(run.rows.signals, np.zeros((1000, run.rows.values.shape[1])))
    for row, size in marks.items():
        rows["errors/q"][row, 2] = -size
        rows["errors/tool_position"][row, 0] = size
    named = [
        Phase(leg=leg if phase["name"] == "move" else None, **phase)  # type: ignore[arg-type]
        for phase in phases
    ]
    return metrics(replace(run, rows=rows, phases=named))


@pytest.mark.parametrize("row", [299, 300, 599, 600, 899])
def test_a_tool_that_yields_makes_no_error(row: int) -> None:
    figures = while_yielding({row: 0.4}, YIELDING)
    error = 0.0 if 300 <= row < 600 else 0.4
    assert figures["max_joint_error_rad"] == error
    assert figures["max_tool_error_m"] == error
    assert figures["rms_tool_error_m"] == pytest.approx(error / np.sqrt(700))


def test_where_it_always_yields_there_is_no_error_to_tell() -> None:
    always = [{**phase, "compliant": True} for phase in YIELDING]
    figures = while_yielding({10: 0.4, 700: 0.4}, always)
    names = ("max_joint_error_rad", "max_tool_error_m", "rms_tool_error_m")
    assert [figures[name] for name in names] == [0.0, 0.0, 0.0]


def test_a_tool_that_yields_is_not_waited_for() -> None:
    """Nor one that follows something, nor one that did either since its last motion ended."""
    for row in (500, 650, 950):
        assert while_yielding({row: 0.4}, YIELDING)["settle_time_s"] == 0.0
    pressing = [{**YIELDING[0]}, {"name": "press", "start": 300, "axis": np.array([0.0, 0.0, 1.0])}]
    assert while_yielding({500: 0.4}, pressing)["settle_time_s"] == 0.0
    at_rest = [YIELDING[0], {"name": "hold", "start": 300}, *YIELDING[2:]]
    assert while_yielding({500: 0.4, 950: 0.4}, at_rest)["settle_time_s"] == pytest.approx(0.201)


def cut_short(run: Run, name: str, end: int) -> Run:
    """The run as if a motion had been broken off at a row, and the arm had then stood still."""
    i = next(i for i, phase in enumerate(run.phases) if phase.name == name)
    still = Phase(name="stood still", start=end, leg=None)
    return replace(run, phases=[*run.phases[: i + 1], still, *run.phases[i + 1 :]])


def test_a_motion_that_is_broken_off_counts_with_the_time_that_it_took() -> None:
    """Its bound is that of all of its way; so is that of the first of motions without a stop."""
    run = picked_and_placed()
    moved = [(phase, rows) for phase, rows in run.spans() if phase.leg is not None]
    whole = metrics(run)["cycle_bound_s"]
    phase, rows = max(moved, key=lambda one: one[1].stop - one[1].start)
    assert phase.leg is not None
    assert phase.leg.stops
    cut = metrics(cut_short(run, phase.name, rows.start + 100))["cycle_bound_s"]
    left = rows.stop - rows.start - 100
    assert cut == pytest.approx(whole - phase.leg.lower_bound + 1e-3 * (100 + left))
    assert cut <= metrics(run)["cycle_time_s"]


def test_motions_without_a_stop_that_are_broken_off_count_with_their_time() -> None:
    """The first of them has the bound of all; also where the run ends before the last is done."""
    run = carry_out(Reach(rise=0.1))
    up = next(phase for phase in run.phases if phase.leg is not None)
    assert up.leg is not None
    way, whole = up.leg.trajectory, metrics(run)["cycle_bound_s"]
    middle, steps = up.start + way.steps // 2, way.steps
    first = replace(up.leg, trajectory=way.part(0, way.steps // 2))
    last = replace(up.leg, trajectory=way.part(way.steps // 2, steps), lower_bound=0.0)
    halves = [replace(up, leg=first), replace(up, start=middle, leg=last)]
    assert not first.stops
    split = replace(run, phases=[*halves, *run.phases[1:]])
    assert metrics(split)["cycle_bound_s"] == pytest.approx(whole)
    still = Phase(name="stood still", start=middle, leg=None)
    broken = replace(run, phases=[halves[0], still, *run.phases[1:]])
    lost = 1e-3 * steps - up.leg.lower_bound
    assert metrics(broken)["cycle_bound_s"] == pytest.approx(whole + lost)
    for row, driven in ((middle + 100, halves), (middle - 100, halves[:1])):
        ended = Rows(run.rows.signals, run.rows.values[:row].copy())
        short = replace(run, rows=ended, phases=driven)
        assert metrics(short)["cycle_bound_s"] == pytest.approx(1e-3 * len(ended))


def test_a_touch_on_the_way_leaves_a_bound_below_the_time_that_was_taken() -> None:
    figures = metrics(carry_out(TouchPad()))
    assert 0.5 * figures["cycle_time_s"] < figures["cycle_bound_s"] <= figures["cycle_time_s"]


def test_the_smoothness_of_a_motion_that_was_broken_off_is_not_told() -> None:
    """With what follows it, it would count as one motion."""
    run = carry_out(Reach(rise=0.1))
    first, second = (phase for phase in run.phases if phase.leg is not None)
    assert first.leg is not None
    passed = replace(
        first, leg=replace(first.leg, waypoint=replace(first.leg.waypoint, blend=0.01))
    )
    still = Phase(name="stood still", start=first.start + 200, leg=None)
    broken = replace(run, phases=[passed, still, second, *run.phases[2:]])
    alone = replace(run, phases=[replace(first, leg=None), second, *run.phases[2:]])
    assert metrics(broken)["smoothness_ldlj"] == metrics(alone)["smoothness_ldlj"]


def test_figures_of_a_real_run() -> None:
    run = picked_and_placed()
    rows, figures = run.rows, metrics(run)
    error = np.abs(rows["joints/q_ref"] - rows["joints/q"]).max()
    assert figures["max_joint_error_rad"] == pytest.approx(error)
    off = np.linalg.norm(rows["tool/pose_ref"][:, :3] - rows["tool/pose"][:, :3], axis=1)
    assert figures["max_tool_error_m"] == pytest.approx(off.max())
    assert figures["rms_tool_error_m"] <= figures["max_tool_error_m"] < 1e-3
    assert figures["cycle_time_s"] == pytest.approx(rows["time"][-1, 0] + 1e-3)
    assert 0.6 * figures["cycle_time_s"] < figures["cycle_bound_s"] < figures["cycle_time_s"]
    resting = sum(s.stop - s.start for phase, s in run.spans() if phase.leg is None)
    moving = sum(leg.lower_bound for leg in run.legs)
    assert figures["cycle_bound_s"] == pytest.approx(1e-3 * resting + moving)
    assert figures["place_error_m"] == run.measures["place_error_m"]
    assert figures["real_time_factor"] * figures["step_us"] == pytest.approx(1000.0)
    assert all(isinstance(value, float) for value in figures.values())
    force = np.linalg.norm(rows["contact/tool"], axis=1)
    assert figures["peak_contact_force_N"] == force.max()
    # The cube weighs 0.981 N, and for most of the contact it is held still or steadily moved.
    assert figures["mean_contact_force_N"] == pytest.approx(0.981, rel=0.05)


def test_the_energy_is_what_gravity_and_motion_take() -> None:
    """Up and home again, slowly: lifting takes m g h, and so does lowering."""
    run = carry_out(Reach(rise=0.1), speed=0.3)
    rows, arm = run.rows, Arm(PANDA)
    power = [
        np.abs(arm.inverse_dynamics(q, v, a) * v).sum()
        for q, v, a in zip(*(rows[f"joints/{x}_ref"] for x in "qva"), strict=True)
    ]
    assert metrics(run)["energy_J"] == pytest.approx(np.sum(power) * 1e-3, rel=0.01)


def test_the_speeds_and_the_smoothness_are_those_of_the_recorded_poses() -> None:
    run = carry_out(Reach(rise=0.1))
    position, figures = run.rows["tool/pose"][:, :3], metrics(run)
    v = np.diff(position, axis=0) / 1e-3
    assert figures["max_tool_speed_m_s"] == pytest.approx(np.linalg.norm(v, axis=1).max(), rel=1e-3)
    a = np.diff(v, axis=0) / 1e-3
    assert figures["max_tool_acceleration_m_s2"] == pytest.approx(
        np.linalg.norm(a, axis=1).max(), rel=0.02
    )
    j = np.diff(a, axis=0) / 1e-3
    first, second, end = (phase.start for phase in run.phases)
    found = [smoothness(v[s], j[s], 1e-3) for s in (slice(first, second), slice(second, end))]
    assert figures["smoothness_ldlj"] == pytest.approx(np.mean(found), abs=0.02)  # type: ignore[arg-type]


def test_motions_without_a_stop_between_them_are_one() -> None:
    run = carry_out(Reach(rise=0.1))
    whole, _ = (phase for phase in run.phases if phase.leg is not None)
    middle = whole.start + 200
    assert whole.leg is not None
    passed = replace(whole.leg, waypoint=replace(whole.leg.waypoint, blend=0.01))
    halves = [replace(whole, leg=passed), replace(whole, start=middle)]
    split = replace(run, phases=[*halves, *run.phases[1:]])
    assert metrics(split)["smoothness_ldlj"] == metrics(run)["smoothness_ldlj"]
    stopped = replace(run, phases=[whole, halves[1], *run.phases[1:]])
    assert metrics(stopped)["smoothness_ldlj"] != metrics(run)["smoothness_ldlj"]


def test_a_tool_that_never_settles_takes_all_the_time_there_is() -> None:
    run = picked_and_placed()
    rows = Rows(run.rows.signals, run.rows.values.copy())
    spans = zip(run.phases, run.phases[1:], strict=False)
    grip = next((a.start, b.start) for a, b in spans if a.name == "close gripper")
    rows["errors/tool_position"][slice(*grip), 0] = SETTLED * 1.01
    figures = metrics(replace(run, rows=rows))
    assert figures["settle_time_s"] == pytest.approx((grip[1] - grip[0]) * 1e-3)


def test_waiting_in_two_phases_is_waiting_all_the_same() -> None:
    run = picked_and_placed()
    grip = next(i for i, phase in enumerate(run.phases) if phase.name == "close gripper")
    closing = run.phases[grip]
    later = replace(closing, name="wait", start=closing.start + 50)
    phases = [*run.phases[: grip + 1], later, *run.phases[grip + 1 :]]
    rows = Rows(run.rows.signals, run.rows.values.copy())
    rows["errors/tool_position"][later.start + 9, 0] = 1.0
    figures = metrics(replace(run, rows=rows, phases=phases))
    assert figures["settle_time_s"] == pytest.approx(0.060)


def test_a_run_without_a_motion_has_no_smoothness() -> None:
    stuck = metrics(carry_out(Reach(rise=5.0)))
    assert "smoothness_ldlj" not in stuck
    assert stuck["settle_time_s"] == 0.0
