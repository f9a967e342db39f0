"""The front door: what `import robo47_qp` offers, and what it costs."""

import subprocess
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import pytest

import robo47_qp
from robo47_qp.__main__ import _COMMANDS, main
from robo47_qp.evaluation.benchmarks.ik import command as compare

HEAVY = ("numpy", "mujoco", "mink", "scipy", "rerun", "matplotlib", "gymnasium", "tyro", "rich")


@pytest.mark.parametrize("name", robo47_qp.__all__)
def test_every_name_is_there_and_is_what_its_module_defines(name: str) -> None:
    found = getattr(robo47_qp, name)
    home = robo47_qp._HOMES[name]
    assert found is getattr(import_module(home), name)
    assert found.__module__ == home or name == "SE3"
    assert name in dir(robo47_qp)


def test_the_names_are_few() -> None:
    assert set(robo47_qp.__all__) == set(robo47_qp._HOMES)
    assert len(robo47_qp.__all__) <= 30


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'robo47_qp' has no attribute 'Magic'"):
        robo47_qp.Magic  # noqa: B018


SPARED = {
    "robo47_qp": HEAVY,
    "robo47_qp.run.policy.wire": ("mujoco", "mink", "scipy"),
    "robo47_qp.evaluation.task_episode": ("rerun", "matplotlib", "scipy.stats"),
    "robo47_qp.evaluation.evaluate": ("rerun", "matplotlib", "scipy.stats"),
    "robo47_qp.cli": ("rerun", "matplotlib"),
}
"""What is not imported by the start of a user's program, the process of a policy, a worker, an
evaluation and a run; each is imported after those above it."""


def test_nothing_heavy_is_imported_before_it_is_used() -> None:
    code = (
        "import sys\nfrom importlib import import_module\n"
        f"for start, spared in {SPARED}.items():\n"
        "    import_module(start)\n"
        "    print(start, *(name for name in spared if name in sys.modules))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == list(SPARED)


def test_a_task_after_options_is_told_to_come_first(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--robot", "ur5e", "pick_place"]) == 2
    told = "error: the task comes first: robo47 run pick_place --robot ur5e\n"
    assert capsys.readouterr().err == told


def test_a_task_option_without_a_name_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["run", "--task"])
    assert capsys.readouterr().err.count("error: argument --task: expected one argument") == 1


def test_ctrl_c_before_a_command_has_begun_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(_: Sequence[str]) -> int:
        raise KeyboardInterrupt

    monkeypatch.setitem(_COMMANDS, "run", lambda: interrupted)
    assert main(["run"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_a_second_task_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["run", "pick_place", "--task", "stack"])
    assert "Unrecognized options: --task, stack" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["run", "pick_place"], ["evaluate"], ["compare-ik"]])
def test_help_names_values_and_not_what_is_left_out(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="0"):
        main([*command, "--help"])
    told = capsys.readouterr().out
    assert "--" in told
    assert "None" not in told


def test_the_help_of_an_evaluation_begins_with_the_task(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["evaluate", "--help"])
    told = capsys.readouterr().out
    assert told.index("--task") < told.index("--robot") < told.index("--noise-q")


def test_files_of_figures_are_called_report_everywhere() -> None:
    """A folder of demonstrations and a page of Markdown are none."""
    scripts = (Path(__file__).resolve().parents[1] / "scenarios").glob("*.py")
    others = {"record_demos", "retro"}
    found = {one.stem for one in scripts if "    out: " in one.read_text(encoding="utf-8")}
    assert found == others


@pytest.mark.parametrize("plain", [True, False])
def test_messages_on_usage_respect_no_color(
    plain: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.delenv("NO_COLOR", raising=False)
    if plain:
        monkeypatch.setenv("NO_COLOR", "1")
    with pytest.raises(SystemExit, match="2"):
        main(["run", "reach", "--nope", "3"])
    told = capsys.readouterr()
    assert ("\x1b[" not in told.out + told.err) == plain


def test_a_peer_that_is_not_installed_is_named_with_its_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    missing = {"drake": "DrakeIk needs the package drake, which is not installed."}
    monkeypatch.setattr(compare, "peers", lambda: ({}, missing))
    asked = ["--peers", "--solvers", "drake", "--log", str(tmp_path / "ik.rrd")]
    assert main(["compare-ik", *asked]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "--solvers must be one that is installed; DrakeIk needs the package drake" in told
