"""A task evaluated: many episodes under one policy or several, on paired seeds."""

from collections.abc import Sequence

from rich.console import Console

from robo47_qp.cli import main
from robo47_qp.evaluation.evaluate import evaluate
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.run.foreign_code import Blamed
from robo47_qp.run.registry import load_task


def evaluate_command(args: Sequence[str] | None = None, prog: str | None = None) -> int:
    """Evaluate from the command line, and return the exit code; see `robo47_qp.cli.main`."""
    return main(EvaluateOptions, evaluate_chosen, __doc__, repeated=True, args=args, prog=prog)


def evaluate_chosen(options: EvaluateOptions, console: Console) -> int:
    """Run the evaluation that was chosen, and return the exit code."""
    kind = load_task(options.task)
    with Blamed(kind):
        task = kind()
        robot = options.robot_for(task)
        return evaluate(task.laid_out(robot), robot, options, console)
