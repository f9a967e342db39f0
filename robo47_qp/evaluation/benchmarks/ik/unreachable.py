"""Targets that no configuration reaches, and the reasons that solvers should give."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.evaluation.benchmarks.ik.targets import TargetSet
from robo47_qp.evaluation.benchmarks.ik.workspace import Reach, find_reach
from robo47_qp.ik.solver import Reason
from robo47_qp.model.arm import Arm

_NO_ANSWER = {Reason.OUT_OF_REACH.name, Reason.JOINT_LIMITS.name, Reason.NOT_CONVERGED.name}

EXPECTED: dict[str, frozenset[str]] = {
    "too_far": frozenset({Reason.OUT_OF_REACH.name}),
    "just_out": frozenset({Reason.OUT_OF_REACH.name}),
    "below": frozenset({Reason.OUT_OF_REACH.name}),
    "turned_away": frozenset(_NO_ANSWER),
    "inside_base": frozenset(_NO_ANSWER | {"COLLISION"}),
    "nan": frozenset({Reason.INVALID_TARGET.name}),
    "infinite": frozenset({Reason.INVALID_TARGET.name}),
    "no_rotation": frozenset({Reason.INVALID_TARGET.name}),
    "wrong_shape": frozenset({Reason.INVALID_TARGET.name}),
}
"""Names of the correct reasons for each kind of target. Inside the base the tool would collide, if
the joints reach it; a tool that points back from the edge of the workspace needs its wrist
outside."""
HOSTILE = ("nan", "infinite", "no_rotation", "wrong_shape")
"""Kinds that are no pose at all."""

_MARGIN = 1.02
"""Least distance of a target, relative to the farthest point found [-]."""
_LEVER = 0.05
"""Least distance of the wrist from the tool at which poses turned away are made [m]."""
_Make = Callable[[np.random.Generator], SE3]


def unreachable(arm: Arm, n: int, rng: np.random.Generator) -> TargetSet:
    """Return poses that are too far, below the floor, turned away or inside the base, in turn.

    Kinds that an arm has none of are left out: an arm whose wrist is at the tool has no poses
    turned away, and an arm without collision geoms has none inside its base.
    """
    reach = find_reach(arm)
    makers: dict[str, _Make] = {
        "too_far": lambda rng: _at(reach, rng.uniform(1.2, 3.0), rng),
        "just_out": lambda rng: _at(reach, rng.uniform(_MARGIN, 1.1), rng),
        "below": lambda rng: _below(reach, rng),
    }
    if np.linalg.norm(reach.p_tcp_wrist) > _LEVER:
        makers["turned_away"] = lambda rng: _turned_away(reach, rng)
    base = _base_geoms(arm)
    if base:
        makers["inside_base"] = lambda rng: _inside(arm, base, rng)
    return _in_turn("unreachable", n, rng, makers)


def hostile(_arm: Arm, n: int, rng: np.random.Generator) -> TargetSet:
    """Return invalid targets: NaN, infinite, a zero quaternion, an array of a wrong shape."""
    makers: dict[str, _Make] = {
        "nan": lambda rng: _spoilt(np.nan, rng),
        "infinite": lambda rng: _spoilt(np.inf * rng.choice([-1.0, 1.0]), rng),
        "no_rotation": lambda rng: SE3(np.concatenate([np.zeros(4), rng.uniform(size=3)])),
        "wrong_shape": _wrong_shape,
    }
    return _in_turn("hostile", n, rng, makers)


def _in_turn(name: str, n: int, rng: np.random.Generator, makers: dict[str, _Make]) -> TargetSet:
    names = list(makers)
    kinds = [names[k % len(names)] for k in range(n)]
    return TargetSet(
        name=name, targets=[makers[kind](rng) for kind in kinds], reachable=False, kinds=kinds
    )


def _at(reach: Reach, factor: float, rng: np.random.Generator) -> SE3:
    """Return a pose at a multiple of the tool's reach, in a random direction and orientation."""
    position = reach.centre + factor * reach.tool * _direction(rng)
    return SE3.from_rotation_and_translation(_rotation(rng), position)


def _below(reach: Reach, rng: np.random.Generator) -> SE3:
    """Return a pose below the floor and beyond reach, almost straight down."""
    down = np.array([*rng.uniform(-0.2, 0.2, 2), -1.0])
    position = reach.centre + rng.uniform(1.3, 1.8) * reach.tool * down
    return SE3.from_rotation_and_translation(_rotation(rng), position)


def _turned_away(reach: Reach, rng: np.random.Generator) -> SE3:
    """Return a pose within the tool's reach whose wrist would be out of the wrist's reach."""
    while True:
        pose = _at(reach, rng.uniform(0.9, 0.99), rng)
        wrist = pose.apply(reach.p_tcp_wrist)
        if np.linalg.norm(wrist - reach.centre) > _MARGIN * reach.wrist:
            return pose


def _base_geoms(arm: Arm) -> list[int]:
    m = arm.model
    solid = (m.geom_contype != 0) & (m.body_weldid[m.geom_bodyid] == 0)
    return np.flatnonzero(solid).tolist()


def _inside(arm: Arm, geoms: Sequence[int], rng: np.random.Generator) -> SE3:
    """Return a pose deep inside one of the geoms of the base."""
    m = arm.model
    geom = int(rng.choice(geoms))
    local = m.geom_aabb[geom, :3] + rng.uniform(-0.5, 0.5, 3) * m.geom_aabb[geom, 3:]
    body = m.body(int(m.geom_bodyid[geom]))
    T_world_body = _fixed_pose(arm, body.id)
    T_body_geom = SE3(np.concatenate([m.geom_quat[geom], m.geom_pos[geom]]))
    return SE3.from_rotation_and_translation(
        _rotation(rng), T_world_body.apply(T_body_geom.apply(local))
    )


def _fixed_pose(arm: Arm, body: int) -> SE3:
    m, T = arm.model, SE3.identity()
    while body != 0:
        T = SE3(np.concatenate([m.body_quat[body], m.body_pos[body]])) @ T
        body = int(m.body_parentid[body])
    return T


def _spoilt(number: float, rng: np.random.Generator) -> SE3:
    """Return a pose with one number replaced."""
    numbers = np.concatenate([_rotation(rng).wxyz, rng.uniform(-0.5, 0.5, 3)])
    numbers[rng.integers(0, 7)] = number
    return SE3(numbers)


def _wrong_shape(rng: np.random.Generator) -> Any:
    """Return a matrix instead of a pose, or an SE3 with a vector of a wrong size."""
    if rng.integers(0, 2):
        return np.eye(4)
    pose = SE3(np.concatenate([_rotation(rng).wxyz, rng.uniform(-0.5, 0.5, 3)]))
    object.__setattr__(pose, "wxyz_xyz", rng.uniform(size=int(rng.choice([0, 3, 6, 8, 16]))))
    return pose


def _rotation(rng: np.random.Generator) -> SO3:
    wxyz = rng.normal(size=4)
    return SO3(wxyz / np.linalg.norm(wxyz))


def _direction(rng: np.random.Generator) -> Vector:
    direction = rng.normal(size=3)
    return np.asarray(direction / np.linalg.norm(direction))
