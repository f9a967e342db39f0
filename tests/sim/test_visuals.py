"""Menagerie's meshes change the looks and not one bit of the physics."""

import os
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import pytest

from robo47_qp.errors import MissingExtraError, ModelError, UnknownNameError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.runner import Runner
from robo47_qp.sim.simulation import Simulation
from robo47_qp.sim.visuals import with_menagerie_looks
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.robots import robot_or_skip
from tests.runs import make_runner, no_objects, picked_and_placed

installed = pytest.mark.skipif(
    find_spec("mujoco_menagerie") is None,
    reason="mujoco_menagerie is not installed: pip install '.[visuals]'",
)


@pytest.fixture
def checkout() -> Path:
    root = os.environ.get("MENAGERIE_ROOT")
    if root is None:
        pytest.skip("MENAGERIE_ROOT does not name a checkout of MuJoCo Menagerie")
    return Path(root)


@installed
def test_signals_are_the_same_bits_with_and_without_meshes(checkout: Path) -> None:
    task = PickPlace()
    dressed = Simulation(PANDA, with_menagerie_looks(PANDA, task.build_scene))
    plain, _ = make_runner(task)
    run = Runner(plain.scenario, dressed).run()
    assert run.rows.values.tobytes() == picked_and_placed().rows.values.tobytes()


@installed
def test_meshes_take_the_place_of_all_primitive_looks(checkout: Path) -> None:
    model = Simulation(PANDA, with_menagerie_looks(PANDA, no_objects)).model
    plain = Simulation(PANDA, no_objects).model
    looks = model.geom_group == 2
    assert looks.any()
    assert (model.geom_type[looks] == mujoco.mjtGeom.mjGEOM_MESH).all()
    assert not model.geom_contype[looks].any()
    assert not model.geom_conaffinity[looks].any()
    dressed = {model.body(b).name for b in np.unique(model.geom_bodyid[looks])}
    assert dressed >= {f"link{i}" for i in range(8)} | {"hand", "left_finger", "right_finger"}
    for name in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_armature"):
        np.testing.assert_array_equal(getattr(model, name), getattr(plain, name))


def test_a_place_without_menagerie_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    with pytest.raises(ModelError, match=r"franka_emika_panda/panda cannot .*MENAGERIE_ROOT"):
        with_menagerie_looks(PANDA, no_objects)


def test_a_robot_that_is_menageries_own_keeps_its_looks() -> None:
    robot = robot_or_skip("iiwa14")
    model = Simulation(robot, with_menagerie_looks(robot, no_objects)).model
    assert model.ngeom == Simulation(robot, no_objects).model.ngeom


def test_a_robot_without_a_model_in_menagerie_is_told() -> None:
    with pytest.raises(UnknownNameError, match="No Menagerie model is called 'panda'"):
        with_menagerie_looks(replace(PANDA, menagerie=None), no_objects)


def test_a_missing_package_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    with pytest.raises(MissingExtraError, match=r"needs the package mujoco-menagerie.*\[visuals\]"):
        with_menagerie_looks(PANDA, no_objects)
