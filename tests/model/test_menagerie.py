"""Files of MuJoCo Menagerie are found on this machine, or it is told where they were missed."""

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from robo47_qp.errors import InvalidValueError, MenagerieError, MissingExtraError
from robo47_qp.model.menagerie import menagerie_file
from robo47_qp.model.robots.iiwa14 import iiwa14
from robo47_qp.model.robots.xarm7 import xarm7


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    (tmp_path / "maker_arm").mkdir()
    for name in ("arm.xml", "scene.xml"):
        (tmp_path / "maker_arm" / name).write_text("<mujoco/>")
    return tmp_path


class FetchError(Exception):
    pass


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package that has one model and no network."""

    def get(directory: str) -> SimpleNamespace:
        if directory != "maker_arm":
            raise FetchError("no network")
        return SimpleNamespace(path=lambda: str(tmp_path / directory))

    fake = ModuleType("mujoco_menagerie")
    vars(fake).update(get=get, MenagerieError=FetchError)
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", fake)
    (tmp_path / "maker_arm").mkdir()
    (tmp_path / "maker_arm" / "arm.xml").write_text("<mujoco/>")
    return tmp_path


def test_a_checkout_is_used_before_the_package(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    assert menagerie_file("maker_arm/arm") == checkout / "maker_arm" / "arm.xml"


def test_without_a_checkout_the_package_is_asked(package: Path) -> None:
    assert menagerie_file("maker_arm/arm") == package / "maker_arm" / "arm.xml"


def test_a_model_that_cannot_be_fetched_is_told(package: Path) -> None:
    with pytest.raises(MenagerieError, match=r"other/arm .*package.*no network\. Set MENAGERIE"):
        menagerie_file("other/arm")


def test_a_missing_file_is_told_with_those_that_are_there(checkout: Path) -> None:
    with pytest.raises(MenagerieError, match=r"no hand\.xml; models there: arm, scene") as caught:
        menagerie_file("maker_arm/hand")
    assert caught.value.model == "maker_arm/hand"
    assert caught.value.looked_in == str(checkout / "maker_arm")


def test_neither_checkout_nor_package_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    with pytest.raises(MissingExtraError, match=r"MENAGERIE_ROOT names no checkout.*\[visuals\]"):
        menagerie_file("maker_arm/arm")


@pytest.mark.parametrize("bad", ["", "arm", "/arm", "maker/", "a/b/c", "../etc/arm", "a/.."])
def test_a_name_that_is_no_directory_and_file_is_refused(bad: str) -> None:
    with pytest.raises(InvalidValueError, match="Menagerie model must be of the form"):
        menagerie_file(bad)


@pytest.mark.parametrize("make", [iiwa14, xarm7])
def test_a_robot_whose_model_is_missing_says_which(
    make: type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    with pytest.raises(MenagerieError, match=r"(kuka_iiwa_14/iiwa14|ufactory_xarm7/xarm7_nohand) "):
        make()
