"""JSON files: what is written comes back to the last bit; what is not there is told."""

import errno
from pathlib import Path

import numpy as np
import pytest

from robo47_qp.errors import RecordingError
from robo47_qp.files import claimed, plain, read_json, write_json


def test_every_bit_comes_back(tmp_path: Path, rng: np.random.Generator) -> None:
    numbers = (rng.standard_normal(1000) * 10.0 ** rng.integers(-300, 300, 1000)).tolist()
    path = tmp_path / "some" / "new" / "folder" / "figures.json"
    write_json(path, {"µ": numbers, "none": None})
    assert read_json(path, "") == {"µ": numbers, "none": None}


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_no_number_is_not_written(tmp_path: Path, bad: float) -> None:
    path = tmp_path / "figures.json"
    with pytest.raises(RecordingError, match=r"figures\.json must hold finite numbers"):
        write_json(path, {"a": [bad]})
    assert not path.exists()


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(RecordingError, match=r"taken/a\.json cannot be written: "):
        write_json(tmp_path / "taken" / "a.json", {})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "cannot be read: No such file.*Make it."),
        ("{", "does not hold JSON: .*Make it."),
        ("[1]", "must hold an object; found a list. Make it."),
    ],
)
def test_what_cannot_be_read_is_told_with_its_remedy(
    tmp_path: Path, text: str | None, message: str
) -> None:
    path = tmp_path / "figures.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(RecordingError, match=f"figures.json {message}"):
        read_json(path, "Make it.")


def test_text_that_is_no_utf_8_is_escaped_and_the_file_whole(tmp_path: Path) -> None:
    path = tmp_path / "figures.json"
    write_json(path, {"command": "robo47 \udcff"})
    assert read_json(path, "") == {"command": "robo47 \udcff"} or "udcff" in path.read_text()


def test_settings_are_told_whole() -> None:
    given = {"a": np.int64(3), "b": np.bool_(True), "c": Path("x/y"), "d": {1: np.float64(0.5)}}
    assert plain(given) == {"a": 3, "b": True, "c": "x/y", "d": {"1": 0.5}}


def test_a_file_system_without_locks_is_not_another_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fcntl = pytest.importorskip("fcntl")

    def none(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", none)
    told = pytest.raises(RecordingError, match="No locks available")
    with told, claimed(tmp_path / "run.rrd"):
        pass
