"""Episodes of a task: paired worlds, the same bits, and causes of what goes wrong."""

import json
import pickle
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from mink import SE3

from robo47_qp.evaluation import task_episode
from robo47_qp.evaluation.episode import EpisodeResult, EpisodeSpec
from robo47_qp.evaluation.perturbation import PRESETS, Perturbation
from robo47_qp.evaluation.policies import PolicyReference
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.evaluation.workers.worker import run_guarded
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.audit.finding import Finding
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.foreign_code import ClassLoadError
from robo47_qp.run.runner import ProgramDriver
from robo47_qp.run.watchdog import Watchdog
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.table import SURFACE_FRICTION, add_table
from tests.runs import Reach
from tests.toy_policies import Drive

SPEC = EpisodeSpec(index=2, seed=7)
TOYS = "tests.toy_policies"


@dataclass(frozen=True, kw_only=True)
class Watched(Reach):
    """Moves by what is drawn and seen, and writes down in what world."""

    name: str = "watched"
    bigger: float = 0.0
    start: list[float] = field(default_factory=list)

    def variant(self, rng: np.random.Generator) -> "Watched":
        return replace(self, bigger=float(rng.uniform(0.0, 0.01)))

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        add_table(spec)
        brick = spec.worldbody.add_body(name="brick", pos=[0.5, 0.2, 0.02])
        brick.add_freejoint()
        brick.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02 + self.bigger] * 3, mass=0.2)

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        assert rng is not None
        where = [0.5, float(rng.uniform(-0.2, 0.2)), 0.02 + self.bigger]
        simulation.place_object("brick", SE3.from_translation(np.array(where)))
        self.start[:] = [
            *simulation.object_pose("brick").translation(),
            simulation.model.body("brick").mass[0],
            simulation.model.geom_friction[0, 0],
        ]

    def measures(self, simulation: Simulation) -> dict[str, float]:
        names = ("x", "y", "z", "mass", "friction")
        return dict(zip(names, map(float, self.start), strict=True))


def episode(**settings: Any) -> TaskEpisode:
    return TaskEpisode(robot=PANDA, **{"task": Watched(), **settings})


NOISY = replace(PRESETS["moderate"], noise_q=1e-5, pushes=1, push_force=2.0, push_time=0.2)


@pytest.fixture(scope="module")
def noisy() -> EpisodeResult:
    return episode(perturbation=NOISY)(SPEC)


def test_an_episode_is_the_same_to_the_bit_with_a_recording_and_after_others(
    noisy: EpisodeResult, tmp_path: Path
) -> None:
    again = pickle.loads(pickle.dumps(episode(perturbation=NOISY)))
    other = again(EpisodeSpec(index=3, seed=8))
    path = tmp_path / "replay.rrd"
    replayed = again(replace(SPEC, recording=path))
    assert path.stat().st_size > 100_000
    assert noisy.is_same(replayed)
    assert noisy.sha256 is not None
    assert len(noisy.sha256) == 64
    assert other.sha256 != noisy.sha256
    assert other.disturbance["friction"] != noisy.disturbance["friction"]


def test_an_entry_has_all_that_is_asked_of_an_episode(noisy: EpisodeResult) -> None:
    entry = json.loads(json.dumps(noisy.entry(), allow_nan=False))
    assert (entry["index"], entry["seed"], entry["success"]) == (2, 7, True)
    for name in ("cause", "evidence", "step", "condition", "time", "error"):
        assert entry[name] is None
    for name in ("cycle_time_s", "peak_contact_force_N", "energy_J", "max_joint_error_rad"):
        assert entry["metrics"][name] >= 0.0
    assert set(entry["timing"]) == {"wall_s", "step_us", "real_time_factor"}
    assert not set(entry["timing"]) & set(entry["metrics"])
    assert not set(entry["measures"]) & set(entry["metrics"])
    assert entry["audit_ok"] is (entry["broken_promises"] == [])
    assert entry["disturbance"]["torque_delay"] == [0.5e-3, 1e-3]
    assert EpisodeResult.of_entry(entry).entry() == entry


def test_pushes_come_at_any_time_of_the_task_however_long_it_may_take() -> None:
    class Long(Watched):
        """A job of 200 s."""

        usual_time = 200.0

    starts = {}
    for limit in (None, 20.0):
        made = episode(task=Long(), perturbation=PRESETS["severe"], time_limit=limit)
        worlds = [made.simulation(made.scenario(seed), seed, drawn=False) for seed in range(40)]
        starts[limit] = [push.start for world in worlds for push in world.disturbance.pushes]
    assert starts[None] == starts[20.0]
    assert 190.0 < max(starts[None]) <= 200.0
    assert np.mean(starts[None]) == pytest.approx(100.0, rel=0.2)
    assert Watched().usual_time == 0.7 * Watched().time_limit


def test_worlds_are_paired_whatever_drives_in_them(noisy: EpisodeResult) -> None:
    """Scene, start, mass and friction depend on the seed, not on policy, speed or noise."""
    other = episode(
        perturbation=replace(NOISY, noise_q=0.0, pose_noise=0.0, pushes=0),
        stack=ClassicalStack(ik="lm", pace=0.5),
        foreign=True,
    )(SPEC)
    assert other.measures == noisy.measures
    assert other.sha256 != noisy.sha256
    size = np.random.default_rng([7, 2]).uniform(0.0, 0.01)
    y = np.random.default_rng(7).uniform(-0.2, 0.2)
    drawn = NOISY.draw(np.random.default_rng([7, 1]))
    assert noisy.measures == pytest.approx(
        {
            "x": 0.5,
            "y": y,
            "z": 0.02 + size,
            "mass": 0.2 * np.asarray(drawn.object_mass_factor)[0],
            "friction": drawn.friction,
        }
    )
    plain = episode()(SPEC)
    assert plain.measures == {**noisy.measures, "mass": 0.2, "friction": SURFACE_FRICTION[0]}
    assert Perturbation() != NOISY


