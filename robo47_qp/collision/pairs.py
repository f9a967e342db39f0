"""The pairs of geoms that are kept apart, and those that are not, with the reason."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import mujoco
import numpy as np

from robo47_qp.arrays import Range
from robo47_qp.collision.distance import GeomDistance
from robo47_qp.errors import ModelError
from robo47_qp.model.arm import Arm
from robo47_qp.model.sampling import spread

_SAMPLE = 256
"""Configurations that are examined, besides home."""


class LeftOut(NamedTuple):
    """A pair of geoms that is not kept apart."""

    geoms: tuple[int, int]
    names: tuple[str, str]
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False)
class GeomPairs:
    """Pairs of collision geoms of an arm and its obstacles, in the order of their numbers.

    A collision geom has a bit in `contype` or `conaffinity`. Every pair of them whose distance
    can change is kept, except:

    - pairs that the model rules out by an `exclude` or by their bits;
    - geoms of neighbours (links connected by one joint) that are closer than the clearance at
      home: they cover the joint, whose range keeps the links apart;
    - geoms of the robot that are closer than the clearance at home and in 256 configurations
      spread over the joint ranges: nothing can move them apart.

    MuJoCo's own filter of parent and child is not used: it also skips neighbours that can
    collide. An obstacle is left out by its bits only.
    """

    kept: tuple[tuple[int, int], ...]
    """Geom numbers, the smaller one first."""
    names: tuple[tuple[str, str], ...]
    """Names of each kept pair in messages: bodies of the robot, obstacles."""
    left_out: tuple[LeftOut, ...]
    """Pairs that can move and are not kept apart."""

    @classmethod
    def of(cls, arm: Arm, clearance: float, *, some: bool = True) -> "GeomPairs":
        """Choose the pairs of an arm.

        Args:
            arm: The arm.
            clearance: How far they are to be apart [m].
            some: Whether there must be any.

        Raises:
            InvalidValueError: The clearance is negative or not finite.
            ModelError: No pair remains, and some must.
        """
        Range(at_least=0.0).check("clearance", clearance)
        m, kept, left_out = arm.model, [], []
        reasons = {pair: _ruled_out(m, pair) for pair in _movable(m)}
        own = [pair for pair, reason in reasons.items() if reason is None]
        own = [pair for pair in own if not any(_is_obstacle(arm, geom) for geom in pair)]
        reasons |= _never_clear(arm, own, clearance)
        for pair, reason in reasons.items():
            if reason is None:
                kept.append(pair)
            else:
                left_out.append(LeftOut(pair, pair_names(m, pair), reason))
        if some and not kept:
            raise ModelError(
                f"Robot {arm.robot.name!r} should keep {1e3 * clearance:.3g} mm of clearance, "
                f"but none of its {m.ngeom} geoms makes a pair that can: {len(left_out)} pairs "
                "are left out. Give its links collision geoms, or ask for less."
            )
        names = tuple(pair_names(m, pair) for pair in kept)
        return cls(kept=tuple(kept), names=names, left_out=tuple(left_out))


def colliding_pairs(m: mujoco.MjModel) -> list[tuple[int, int]]:
    """Return the pairs of geoms that MuJoCo lets collide: not those of a body and its parent."""
    world = m.body_weldid[m.geom_bodyid] == 0
    return [
        (a, b)
        for a, b in _movable(m)
        if _ruled_out(m, (a, b)) is None
        and (world[a] or world[b] or not _are_neighbours(m, (a, b)))
    ]


def pair_names(m: mujoco.MjModel, pair: tuple[int, int]) -> tuple[str, str]:
    """Return the names of two geoms in messages; one of the world comes last."""
    a, b = (_name(m, geom) for geom in pair)
    return (b, a) if m.geom_bodyid[pair[0]] == 0 else (a, b)


def _movable(m: mujoco.MjModel) -> Iterator[tuple[int, int]]:
    solid = np.flatnonzero((m.geom_contype != 0) | (m.geom_conaffinity != 0)).tolist()
    weld = m.body_weldid[m.geom_bodyid]
    return ((a, b) for a, b in combinations(solid, 2) if weld[a] != weld[b])


def _never_clear(
    arm: Arm, pairs: list[tuple[int, int]], clearance: float
) -> dict[tuple[int, int], str]:
    """Return reasons to leave out pairs that are too close at home, or everywhere."""
    m, d = arm.model, mujoco.MjData(arm.model)
    measure, reasons, farthest = GeomDistance(m, d), {}, dict.fromkeys(pairs, -np.inf)
    for k, q in enumerate([arm.home, *spread(arm.q_low, arm.q_high, _SAMPLE)]):
        d.qpos[:] = q
        mujoco.mj_kinematics(m, d)
        for pair in list(farthest):
            distance = measure.between(*pair, np.inf)
            if distance >= clearance:
                del farthest[pair]
            elif k == 0 and _are_neighbours(m, pair):
                del farthest[pair]
                reasons[pair] = f"neighbours, {1e3 * distance:.1f} mm apart at home"
            else:
                farthest[pair] = max(farthest[pair], distance)
    for pair, far in farthest.items():
        reasons[pair] = f"never seen further apart than {1e3 * far:.1f} mm"
    return reasons


def _ruled_out(m: mujoco.MjModel, pair: tuple[int, int]) -> str | None:
    a, b = pair
    body_a, body_b = sorted(int(m.geom_bodyid[geom]) for geom in pair)
    # MuJoCo packs the two bodies of an `exclude`, the smaller number first, into one integer.
    if (body_a << 16) + body_b in m.exclude_signature:
        return "excluded by the model"
    if not (m.geom_contype[a] & m.geom_conaffinity[b] or m.geom_contype[b] & m.geom_conaffinity[a]):
        return "contype and conaffinity of the model"
    return None


def _are_neighbours(m: mujoco.MjModel, pair: tuple[int, int]) -> bool:
    weld_a, weld_b = (int(m.body_weldid[m.geom_bodyid[geom]]) for geom in pair)
    above_a, above_b = (int(m.body_weldid[m.body_parentid[weld]]) for weld in (weld_a, weld_b))
    return above_a == weld_b or above_b == weld_a


def _is_obstacle(arm: Arm, geom: int) -> bool:
    return arm.model.geom(geom).name in {obstacle.name for obstacle in arm.obstacles}


def _name(m: mujoco.MjModel, geom: int) -> str:
    body = int(m.geom_bodyid[geom])
    own = str(m.geom(geom).name)
    return own or f"geom {geom}" if body == 0 else str(m.body(body).name) or own or f"body {body}"
