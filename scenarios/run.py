"""Any task on any robot: --task NAME --robot NAME."""

import sys

from robo47_qp.cli import run_command

if __name__ == "__main__":
    sys.exit(run_command())
