"""Reach tool poses spread over the workspace and hold each of them."""

import sys

from robo47_qp.cli import run_command

if __name__ == "__main__":
    sys.exit(run_command("reach"))
