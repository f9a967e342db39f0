"""Robustness: kinds from the one definition, where half is lost, journals, table and picture."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from robo47_qp.errors import InvalidValueError, RecordingError, UnknownNameError
from robo47_qp.evaluation.benchmarks.robustness.curves import (
    STACKS,
    Curve,
    NothingJudgedError,
    Point,
    Robustness,
    alone,
    kinds,
)
from robo47_qp.evaluation.episode import (
    Episode,
    EpisodeResult,
    EpisodeSpec,
    errored,
    failed,
)
from robo47_qp.evaluation.evaluation import PolicyEvaluation
from robo47_qp.evaluation.perturbation import Perturbation
from robo47_qp.files import claimed
from robo47_qp.run.failure import Cause, Failure
from scenarios import robustness
from scenarios.robustness import RobustnessOptions


def test_every_kind_changes_the_world_in_one_thing_at_all_levels() -> None:
    nothing, seen, changed = Perturbation(), set[str](), set[str]()
    for kind, (_, growth, text) in kinds().items():
        values = growth.levels(8)
        assert len(values) >= 4, kind
        assert text
        rises = np.diff(values) > 0.0
        assert rises.all() or not rises.any()
        for value in values:
            world = alone(kind, value)
            changed = {
                f.name for f in fields(world) if getattr(world, f.name) != getattr(nothing, f.name)
            }
            assert len(changed - {name for name, _ in growth.beside}) == 1, kind
        seen |= changed
    # What is left out says nothing alone: a rate, a filter, a time, a share of another error.
    rest = {f.name for f in fields(nothing)} - seen
    assert rest == {
        *("velocity_cutoff", "pose_noise_time", "camera_rate", "outlier_size", "occlusion"),
        *("wrist_friction", "push_time"),
    }


def test_the_world_of_each_kind_is_drawn_differently() -> None:
    plain = Perturbation().draw(np.random.default_rng(0))
    for kind, (_, growth, _) in kinds().items():
        world = alone(kind, growth.first).draw(np.random.default_rng(0))
        differs = [
            f.name
            for f in fields(plain)
            if not np.array_equal(getattr(plain, f.name), getattr(world, f.name))
        ]
        assert differs, kind


def test_unknown_kinds_and_senseless_values_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="gravity"):
        alone("gravity", 1.0)
    with pytest.raises(InvalidValueError):
        alone("dropped_frames", 1.5)


def curve(kind: str, *rates: tuple[float | None, float]) -> Curve:
    points = [
        Point(value=value, successes=round(100 * rate), episodes=100, causes={}, audits_kept=0)
        for value, rate in rates
    ]
    return Curve(stack="stack", kind=kind, points=points)


def test_half_is_lost_on_the_line_between_two_levels() -> None:
    assert curve("pose_bias", (None, 1.0), (1.0, 0.9), (2.0, 0.8), (4.0, 0.2)).half == 3.0
    assert curve("pose_bias", (None, 0.8), (1.0, 0.6), (2.0, 0.2)).half == pytest.approx(1.5)
    assert curve("pose_bias", (None, 1.0), (1.0, 0.0)).half == pytest.approx(0.5)
    assert curve("pose_bias", (None, 1.0), (1.0, 0.9), (2.0, 0.51)).half is None
    # Less is worse: 0.6, 0.4.
    assert curve("friction", (None, 1.0), (0.6, 0.8), (0.4, 0.2)).half == pytest.approx(0.5)
    assert curve("friction", (None, 1.0), (0.6, 0.3)).half == 0.6


def test_what_a_table_tells_of_a_curve() -> None:
    assert curve("pose_bias", (None, 1.0), (1.0, 0.9), (2.0, 0.0)).half_told == "1.44"
    assert curve("pose_bias", (None, 1.0), (1.0, 0.9)).half_told == "> 1"
    assert curve("friction", (None, 1.0), (0.6, 0.9)).half_told == "< 0.6"
    assert curve("friction", (None, 0.0)).half_told == "–"


@dataclass(frozen=True)
class Fragile:
    """Succeeds while what is wrong is small: pose_bias below 3 mm."""

    world: Perturbation
    foreign: bool = False

    def __call__(self, spec: EpisodeSpec) -> EpisodeResult:
        if self.world.pose_bias < 3e-3:
            return EpisodeResult(index=spec.index, seed=spec.seed, success=True, audit_ok=True)
        return failed(spec, Failure(cause=Cause.GRASP, evidence="bias"))


class Serial:
    """Runs episodes here, and counts them."""

    workers, count = 1, 0

    def run(self, episode: Episode, specs: Sequence[EpisodeSpec]) -> Iterator[EpisodeResult]:
        for spec in specs:
            Serial.count += 1
            yield episode(spec)


def test_a_campaign_ends_where_half_is_lost_and_is_continued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PolicyEvaluation, "_episode", lambda self: Fragile(self.perturbation))
    monkeypatch.setattr(PolicyEvaluation, "executor", property(lambda _: Serial()))
    Serial.count = 0
    out = tmp_path / "curves.json"
    chosen: dict[str, Any] = {
        "kinds": ("pose_bias", "friction"),
        "stacks": ("stack", "dls"),
        "episodes": 3,
        "levels": 5,
        "report": out,
    }
    screen = StringIO()
    assert robustness.run(RobustnessOptions(**chosen), Console(file=screen, width=80)) == 0
    told = json.loads(out.read_text())
    by_name = {(one["stack"], one["kind"]): one for one in told["curves"]}
    lost = by_name["stack", "pose_bias"]
    assert [point["value"] for point in lost["points"]] == [None, 1e-3, 2e-3, 4e-3]
    assert lost["half_is_lost_at"] == pytest.approx(3e-3)
    assert lost["points"][-1]["causes"] == {"grasp": 3}
    kept = by_name["dls", "friction"]
    assert kept["half_is_lost_at"] is None
    assert len(kept["points"]) == 6
    assert [Curve.from_json(one).half for one in told["curves"]] == [
        one["half_is_lost_at"] for one in told["curves"]
    ]
    assert {"command", "commit", "date", "machine", "versions"} <= told.keys()
    assert out.with_suffix(".png").read_bytes()[:4] == b"\x89PNG"
    lines = screen.getvalue().splitlines()
    assert any("pose_bias, m" in line and "0.003" in line for line in lines)
    assert any("friction" in line and "< 0.15" in line for line in lines)
    # Once nothing, three and five levels, for two stacks; nothing again where it is continued.
    assert Serial.count == 2 * 3 * (1 + 3 + 5)
    before = out.read_text()
    again = RobustnessOptions(**chosen, resume=True)
    assert robustness.run(again, Console(quiet=True)) == 0
    assert Serial.count == 2 * 3 * (1 + 3 + 5)
    assert json.loads(out.read_text())["curves"] == json.loads(before)["curves"]


@dataclass(frozen=True)
class Buggy(Fragile):
    """Ends with an internal error in some worlds, for some seeds."""

    broken: tuple[int, ...] = ()

    def __call__(self, spec: EpisodeSpec) -> EpisodeResult:
        if self.world.pose_bias > 1.5e-3 and spec.seed in self.broken:
            return errored(spec, "ZeroDivisionError: a bug of ours")
        return super().__call__(spec)


def test_an_internal_error_is_no_loss_of_the_stack(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two of three episodes: half were lost if they counted."""
    broken = [0, 1]
    monkeypatch.setattr(
        PolicyEvaluation, "_episode", lambda self: Buggy(self.perturbation, broken=tuple(broken))
    )
    monkeypatch.setattr(PolicyEvaluation, "executor", property(lambda _: Serial()))
    out, screen = tmp_path / "curves.json", StringIO()
    options = RobustnessOptions(
        kinds=("pose_bias",), stacks=("stack",), episodes=3, levels=3, seed=0, report=out
    )
    assert robustness.run(options, Console(file=screen, width=80)) == 1
    assert "stack: pose_bias 0.002 m: 1 of 1, internal errors 2" in screen.getvalue()
    (told,) = json.loads(out.read_text())["curves"]
    assert [point["errors"] for point in told["points"]] == [0, 0, 2, 2]
    assert [point["episodes"] for point in told["points"]] == [3, 3, 1, 1]
    assert told["half_is_lost_at"] == pytest.approx(3e-3)
    assert told["points"][-1]["causes"] == {"grasp": 1}
    broken.append(2)
    with pytest.raises(
        NothingJudgedError,
        match=r"pose_bias\.0\.002\.jsonl was judged: .* ZeroDiv.*a bug of ours\.",
    ):
        robustness.run(options, Console(quiet=True))


