"""Target sets for IK solvers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Matrix
from robo47_qp.evaluation.benchmarks.ik.workspace import find_reach
from robo47_qp.model.arm import Arm
from robo47_qp.motion.waypoint import tool_down

_NEAR = 0.01
"""Distance from a joint limit that counts as near, as a share of the joint's range [-]."""
_DRAWS = 25
"""Number of configurations of which the most singular is kept."""
_TILT = np.radians(20.0)
"""Largest angle between the tool and the vertical above the table [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TargetSet:
    """A named sequence of targets, the same for every solver."""

    name: str
    targets: Sequence[SE3]
    """Target poses T_world_tcp, n of them."""
    reachable: bool | None
    """True where every target is the forward kinematics of a configuration within limits, False
    where none can be reached, None where it is not known."""
    kinds: Sequence[str] = field(default=())
    """Why each target cannot be reached, a key of `unreachable.EXPECTED`; empty if not known."""

    def positions(self, n: int) -> Matrix:
        """Return the positions of the first n targets (n, 3), NaN for what is no pose [m]."""
        found = np.full((n, 3), np.nan)
        for place, target in zip(found, self.targets, strict=False):
            numbers = np.asarray(getattr(target, "wxyz_xyz", ()))
            if numbers.shape == (7,):
                place[:] = numbers[4:]
        return found

    def __len__(self) -> int:
        """Number of targets."""
        return len(self.targets)


MakeTargets = Callable[[Arm, int, np.random.Generator], TargetSet]


def uniform(arm: Arm, n: int, rng: np.random.Generator) -> TargetSet:
    """Return poses of configurations that are uniformly distributed within the joint limits."""
    return _made_by_fk("uniform", arm, _configurations(arm, n, rng))


def near_limits(arm: Arm, n: int, rng: np.random.Generator) -> TargetSet:
    """Return poses of configurations with half of the joints within 1 % of a limit."""
    q = _configurations(arm, n, rng)
    low, high = arm.q_low, arm.q_high
    away = rng.uniform(0.0, _NEAR, q.shape) * (high - low)
    ends = np.where(rng.integers(0, 2, q.shape) == 1, high - away, low + away)
    close = rng.permuted(np.tile(np.arange(arm.n) < (arm.n + 1) // 2, (n, 1)), axis=1)
    q = np.clip(np.where(close, ends, q), low, high)
    return _made_by_fk("near_limits", arm, q)


def near_singular(arm: Arm, n: int, rng: np.random.Generator) -> TargetSet:
    """Return poses of configurations near singularities.

    Each is the one of 25 with the smallest singular value of J.
    """
    q = np.empty((n, arm.n))
    for k in range(n):
        drawn = _configurations(arm, _DRAWS, rng)
        J = np.stack([arm.jacobian(one) for one in drawn])
        q[k] = drawn[np.linalg.svd(J, compute_uv=False)[:, -1].argmin()]
    return _made_by_fk("near_singular", arm, q)


def tabletop(arm: Arm, n: int, rng: np.random.Generator) -> TargetSet:
    """Return poses of a tool that works on a table in front of the arm.

    Positions are uniform in a box, relative to the arm's reach R: 0.35 R to 0.75 R ahead, 0.45 R to
    either side, from 20 mm above the base to 0.4 R. The tool points down, tilted by up to 20
    degrees in any direction and turned by any angle. Some poses may be out of reach.
    """
    R = find_reach(arm).across
    foot = arm.model.body(int(arm.model.body_rootid[arm.model.jnt_bodyid[0]])).pos
    low = np.array([0.35 * R, -0.45 * R, 0.02])
    high = np.array([0.75 * R, 0.45 * R, 0.4 * R])
    positions = foot + rng.uniform(low, high, (n, 3))
    yaw, ahead, tilt = rng.uniform([-np.pi, -np.pi, 0.0], [np.pi, np.pi, _TILT], (n, 3)).T
    targets = []
    for p, turn, towards, angle in zip(positions, yaw, ahead, tilt, strict=True):
        axis = np.array([np.cos(towards), np.sin(towards), 0.0])
        lean = SO3.exp(angle * axis)
        down = tool_down(p, yaw=turn)
        targets.append(SE3.from_rotation_and_translation(down.rotation() @ lean, p))
    return TargetSet(name="tabletop", targets=targets, reachable=None)


def _configurations(arm: Arm, n: int, rng: np.random.Generator) -> Matrix:
    return rng.uniform(arm.q_low, arm.q_high, (n, arm.n))


def _made_by_fk(name: str, arm: Arm, q: Matrix) -> TargetSet:
    return TargetSet(name=name, targets=[arm.pose(one) for one in q], reachable=True)
