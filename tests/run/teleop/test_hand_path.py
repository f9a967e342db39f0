"""Hand paths go through their poses, smoothly, from any start; files are checked."""

from pathlib import Path

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError, RecordingError
from robo47_qp.run.teleop.hand_path import COLUMNS, HandPath, read_hand_path
from scenarios.follow import HAND_PATH

START = SE3.from_rotation_and_translation(
    SO3.exp(np.array([3.0, 0.2, -0.1])), np.array([0.4, 0.1, 0.3])
)


def test_the_path_of_the_scenario_goes_through_its_poses_from_rest_to_rest() -> None:
    path = read_hand_path(HAND_PATH)
    assert 5.0 < path.duration < 20.0
    for k in (0, 50, 200, len(path.times) - 1):
        (pose,) = path.poses([path.times[k]], START)
        gone = pose.translation() - START.translation()
        np.testing.assert_allclose(gone, path.displacements[k], atol=1e-12)
        turned = (pose.rotation() @ START.rotation().inverse()).log()
        np.testing.assert_allclose(turned, path.turns[k], atol=1e-9)
    fine = np.linspace(0.0, path.duration, 20_000)
    p = np.array([pose.translation() for pose in path.poses(fine, START)])
    speed = np.linalg.norm(np.gradient(p, fine, axis=0), axis=1)
    assert speed[0] < 1e-3
    assert speed[-1] < 1e-3
    assert 0.2 < speed.max() < 1.5  # as a hand moves


def test_a_path_stays_at_its_ends() -> None:
    path = HandPath(times=np.array([0.0, 1.0]), displacements=np.eye(3)[:2], turns=np.zeros((2, 3)))
    before, after = path.poses([-1.0, 9.0], START)
    np.testing.assert_allclose(before.translation() - START.translation(), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(after.translation() - START.translation(), [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must begin with the line 't,x,y,z,rx,ry,rz'; found nothing"),
        ("time,x\n0,1\n", "found 'time,x'"),
        (f"{COLUMNS}\n0,0,0,0,0,0,0\n1,2,3\n", "seven numbers in each line"),
        (f"{COLUMNS}\n{','.join('0' * 14)}\n", "seven numbers in each line: 14 in '0,0,0"),
        (COLUMNS + 14 * "\n0", "seven numbers in each line: 1 in '0'"),
        (f"{COLUMNS}\n0,0,0,0,0,0,here\n", "could not convert string to float: 'here'"),
    ],
)
def test_what_is_no_table_of_poses_is_refused(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "path.csv"
    file.write_text(text)
    with pytest.raises(RecordingError, match=message):
        read_hand_path(file)


def test_a_file_that_is_not_there_or_not_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be read: No such file"):
        read_hand_path(tmp_path / "none.csv")
    file = tmp_path / "picture.csv"
    file.write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(RecordingError, match="it is not text"):
        read_hand_path(file)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0,0,0,0,0,0,0", "at least two poses in finite numbers; found 1 poses"),
        ("0,0,0,0,0,0,0\n1,nan,0,0,0,0,0", "finite numbers; found 2 poses, number 1 is"),
        ("1,0,0,0,0,0,0\n2,0,0,0,0,0,0", "increasing from 0 s"),
        ("0,0,0,0,0,0,0\n1,0,0,0,0,0,0\n1,0,0,0,0,0,0", "increasing from 0 s"),
    ],
)
def test_numbers_that_make_no_path_are_refused(rows: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "path.csv"
    file.write_text(f"# told\n{COLUMNS}\n{rows}\n")
    with pytest.raises(InvalidValueError, match=message):
        read_hand_path(file)
