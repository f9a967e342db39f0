import json
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader
from rich.console import Console

from robo47_qp.arrays import ends
from robo47_qp.control.joint_impedance import FeedForward, JointImpedance
from robo47_qp.errors import RecordingError, UnknownNameError
from robo47_qp.evaluation.benchmarks.control.trial import Bench, TrialCondition
from robo47_qp.evaluation.benchmarks.settling.settling import settling_after_disturbance
from robo47_qp.evaluation.perturbation import PRESETS
from robo47_qp.files import claimed
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.disturbance import Disturbance
from scenarios import compare_controllers as scenario


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    log = tmp_path_factory.mktemp("compared") / "c.rrd"
    load = "payload 0.5 kg"
    only = "free", load, f"{load}, told", f"{load}, told at rest"
    options = scenario.ControllersOptions(log=log, only=only)
    assert scenario.run(options, Console(quiet=True)) == 0
    return log


def test_every_term_of_the_feed_forward_is_worth_something(written: Path) -> None:
    free = json.loads(written.with_suffix(".json").read_text())["trials"]["free"]
    errors = [free[name]["max_joint_error_rad"] for name in scenario.CONTROLLERS]
    assert errors[0] > 1.3 * errors[1] > 2.0 * errors[2] > 10 * errors[3]
    assert free["PD"]["last_tool_error_m"] > 1e3 * free["+ gravity"]["last_tool_error_m"]
    assert all(trial["stable"] for trial in free.values())


def test_joint_impedance_keeps_its_promises_in_free_motion(written: Path) -> None:
    free = json.loads(written.with_suffix(".json").read_text())["trials"]["free"]
    assert free["+ acceleration"]["max_joint_error_rad"] <= 0.2e-3
    assert free["+ acceleration"]["max_tool_error_m"] <= 0.15e-3


def test_what_is_learned_of_friction_is_worth_something_once_joints_turn(tmp_path: Path) -> None:
    """On the first leg, nothing is known of it; heavier links do not turn with the motion."""
    options = scenario.ControllersOptions(
        log=tmp_path / "c.rrd", only=("dry friction", "links +5 %")
    )
    assert scenario.run(options, Console(quiet=True)) == 0
    trials = json.loads((tmp_path / "c.json").read_text())["trials"]
    plain, learned = (trials["dry friction"][name] for name in ("+ observer", "+ friction"))
    assert learned["max_joint_error_again_rad"] < 0.4 * plain["max_joint_error_again_rad"]
    assert learned["max_joint_error_rad"] < 0.6 * plain["max_joint_error_rad"]
    plain, learned = (trials["links +5 %"][name] for name in ("+ observer", "+ friction"))
    assert learned["max_joint_error_rad"] == plain["max_joint_error_rad"]


def test_every_law_is_tried_with_the_observer_that_the_default_has(tmp_path: Path) -> None:
    options = scenario.ControllersOptions(log=tmp_path / "c.rrd", only=("both",))
    assert scenario.run(options, Console(quiet=True)) == 0
    both = json.loads((tmp_path / "c.json").read_text())["trials"]["both"]
    for name, alone in (("joint", "+ acceleration"), ("Cartesian",) * 2, ("operational",) * 2):
        assert scenario.CONTROLLERS[f"{name}, observer"][1] == scenario.CONTROLLERS["+ friction"][1]
        assert type(scenario.CONTROLLERS[f"{name}, observer"][0]) is type(
            scenario.CONTROLLERS[alone][0]
        )
        without, observed = both[alone], both[f"{name}, observer"]
        assert observed["max_tool_error_m"] < 0.3 * without["max_tool_error_m"]
        assert observed["last_tool_error_m"] < 0.05 * without["last_tool_error_m"]


@pytest.mark.parametrize("level", ["moderate", "severe"])
def test_worlds_of_a_level_differ_as_it_says(level: str) -> None:
    known = {one.name: one.disturbance for one in scenario.conditions(1.0)}
    worlds = [known[f"{level} {number}"] for number in (1, 2, 3)]
    preset = PRESETS[level]
    low, high = ends(preset.joint_friction)
    for world in worlds:
        assert (world.noise_q, world.pushes) == (preset.noise_q, ())
        friction = np.asarray(world.dry_friction)
        assert friction[:4].min() >= low
        assert friction.max() <= high
    assert len({tuple(np.ravel(world.link_mass_factor)) for world in worlds}) == 3


