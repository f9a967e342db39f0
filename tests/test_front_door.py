"""The front door: what `import robo47_qp` offers, and what it costs."""

import subprocess
import sys
from importlib import import_module

import pytest

import robo47_qp
from robo47_qp.__main__ import main

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


def test_the_import_alone_loads_nothing_heavy() -> None:
    code = f"import robo47_qp, sys; print([n for n in {HEAVY} if n in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_task_option_without_a_name_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["run", "--task"])
    assert capsys.readouterr().err.count("error: argument --task: expected one argument") == 1
