"""Targets for a stream that jump, leave reach, lie inside the arm or are no poses."""

from collections.abc import Iterator, Mapping

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import Obstacle, Shape

DT = 1e-3
"""Length of a tick [s]."""
SHOULDER = np.array([0.0, 0.0, 0.333])
"""Where a Panda's shoulder is above its base [m]."""
OBSTACLES = (
    Obstacle(
        name="table",
        shape=Shape.BOX,
        size=(0.4, 0.6, 0.02),
        T_world_obstacle=SE3.from_translation(np.array([0.5, 0.0, -0.03])),
    ),
    Obstacle(
        name="shelf",
        shape=Shape.BOX,
        size=(0.2, 0.3, 0.02),
        T_world_obstacle=SE3.from_translation(np.array([0.6, 0.0, 0.9])),
    ),
    Obstacle(
        name="post",
        shape=Shape.CYLINDER,
        size=(0.05, 0.4),
        T_world_obstacle=SE3.from_translation(np.array([0.3, -0.45, 0.4])),
    ),
    Obstacle(
        name="ball",
        shape=Shape.SPHERE,
        size=(0.1,),
        T_world_obstacle=SE3.from_translation(np.array([0.5, 0.3, 0.5])),
    ),
)
"""What stands around one arm."""
PAIR_OBSTACLES = (
    Obstacle(
        name="table",
        shape=Shape.BOX,
        size=(0.4, 0.9, 0.02),
        T_world_obstacle=SE3.from_translation(np.array([0.55, 0.0, -0.03])),
    ),
    Obstacle(
        name="shelf",
        shape=Shape.BOX,
        size=(0.2, 0.6, 0.02),
        T_world_obstacle=SE3.from_translation(np.array([0.6, 0.0, 0.9])),
    ),
    Obstacle(
        name="ball",
        shape=Shape.SPHERE,
        size=(0.08,),
        T_world_obstacle=SE3.from_translation(np.array([0.6, 0.0, 0.25])),
    ),
)
"""What stands around two arms."""


