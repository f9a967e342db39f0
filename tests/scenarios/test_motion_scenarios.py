import json
from pathlib import Path

import pytest
from rich.console import Console

from robo47_qp.errors import InvalidValueError, RecordingError, UnknownNameError
from scenarios import check_motions, compare_profiles

QUIET = Console(quiet=True)


def test_random_motions_keep_their_promises_and_refusals_hold(tmp_path: Path) -> None:
    out = tmp_path / "check.json"
    options = check_motions.CheckOptions(n=2, ptp=10, seed=3, report=out)
    assert check_motions.run(options, QUIET) == 0
    summary = json.loads(out.read_text())["figures"]
    assert set(summary) == {f"panda {kind}" for kind in check_motions.KINDS}
    for kind in ("LIN", "CIRC", "blended", "via"):
        found = summary[f"panda {kind}"]
        assert found["planned"] + sum(found["refused"].values()) == 2
        assert found["planned"] > 0
        assert found["off_m"] < 10e-6
    assert sum(sum(found["refused"].values()) for found in summary.values()) > 0
    assert summary["panda PTP"]["duration_per_bound_median"] < 1.01


def test_an_unknown_robot_is_refused_before_anything_is_planned(tmp_path: Path) -> None:
    options = check_motions.CheckOptions(robots=("panda", "nobody"), report=tmp_path / "check.json")
    with pytest.raises(UnknownNameError, match=r"No robot is called 'nobody'; known: .*panda"):
        check_motions.run(options, QUIET)


def test_profiles_differ_in_what_they_are_compared_for(tmp_path: Path) -> None:
    out = tmp_path / "profiles.json"
    assert compare_profiles.run(compare_profiles.ProfileOptions(report=out), QUIET) == 0
    assert out.with_suffix(".png").stat().st_size > 10_000
    found = json.loads(out.read_text())
    times = {name: row["duration_s"] for name, row in found.items()}
    assert times["trapezoid"] < times["cubic"] < times["S-curve"] < times["quintic"]
    for name, row in found.items():
        smooth = name in ("quintic", "S-curve")
        assert (row["peak_jerk_rad_s3"] < 10.001) == smooth
        assert (row["peak_torque_rate_Nm_s"] < 100.0) == smooth
        assert row["peak_tool_error_mm"] < 0.2


def test_at_equal_time_none_is_slower_than_another(tmp_path: Path) -> None:
    out = tmp_path / "profiles.json"
    options = compare_profiles.ProfileOptions(report=out, equal_time=True)
    compare_profiles.run(options, QUIET)
    times = [row["duration_s"] for row in json.loads(out.read_text()).values()]
    assert max(times) - min(times) < 5e-3


def test_profiles_refuse_files_and_paces_before_anything_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compare_profiles, "tried", None)
    with pytest.raises(InvalidValueError, match=r"--report must be a file that ends with \.json"):
        compare_profiles.ProfileOptions(report=tmp_path / "figures.txt")
    with pytest.raises(InvalidValueError, match="--speed must be above 0 and at most 1; found 7"):
        compare_profiles.ProfileOptions(speed=7.0)
    for taken in ("figures.json", "figures.png"):
        (tmp_path / taken).mkdir()
        with pytest.raises(RecordingError, match=rf"{taken} cannot be written"):
            compare_profiles.run(
                compare_profiles.ProfileOptions(report=tmp_path / "figures.json"), QUIET
            )
        (tmp_path / taken).rmdir()
