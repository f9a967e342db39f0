"""Demonstrations: state, action and picture of one instant, written and read back by LeRobot."""

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console

from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError, MissingExtraError, UnknownNameError
from scenarios import record_demos
from scenarios.record_demos import DemoOptions, Frames, columns, run
from tests.report.test_video import opengl  # noqa: F401  # a fixture
from tests.runs import Reach, carry_out, picked_and_placed


class Counter:
    """A camera whose pictures say how many it has taken."""

    taken = 0

    def picture(self, data: object) -> NDArray[np.uint8]:
        self.taken += 1
        return np.full((2, 2, 3), self.taken, dtype=np.uint8)


def test_pictures_are_taken_when_they_are_due() -> None:
    frames = Frames(Counter())  # type: ignore[arg-type]
    done = carry_out(Reach(), observers=[frames])
    assert len(frames.pictures) == len(frames.rows)
    late = np.array(frames.rows) * TIMESTEP - np.arange(len(frames.rows)) / 30.0
    assert late.min() >= 0.0
    assert late.max() <= 0.020 + 1e-9
    assert len(frames.rows) == pytest.approx(len(done.rows) * TIMESTEP * 30, abs=1)
    assert [int(picture[0, 0, 0]) for picture in frames.pictures[:3]] == [1, 2, 3]


def test_the_action_is_what_is_commanded_for_the_next_frame() -> None:
    done = picked_and_placed()
    rows = [10, 50, 4000, 4033]
    state, action = columns(done, rows)
    assert state.shape == action.shape == (3, 8)
    for k in range(3):
        np.testing.assert_array_equal(state[k, :7], done.rows["joints/q"][rows[k]])
        assert state[k, 7] == done.rows["gripper/width"][rows[k], 0]
        np.testing.assert_array_equal(action[k, :7], done.rows["joints/q_ref"][rows[k + 1]])
        assert action[k, 7] == done.rows["gripper/width_command"][rows[k + 1], 0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"episodes": 0}, "--episodes must be a whole number, 1 or more; found 0"),
        ({"attempts": 3}, "--attempts must be no less than --episodes; found 3"),
        ({"seed": -1}, "--seed must be a whole number, 0 or more"),
        ({"size": (241, 320)}, "--size must be two even numbers from 32 to 1080"),
        ({"size": (16, 320)}, "--size must be two even numbers from 32 to 1080"),
    ],
)
def test_options_that_make_no_sense_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        DemoOptions(**change)  # type: ignore[arg-type]


def test_a_folder_that_is_there_is_not_overwritten(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="--out must be a folder that is not there yet"):
        DemoOptions(out=tmp_path)


def test_before_anything_runs_it_says_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "demos"
    with pytest.raises(UnknownNameError, match="No task is called 'nothing'"):
        run(DemoOptions(task="nothing", out=out), Console())
    monkeypatch.setitem(sys.modules, "lerobot", None)
    monkeypatch.delitem(sys.modules, "lerobot.datasets.lerobot_dataset", raising=False)
    with pytest.raises(MissingExtraError, match=r"needs the package lerobot.*'\.\[lerobot\]"):
        run(DemoOptions(out=out), Console())
    assert not out.exists()


class Held:
    """A dataset that says what was asked of it."""

    def __init__(self, kind: object, options: DemoOptions, robot: object) -> None:
        self.calls: list[str] = []
        options.out.mkdir()

    def add(self, run: object, frames: object) -> None:
        self.calls.append("add")

    def close(self) -> int:
        self.calls.append("close")
        return 7


@pytest.mark.parametrize(
    ("ends", "calls", "code"),
    [
        ([True, False, True], ["add", "add", "close"], 0),
        ([False, True, False, False], ["add", "close"], 1),
        ([True, None], ["add", "close"], None),
        ([False, None], [], None),
        ([False] * 4, [], 1),
    ],
)
def test_what_succeeded_is_kept_and_nothing_else(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    ends: list[bool | None],
    calls: list[str],
    code: int | None,
) -> None:
    """A run of the stack succeeds, fails, or is interrupted (None)."""
    made, following = list[Held](), iter(ends)

    class Stub:
        def __init__(self, *given: object) -> None:
            pass

        def close(self) -> None:
            pass

        def run(self, observers: object) -> SimpleNamespace:
            end = next(following)
            if end is None:
                raise KeyboardInterrupt
            return SimpleNamespace(failure=None if end else SimpleNamespace(evidence="it fell"))

    def dataset(*given: Any) -> Held:
        made.append(Held(*given))
        return made[0]

    monkeypatch.setattr(record_demos, "lerobot_dataset", lambda: None)
    monkeypatch.setattr(record_demos, "OffscreenCamera", Stub)
    monkeypatch.setattr(record_demos, "Runner", Stub)
    monkeypatch.setattr(record_demos, "Dataset", dataset)
    options = DemoOptions(out=tmp_path / "demos", episodes=2)
    console = Console(quiet=True)
    if code is None:
        with pytest.raises(KeyboardInterrupt):
            run(options, console)
    else:
        assert run(options, console) == code
    assert made[0].calls == calls
    assert options.out.exists() == bool(calls)


@pytest.mark.usefixtures("opengl")
@pytest.mark.parametrize("images", [True, False])
def test_lerobot_reads_what_was_written(tmp_path: Path, images: bool) -> None:
    pytest.importorskip("lerobot", reason="LeRobot has an environment of its own")
    options = DemoOptions(out=tmp_path / "demos", episodes=2, size=(64, 96), images=images)
    # It reads the dataset back itself, and raises where that is not what was written.
    assert run(options, Console()) == 0
