"""Pick a cube from a moving belt and put it beside the belt."""

import sys

from robo47_qp.cli import run_command

if __name__ == "__main__":
    sys.exit(run_command("conveyor_pick"))
