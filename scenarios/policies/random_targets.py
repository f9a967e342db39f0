"""A policy without a plan: joint positions near home at random. It is there to fail."""

import zlib

import numpy as np

from robo47_qp.run.policy.policy import JointTarget, Observation

_REACH = 0.3
"""How far from home [rad]."""


class RandomTargets:
    """Draws a new target in one of ten decisions; the same world gives the same targets."""

    def reset(self, observation: Observation) -> None:
        self._home = observation.q
        seen = np.concatenate([observation.q, *observation.objects.values()])
        self._rng = np.random.default_rng(zlib.crc32(seen.tobytes()))
        self._target = JointTarget(q=self._home)

    def act(self, observation: Observation) -> JointTarget:
        if self._rng.random() < 0.1:
            q = self._home + self._rng.uniform(-_REACH, _REACH, len(self._home))
            self._target = JointTarget(q=q)
        return self._target
