from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from robo47_qp.collision.pairs import GeomPairs
from robo47_qp.errors import InvalidValueError, ModelError
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robots.panda import PANDA
from tests.small_robots import at, cell, small_robot

CHAIN = """
<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body name="base">
  <geom name="plinth" size="0.05" pos="0 0 -0.2" {base}/>
  <body name="upper"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
    <joint name="a" axis="0 1 0" range="-1 1"/>
    <geom name="upper0" size="0.05" {upper}/><geom name="upper1" size="0.05" pos="0 0 0.2"/>
    <body name="fore" pos="0 0 0.3"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
      <joint name="b" axis="0 1 0" range="-2.9 2.9"/>
      <geom name="fore0" size="0.06"/><geom name="fore1" size="0.05" pos="0 0 0.2"/>
      <body name="wrist"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
        <joint name="c" axis="0 0 1" range="-1 1"/>
        <geom name="wrist0" size="0.055" pos="0 0 -0.02"/><site name="tool"/>
</body></body></body></body></worldbody>{more}</mujoco>
"""
EXCLUDE = '<contact><exclude body1="wrist" body2="base"/></contact>'


def chain(folder: Path, *, base: str = "", upper: str = "", more: str = "") -> Arm:
    mjcf = CHAIN.format(base=base, upper=upper, more=more)
    return Arm(small_robot(folder, mjcf, ("a", "b", "c")))


def by_name(arm: Arm, pairs: list[tuple[int, int]]) -> set[tuple[str, str]]:
    return {(arm.model.geom(a).name, arm.model.geom(b).name) for a, b in pairs}


def reasons(arm: Arm, pairs: GeomPairs) -> dict[tuple[str, str], str]:
    return {
        (arm.model.geom(out.geoms[0]).name, arm.model.geom(out.geoms[1]).name): out.reason
        for out in pairs.left_out
    }


def test_every_pair_that_moves_is_kept_or_named(tmp_path: Path) -> None:
    arm = chain(tmp_path)
    pairs = GeomPairs.of(arm, 0.02)
    kept, out = by_name(arm, list(pairs.kept)), reasons(arm, pairs)
    own = {"plinth": 0, "upper0": 1, "upper1": 1, "fore0": 2, "fore1": 2, "wrist0": 3}
    moving = {(a, b) for a, b in combinations(own, 2) if own[a] != own[b]}
    assert kept | set(out) == moving
    assert not kept & set(out)


def test_neighbours_that_cover_their_joint_are_left_out_and_others_are_not(tmp_path: Path) -> None:
    arm = chain(tmp_path)
    pairs = GeomPairs.of(arm, 0.02)
    kept, out = by_name(arm, list(pairs.kept)), reasons(arm, pairs)
    # 0.1 m between centres of radii 0.05 and 0.06: they overlap by 10 mm at home.
    assert out["upper1", "fore0"] == "neighbours, -10.0 mm apart at home"
    # The forearm can fold back upon the upper arm, its parent.
    assert ("upper1", "fore1") in kept
    # The first moving link can be turned towards the base, its parent, which stands in the world.
    assert {("plinth", "upper0"), ("plinth", "upper1")} <= kept


def test_links_that_are_no_neighbours_are_left_out_only_if_never_apart(tmp_path: Path) -> None:
    arm = chain(tmp_path)
    # Centres 0.08 m apart at home and 0.12 m when folded, radii 0.05 and 0.055: at best 15 mm.
    kept = by_name(arm, list(GeomPairs.of(arm, 0.01).kept))
    assert ("upper1", "wrist0") in kept
    out = reasons(arm, GeomPairs.of(arm, 0.02))
    assert out["upper1", "wrist0"].startswith("never seen further apart than 1")


def test_an_obstacle_is_kept_against_every_moving_link_however_close() -> None:
    """The first link among them: MuJoCo counts the world as its parent."""
    slab = Obstacle(name="slab", shape=Shape.BOX, size=(1, 1, 0.4))
    arm = Arm(PANDA, obstacles=[slab])
    pairs = GeomPairs.of(arm, 0.01)
    bodies = {a for a, b in pairs.names if b == "slab"}
    assert bodies == {f"link{i}" for i in range(1, 8)} | {"hand", "left_finger", "right_finger"}
    assert not [out for out in pairs.left_out if "slab" in out.names]
    assert not [names for names in pairs.names if "link0" in names and "slab" in names]


def test_what_the_model_rules_out_is_named(tmp_path: Path) -> None:
    arm = chain(tmp_path, upper='contype="2" conaffinity="4"', more=EXCLUDE)
    out = reasons(arm, GeomPairs.of(arm, 0.0))
    assert out["plinth", "wrist0"] == "excluded by the model"
    assert out["upper0", "wrist0"] == "contype and conaffinity of the model"
    assert out["plinth", "upper0"] == "contype and conaffinity of the model"
    among = Arm(arm.robot, obstacles=[Obstacle(name="ball", shape=Shape.SPHERE, size=(0.1,))])
    assert ("upper", "ball") in GeomPairs.of(among, 0.0).names


def test_geoms_without_any_bit_are_not_looked_at(tmp_path: Path) -> None:
    arm = chain(tmp_path, base='contype="0" conaffinity="0"')
    pairs = GeomPairs.of(arm, 0.0)
    every = by_name(arm, list(pairs.kept)) | set(reasons(arm, pairs))
    assert not [names for names in every if "plinth" in names]


def test_nothing_to_keep_apart_is_an_error(tmp_path: Path) -> None:
    bare = CHAIN.format(base="", upper="", more="").replace("<geom ", '<geom contype="0" ')
    arm = Arm(
        small_robot(tmp_path, bare.replace("<geom ", '<geom conaffinity="0" '), ("a", "b", "c"))
    )
    with pytest.raises(ModelError, match="should keep 10 mm of clearance, but none"):
        GeomPairs.of(arm, 0.01)


@pytest.mark.parametrize("clearance", [-1e-3, np.nan, np.inf])
def test_a_clearance_is_a_finite_length(arm: Arm, clearance: float) -> None:
    with pytest.raises(InvalidValueError, match="clearance must be 0 or more and finite"):
        GeomPairs.of(arm, clearance)


def test_pairs_are_sorted_and_the_same_each_time() -> None:
    first, second = (GeomPairs.of(Arm(PANDA, obstacles=cell()), 0.01) for _ in range(2))
    assert first.kept == second.kept == tuple(sorted(first.kept))
    assert all(a < b for a, b in first.kept)
    assert first.names == second.names
    assert first.left_out == second.left_out
    assert len(first.names) == len(first.kept) > 300


def test_names_are_those_of_links_and_obstacles() -> None:
    arm = Arm(
        PANDA,
        obstacles=[
            Obstacle(name="ball", shape=Shape.SPHERE, size=(0.1,), T_world_obstacle=at(0.5, 0, 0.5))
        ],
    )
    names = GeomPairs.of(arm, 0.01).names
    assert ("hand", "ball") in names
    assert ("link0", "hand") in names
    assert not [pair for pair in names if pair[0] == "ball"]
