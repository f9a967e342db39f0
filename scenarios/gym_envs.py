"""Makes every task in the folder of tasks known to Gymnasium."""

from robo47_qp.evaluation.gym import env as gym_env
from scenarios.evaluate import known_tasks


def register() -> list[str]:
    """Register robo47/<task>-v0 for each; returns the names."""
    return gym_env.register(known_tasks().values())