def test_the_last_leg_is_told_alone() -> None:
    """It goes there as the first one did; errors of the legs before are not among its own."""
    bench = Bench(PANDA, [0.1] * 7)
    there, back, again = bench.legs
    np.testing.assert_array_equal(again.end.q, there.end.q)
    np.testing.assert_allclose(back.end.q, there.q[0], atol=1e-12)
    plain = JointImpedance(feed_forward=FeedForward.NONE)
    trial = bench.run("PD", plain, TrialCondition(name="free"))
    errors = np.abs(trial.joint_errors).max(axis=1)
    assert trial.again == there.steps + back.steps
    assert trial.moving == trial.again + again.steps < len(errors)
    last = errors[trial.again : trial.moving].max()
    assert trial.figures()["max_joint_error_again_rad"] == last
    raised = replace(trial, joint_errors=trial.joint_errors.copy())
    raised.joint_errors[: trial.again] += 1.0
    raised.joint_errors[trial.moving :] += 1.0
    assert raised.figures()["max_joint_error_again_rad"] == last


def test_a_payload_that_it_is_told_of_is_held_ten_times_better(written: Path) -> None:
    trials = json.loads(written.with_suffix(".json").read_text())["trials"]
    untold, told, later = (trials[f"payload 0.5 kg{k}"] for k in ("", ", told", ", told at rest"))
    for name in ("+ acceleration", "Cartesian", "operational"):
        for moving in ("max_joint_error_rad", "max_joint_error_again_rad", "max_tool_error_m"):
            assert later[name][moving] == untold[name][moving]
            assert untold[name][moving] > 10 * told[name][moving]
        kept = "tool_error_before_told_m", "last_tool_error_m"
        before, after = (later[name][k] for k in kept)
        assert before > 10 * after
        assert before > 10 * max(told[name][k] for k in kept)


def test_recording_and_plot_hold_every_controller(written: Path) -> None:
    assert written.with_suffix(".png").stat().st_size > 10_000
    paths = {str(chunk.entity_path) for chunk in RrdReader(written).stream().to_chunks()}
    assert {"/free/tool_error", "/free/torque_use", "/figures"} <= paths


def test_a_condition_that_does_not_exist_is_named(tmp_path: Path) -> None:
    options = scenario.ControllersOptions(log=tmp_path / "c.rrd", only=("rain",))
    with pytest.raises(
        UnknownNameError, match=r"No condition is called 'rain'; known: 'free', 'payload"
    ):
        scenario.run(options, Console(quiet=True))
    assert not list(tmp_path.iterdir())


def test_a_second_comparison_with_the_same_files_is_refused(tmp_path: Path) -> None:
    log = tmp_path / "controllers.rrd"
    log.write_text("of the first")
    options = scenario.ControllersOptions(log=log, only=("free",))
    with (
        claimed(log),
        pytest.raises(
            RecordingError, match=r"controllers\.rrd is being written by another process"
        ),
    ):
        scenario.run(options, Console(quiet=True))
    assert log.read_text() == "of the first"


def test_a_controller_that_is_too_late_is_called_unstable() -> None:
    bench = Bench(PANDA, [0.1] * 7)
    stiff = JointImpedance(stiffness_scale=4.0)
    late = TrialCondition(name="late", disturbance=Disturbance(torque_delay=0.025))
    assert not bench.run("stiff", stiff, late).stable
    assert bench.run("stiff", stiff, TrialCondition(name="free")).stable


def test_the_same_noise_for_everyone_and_the_same_result_twice() -> None:
    bench = Bench(PANDA, [0.1] * 7)
    noise = TrialCondition(name="noise", disturbance=Disturbance(noise_q=1e-4), seed=3)
    plain = JointImpedance(feed_forward=FeedForward.GRAVITY)
    first, second = (bench.run("g", plain, noise) for _ in range(2))
    assert first.joint_errors.tolist() == second.joint_errors.tolist()
    assert np.abs(first.joint_errors[-200:]).max() > 1e-6


@pytest.mark.parametrize("decay", [4.0, 8.0])
def test_settling_is_that_of_an_exponential(decay: float) -> None:
    t = 1e-3 * np.arange(4000)
    errors = np.zeros((4000, 3))
    errors[1000:, 0] = 0.02 * np.exp(-decay * t[:3000])
    assert settling_after_disturbance(errors, 1000, 1300, 200) == pytest.approx(
        np.log(50) / decay, rel=0.02
    )
    pushed = np.zeros((4000, 3))
    pushed[1500:, 1] = 0.02 * np.exp(-decay * t[:2500])
    assert settling_after_disturbance(pushed, 1000, 1300, 200) == pytest.approx(
        np.log(50) / decay, rel=0.03
    )
    assert settling_after_disturbance(np.zeros((4000, 3)), 1000, 1300, 200) == 0.0
    ringing = np.zeros((4000, 3))
    ringing[:, 2] = 0.01 * np.sin(60 * t)
    assert settling_after_disturbance(ringing, 1000, 1300, 200) == inf
