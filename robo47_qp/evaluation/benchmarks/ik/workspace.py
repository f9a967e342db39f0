"""Reach of an arm, by search over its joint ranges."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.arm import Arm

_SAMPLES = 2048
_POLISHED = 3
"""Number of samples from which the farthest points are optimised."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reach:
    """Greatest distances from the first joint, by search: tight lower bounds."""

    centre: Vector
    """Position of the first joint (3,) [m]."""
    tool: float
    """Greatest distance of the tool point [m]."""
    wrist: float
    """Greatest distance of the last joint [m]."""
    p_tcp_wrist: Vector
    """Position of the last joint in the tool frame (3,) [m]."""
    across: float
    """Horizontal distance that 99 % of the tool points stay within [m]."""


_Point = Callable[[Vector], Vector]


class _Points:
    """Positions of the tool and of the last joint of an arm, by MuJoCo alone."""

    def __init__(self, arm: Arm) -> None:
        self._m, self._d = arm.model, mujoco.MjData(arm.model)
        self._tcp = arm.model.site(arm.robot.tcp).id

    def at(self, q: Vector) -> mujoco.MjData:
        self._d.qpos[:] = q
        mujoco.mj_kinematics(self._m, self._d)
        return self._d

    def tool(self, q: Vector) -> Vector:
        return np.array(self.at(q).site_xpos[self._tcp])

    def wrist(self, q: Vector) -> Vector:
        return np.array(self.at(q).xanchor[-1])

    def wrist_in_tool(self, q: Vector) -> Vector:
        d = self.at(q)
        R = d.site_xmat[self._tcp].reshape(3, 3)
        return np.asarray(R.T @ (d.xanchor[-1] - d.site_xpos[self._tcp]))


def find_reach(arm: Arm) -> Reach:
    """Return the reach of an arm, searched once: low-discrepancy samples, the best optimised."""
    return arm.derived(_reach)


def _reach(arm: Arm) -> Reach:
    points = _Points(arm)
    unit = qmc.Halton(arm.n, scramble=False).random(_SAMPLES)
    samples = arm.q_low + unit * (arm.q_high - arm.q_low)
    centre = points.at(arm.home).xanchor[0].copy()
    tools = np.array([points.tool(q) for q in samples])
    wrists = np.array([points.wrist(q) for q in samples])
    foot = centre[:2]
    return Reach(
        centre=centre,
        tool=_farthest(arm, samples, tools, points.tool, centre),
        wrist=_farthest(arm, samples, wrists, points.wrist, centre),
        p_tcp_wrist=points.wrist_in_tool(arm.home),
        across=float(np.percentile(np.linalg.norm(tools[:, :2] - foot, axis=1), 99.0)),
    )


def _farthest(arm: Arm, samples: Matrix, found: Matrix, point: _Point, centre: Vector) -> float:
    """Return the greatest distance of a point from the centre [m]."""
    distances = np.linalg.norm(found - centre, axis=1)
    bounds = list(zip(arm.q_low, arm.q_high, strict=True))
    best = float(distances.max())
    for k in np.argsort(distances)[-_POLISHED:]:
        climbed = minimize(
            lambda q: -float(np.linalg.norm(point(q) - centre)),
            samples[k],
            method="L-BFGS-B",
            bounds=bounds,
        )
        best = max(best, -float(climbed.fun))
    return best
