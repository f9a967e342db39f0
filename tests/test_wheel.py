"""The package as it is installed: one name in site-packages, and commands that work anywhere."""

import sys
import sysconfig
from pathlib import Path

import pytest

from tests.wheel import build, environment, install, top_level, try_commands


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("wheel"))


def test_site_packages_gains_one_name(wheel: Path) -> None:
    assert top_level(wheel) == {"robo47_qp"}


@pytest.mark.skipif(sys.platform == "win32", reason="environments are laid out otherwise")
def test_an_installed_package_works_in_an_empty_folder(wheel: Path, tmp_path: Path) -> None:
    pytest.importorskip("gymnasium", reason="the extra gym is not installed")
    python = environment(tmp_path / "env", sys.executable)
    # What is imported is compiled then.
    install(python, "--no-deps", "--no-index", "--no-compile", str(wheel))
    # The dependencies are those of this environment, its editable packages left out.
    (site,) = (tmp_path / "env").glob("lib/python*/site-packages")
    libraries = sysconfig.get_paths()["purelib"]
    (site / "dependencies.pth").write_text(f"{libraries}\n", encoding="utf-8")
    folder = tmp_path / "empty"
    folder.mkdir()
    try_commands(python, folder)
