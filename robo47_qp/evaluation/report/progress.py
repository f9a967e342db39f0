"""Progress of an evaluation in the terminal."""

from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from robo47_qp.evaluation.episode import EpisodeResult
from robo47_qp.evaluation.statistics import wilson


class EvaluationBar:
    """Bar over the episodes, with the success rate so far and the time left."""

    def __init__(self, console: Console, episodes: int, title: str = "episodes") -> None:
        """Prepare an empty bar with a title."""
        self._progress = Progress(
            TextColumn(escape(title)),
            BarColumn(bar_width=30),
            MofNCompleteColumn(),
            TextColumn("{task.description}"),
            TimeRemainingColumn(),
            console=console,
            transient=True,
        )
        self._bar = self._progress.add_task("", total=episodes)

    def __enter__(self) -> "EvaluationBar":
        """Show the bar."""
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the bar."""
        self._progress.stop()

    def show(self, results: Sequence[EpisodeResult]) -> None:
        """Show the results so far."""
        self._progress.update(self._bar, completed=len(results), description=described(results))


def described(results: Sequence[EpisodeResult]) -> str:
    """Return the success rate so far, with its interval, and the number of errors."""
    if not results:
        return "starting"
    successes = sum(result.success for result in results)
    low, high = wilson(successes, len(results))
    errors = sum(result.error is not None for result in results)
    rate = f"{100 * successes / len(results):.1f} % ({100 * low:.1f} to {100 * high:.1f})"
    return f"{rate}, {errors} errors" if errors else rate