@pytest.mark.parametrize("name", ["campaign", "campaign.png"])
def test_a_report_of_another_ending_is_refused_before_anything_runs(name: str) -> None:
    """Without one, it had the name of the folder of journals; the picture is another file."""
    with pytest.raises(InvalidValueError, match=r"--report must be a file that ends with \.json"):
        RobustnessOptions(report=Path(name))


def test_a_first_look_replaces_no_campaign() -> None:
    assert RobustnessOptions().file == Path("logs/robustness.json")
    assert RobustnessOptions(quick=True).file == Path("logs/robustness_quick.json")
    assert RobustnessOptions(quick=True, report=Path("a.json")).file == Path("a.json")


def test_a_campaign_that_is_running_is_not_disturbed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Robustness, "run", lambda *_, **__: pytest.fail("it has begun"))
    options = RobustnessOptions(report=tmp_path / "x.json")
    with claimed(tmp_path / "x.json"), pytest.raises(RecordingError, match="another process"):
        robustness.run(options, Console(quiet=True))


def test_a_task_is_done_by_the_robot_that_it_is_made_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robots: list[str] = []

    def noted(campaign: Robustness, *_: object, **__: object) -> list[Curve]:
        robots.append(campaign.robot.name)
        raise KeyboardInterrupt

    monkeypatch.setattr(Robustness, "run", noted)
    for task in ("handover", "reach"):
        options = RobustnessOptions(task=task, report=tmp_path / f"{task}.json")
        assert robustness.run(options, Console(quiet=True)) == 130
    assert robots == ["panda_pair", "panda"]


def test_wrong_names_are_refused_before_anything_runs(tmp_path: Path) -> None:
    for wrong in ({"kinds": ("gravity",)}, {"stacks": ("ppo",)}):
        options = RobustnessOptions(report=tmp_path / "x.json", **wrong)  # type: ignore[arg-type]
        with pytest.raises(UnknownNameError):
            robustness.run(options, Console(quiet=True))


def test_the_stacks_differ_in_what_their_names_say() -> None:
    assert STACKS["no-observer"].observer is None
    assert STACKS["dls"].observer == STACKS["stack"].observer
    assert (STACKS["dls"].ik, STACKS["dls-single"].ik) == ("dls", "dls-single")
