"""Which of several answers to take."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robo47_qp.arm import Arm
from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.solver import IkResult


@dataclass(frozen=True, kw_only=True)
class Preference:
    """Weights of what makes an answer good; each quality runs from 0 to 1."""

    seed: float = 1.0
    """Being close to the seed: one minus the root mean square of the joints' ways, each as a
    share of its range."""
    limits: float = 0.5
    """Room to the nearest joint limit, as a share of half the joint's range."""
    manipulability: float = 0.2
    """√det(J Jᵀ), as a share of the best answer's (Yoshikawa, "Manipulability of robotic
    mechanisms", 1985)."""
    clearance: float = 0.2
    """Distance to the nearest obstacle, as a share of the best answer's, where it is known."""

    def __post_init__(self) -> None:
        """Check the weights.

        Raises:
            InvalidValueError: A weight is negative or not finite.
        """
        for name in ("seed", "limits", "manipulability", "clearance"):
            weight = getattr(self, name)
            if not (np.isfinite(weight) and weight >= 0.0):
                raise InvalidValueError(f"preference for {name}", weight, "finite, 0 or more")

    def ranked(self, arm: Arm, answers: Sequence[IkResult], q_seed: Vector) -> tuple[IkResult, ...]:
        """The answers, best first; equal ones in the order given."""
        if len(answers) < 2:
            return tuple(answers)
        span = arm.q_max - arm.q_min
        q = np.array([answer.q for answer in answers])
        score = self.seed * (1.0 - np.sqrt(np.mean(((q - q_seed) / span) ** 2, axis=1)))
        room = np.minimum(q - arm.q_min, arm.q_max - q) / (0.5 * span)
        score += self.limits * room.min(axis=1)
        score += self.manipulability * _share([_manipulability(arm, row) for row in q])
        clearances = [answer.clearance for answer in answers]
        known = [clearance for clearance in clearances if clearance is not None]
        if len(known) == len(answers):
            score += self.clearance * _share(known)
        return tuple(answers[i] for i in np.argsort(-score, kind="stable"))


def _manipulability(arm: Arm, q: Vector) -> float:
    # As a product of singular values it is 0 rather than a root of rounding.
    return float(np.prod(np.linalg.svd(arm.jacobian(q), compute_uv=False)))


def _share(values: Sequence[float]) -> Vector:
    largest = max(values)
    return np.array(values) / largest if largest > 0.0 else np.zeros(len(values))
