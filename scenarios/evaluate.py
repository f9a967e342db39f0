"""A task evaluated: many episodes under one policy or several, on paired seeds."""

import sys

if __name__ == "__main__":
    # Workers import this file: what only the main process needs is imported here.
    from robo47_qp.evaluation.command import evaluate_command

    sys.exit(evaluate_command())
