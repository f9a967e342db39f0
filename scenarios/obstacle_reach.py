"""Reach behind a post and under a shelf without touching either."""

import sys

from robo47_qp.cli import run_command

if __name__ == "__main__":
    sys.exit(run_command("obstacle_reach"))