def test_a_failure_has_its_cause_with_time_and_evidence() -> None:
    ending = Failure(cause=Cause.SLIP, evidence="7 mm", step="carry", condition="held")
    result = episode(task=Watched(ending=ending))(SPEC)
    assert (result.success, result.cause, result.evidence) == (False, "slip", "7 mm")
    assert (result.step, result.condition, result.error) == ("carry", "held", None)
    assert result.time is not None
    assert 0.0 < result.time <= result.metrics["cycle_time_s"]
    assert result.failure == "slip"


@pytest.mark.parametrize(
    ("way", "cause", "evidence"),
    [
        ("nan", "limit", "commanded torque must be finite"),
        ("value", "limit", "grip width must be below 0.08; found 3.0"),
        ("plan", "ik", "Waypoint 'lift' cannot be planned: no way"),
    ],
)
def test_what_cannot_be_carried_out_costs_the_episode(way: str, cause: str, evidence: str) -> None:
    result = episode(driver=Drive(way), foreign=True)(SPEC)
    assert (result.success, result.cause, result.error) == (False, cause, None)
    assert result.evidence is not None
    assert evidence in result.evidence
    assert result.time == pytest.approx(1e-3)
    assert result.timing["wall_s"] > 0.0
    assert (result.sha256, result.audit_ok) == (None, None)


@pytest.mark.parametrize(
    ("way", "last"),
    [
        ("bug", "ZeroDivisionError: a bug of ours"),
        ("nan", "commanded torque must be finite"),
        ("value", "found 3.0"),
    ],
)
def test_a_bug_of_ours_is_no_failure_of_the_robot(way: str, last: str) -> None:
    result = run_guarded(episode(driver=Drive(way)), SPEC)
    assert (result.success, result.cause, result.failure) == (False, None, "error")
    assert result.error is not None
    assert result.error.startswith("Traceback")
    assert last in result.error.splitlines()[-1]


def test_an_episode_keeps_the_scenario_it_was_given_but_for_the_seed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bounds = Watchdog(time_limit=5.0, links_force_max=3.0)
    given = ClassicalStack.scenario
    monkeypatch.setattr(
        ClassicalStack, "scenario", lambda *chosen: replace(given(*chosen), watchdog=bounds)
    )
    scenario = episode().scenario(7)
    assert (scenario.seed, scenario.watchdog) == (7, bounds)


def test_the_classical_stack_drives_by_default() -> None:
    assert episode().driver is ProgramDriver
    assert not episode().foreign


def test_a_policy_is_found_in_a_module_and_in_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = PolicyReference(text=f"{TOYS}:GoodPolicy")
    assert module.absolute == module
    assert module.digest is not None
    path = tmp_path / "mine.py"
    path.write_text(
        "class Mine:\n    def reset(self, observation): pass\n"
        "    def act(self, observation): return 2 * observation\n"
    )
    monkeypatch.chdir(tmp_path)
    near = PolicyReference(text="mine.py:Mine")
    far = near.absolute
    monkeypatch.chdir("/")
    assert far.load() == [str(path)]
    assert len(far.digest or "") == 64
    assert far.digest != module.digest


def test_what_a_policy_imports_from_beside_it_is_part_of_it(tmp_path: Path) -> None:
    (tmp_path / "beside_it.py").write_text("SPEED = 1")
    (tmp_path / "mine.py").write_text(
        "import beside_it\nclass Mine:\n    def reset(self, o): pass\n    def act(self, o): pass\n"
    )

    def digest() -> str | None:
        return PolicyReference(text=f"{tmp_path}/mine.py:Mine").digest

    before = digest()
    assert digest() == before
    (tmp_path / "beside_it.py").write_text("SPEED = 2")
    assert digest() != before


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("nothing", "names no place and class"),
        ("module:not a name", "names no place and class"),
        (f"{TOYS}:Missing", f"{TOYS} has no Missing"),
        ("no_such_module:Policy", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("/no/such/file.py:Policy", "FileNotFoundError"),
        (f"{TOYS}:NoPolicy", "it has no act"),
        (f"{TOYS}:NeedyPolicy", "it cannot be made without arguments: .* 'weights'"),
        (f"{TOYS}:dataclass", "it has no reset and no act"),
    ],
)
def test_a_policy_that_cannot_be_had_is_refused(text: str, why: str) -> None:
    with pytest.raises(ClassLoadError, match=f"{why}(.|\n)*Name it module:Class or file.py:Class"):
        PolicyReference(text=text).load()


def test_a_file_that_raises_is_told(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text("1 / 0")
    with pytest.raises(ClassLoadError, match="ZeroDivisionError"):
        PolicyReference(text=f"{tmp_path}/bad.py:Policy").load()


def test_a_policy_that_cannot_be_made_fails_its_episode() -> None:
    unmakeable = PolicyReference(text=f"{TOYS}:UnmakeablePolicy")
    result = episode(driver=unmakeable.driver, foreign=True)(SPEC)
    assert (result.cause, result.error) == ("limit", None)


def test_what_the_audit_does_not_judge_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    judged = Finding(signal="a", unit="m", limit=1.0, extreme=0.5, time=0.0, ok=True)
    exempt = replace(judged, signal="b, exempt", exempt="it presses", share=0.25)
    monkeypatch.setattr(task_episode, "audit", lambda _: [judged, exempt])
    result = episode()(SPEC)
    assert [(one["signal"], one["share"]) for one in result.exempt] == [("b, exempt", 0.25)]
    assert EpisodeResult.of_entry(json.loads(json.dumps(result.entry()))) == result
