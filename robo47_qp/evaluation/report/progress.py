"""Progress of an evaluation in the terminal."""

from collections.abc import Sequence

from rich.console import Console

from robo47_qp.evaluation.episode import EpisodeResult
from robo47_qp.evaluation.statistics import wilson
from robo47_qp.report.progress import Steps


class EvaluationBar(Steps):
    """Tells episodes, with the success rate so far and the time left."""

    def __init__(self, console: Console, episodes: int, title: str = "episodes") -> None:
        """Prepare for a number of episodes."""
        super().__init__(console, episodes, title)

    def __enter__(self) -> "EvaluationBar":
        """Begin."""
        super().__enter__()
        return self

    def results(self, found: Sequence[EpisodeResult]) -> None:
        """Show the results so far."""
        self.show(len(found), described(found))


def described(results: Sequence[EpisodeResult]) -> str:
    """Return the success rate so far, with its interval, and the number of errors."""
    if not results:
        return "starting"
    successes = sum(result.success for result in results)
    low, high = wilson(successes, len(results))
    errors = sum(result.error is not None for result in results)
    rate = f"{100 * successes / len(results):.1f} % ({100 * low:.1f} to {100 * high:.1f})"
    return f"{rate}, {errors} errors" if errors else rate
