"""Sort boxes and cylinders into two bins by their colour."""

import sys

from robo47_qp.cli import run_command

if __name__ == "__main__":
    sys.exit(run_command("sort"))
