"""Two arms carry a tray over a wall."""

import sys

from robo47_qp.cli import run_command

if __name__ == "__main__":
    sys.exit(run_command("carry_tray"))
