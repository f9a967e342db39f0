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
    """Return the success rate of what was judged so far, with its interval, and the errors."""
    if not results:
        return "starting"
    judged = [result.success for result in results if result.error is None]
    words = ["nothing judged"]
    if judged:
        low, high = wilson(sum(judged), len(judged))
        rate = 100 * sum(judged) / len(judged)
        words = [f"{rate:.1f} % ({100 * low:.1f} to {100 * high:.1f})"]
    errors = len(results) - len(judged)
    return ", ".join([*words, f"{errors} errors"] if errors else words)