def targets(arm: Arm, rng: np.random.Generator, tool: int = 0) -> Iterator[object]:
    """Yield targets without end: at rest, moving, circling, far, stretched, in the base, invalid.

    Each piece lasts 0.1 to 1.5 s and begins with a jump.
    """
    base = _shoulder(arm, tool) * np.array([1.0, 1.0, 0.0])
    while True:
        pose, length = (
            arm.pose(arm.drawn(rng), tool),
            int(rng.integers(100, 1500)),
        )
        kind = rng.integers(7)
        if kind == 0:
            pieces: Iterator[object] = (pose for _ in range(length))
        elif kind == 1:
            twist = np.concatenate([rng.uniform(-0.5, 0.5, 3), rng.uniform(-2.0, 2.0, 3)])
            pieces = (pose @ SE3.exp(twist * DT * k) for k in range(length))
        elif kind == 2:
            pieces = circling(arm.pose(arm.home, tool), 0.1, rng.uniform(0.1, 0.6), length)
        elif kind == 3:
            away = SE3.from_translation(rng.normal(size=3) * 10.0 ** rng.uniform(0.0, 9.0))
            pieces = (away @ pose for _ in range(length))
        elif kind == 4:
            pieces = stretching(rng, length, _shoulder(arm, tool))
        elif kind == 5:
            inside = SE3.from_rotation_and_translation(
                pose.rotation(), base + rng.normal(size=3) * np.array([0.05, 0.05, 0.2])
            )
            pieces = (inside for _ in range(length))
        else:
            bad = [SE3(np.full(7, np.nan)), None, SE3(np.zeros(7)), SE3(np.full(7, np.inf))]
            which = bad[int(rng.integers(len(bad)))]
            pieces = (which for _ in range(length // 5))
        yield from pieces


def circling(T: SE3, radius: float, speed: float, count: int) -> Iterator[SE3]:
    """Yield poses on a vertical circle that begins at a pose."""
    for k in range(count):
        t = speed / radius * DT * k
        aside = radius * np.array([0.0, np.sin(t), np.cos(t) - 1.0])
        yield SE3.from_rotation_and_translation(T.rotation(), T.translation() + aside)


def stretching(rng: np.random.Generator, count: int, shoulder: Vector = SHOULDER) -> Iterator[SE3]:
    """Yield poses along a ray from the shoulder to beyond reach and back."""
    direction = rng.normal(size=3)
    direction *= np.array([1.0, 1.0, np.sign(direction[2])]) / np.linalg.norm(direction)
    turn = SO3.exp(rng.normal(size=3))
    for k in range(count):
        far = 0.75 + 0.35 * np.sin(np.pi * k / count)
        yield SE3.from_rotation_and_translation(turn, shoulder + far * direction)


def pair_targets(arm: Arm, rng: np.random.Generator) -> Iterator[object]:
    """Endless: each tool on hostile targets of its own, or both against each other.

    Against each other: the places of both are exchanged along a line, both want the same place,
    or each wants to be where a link of the other arm is. Some ticks have a target for one tool
    only, for a tool that is not there, or for none.
    """
    names = [tool.name for tool in arm.robot.tools]
    own = [targets(arm, rng, tool) for tool in range(len(names))]
    while True:
        length, kind = int(rng.integers(100, 1500)), int(rng.integers(6))
        if kind <= 2:
            for _ in range(length):
                yield {name: next(each) for name, each in zip(names, own, strict=True)}
        elif kind == 3:
            yield from _crossing(arm, rng, length)
        elif kind == 4:
            yield from _inside_each_other(arm, rng, length)
        else:
            yield from _odd(arm, rng, length // 4)


def _crossing(arm: Arm, rng: np.random.Generator, count: int) -> Iterator[Mapping[str, SE3]]:
    """Both tools change places, through each other; sometimes they end at the same place."""
    q = arm.drawn(rng)
    (a, left), (b, right) = [(tool.name, arm.pose(q, i)) for i, tool in enumerate(arm.robot.tools)]
    way = right.translation() - left.translation()
    meet = 0.5 if rng.random() < 0.3 else 1.0
    for k in range(count):
        share = meet * 0.5 * (1.0 - np.cos(np.pi * k / count))
        yield {
            a: SE3.from_translation(share * way) @ left,
            b: SE3.from_translation(-share * way) @ right,
        }


def _inside_each_other(
    arm: Arm, rng: np.random.Generator, count: int
) -> Iterator[Mapping[str, SE3]]:
    """Each tool is to be where the hand, the elbow or the base of the other one is at home."""
    data = arm.place_only(arm.home)
    names = [tool.name for tool in arm.robot.tools]
    links = rng.choice(["link0", "link4", "hand"], size=2)
    places = [
        data.xpos[arm.model.body(f"{name}_{link}").id].copy()
        for name, link in zip(reversed(names), links, strict=True)
    ]
    turn = SO3.exp(rng.normal(size=3))
    found = {
        name: SE3.from_rotation_and_translation(turn, place + rng.normal(size=3) * 0.02)
        for name, place in zip(names, places, strict=True)
    }
    for _ in range(count):
        yield found


def _odd(arm: Arm, rng: np.random.Generator, count: int) -> Iterator[object]:
    pose = arm.pose(arm.drawn(rng))
    name = arm.robot.tools[int(rng.integers(2))].name
    odd = [{name: pose}, pose, {"third": pose}, {}, None, {name: SE3(np.full(7, np.nan))}]
    which = odd[int(rng.integers(len(odd)))]
    for _ in range(count):
        yield which


def _shoulder(arm: Arm, tool: int) -> Vector:
    """Return where a Panda's shoulder is."""
    mounts = arm.robot.mounts
    return SHOULDER if not mounts else mounts[tool].T_world_base.translation() + SHOULDER
