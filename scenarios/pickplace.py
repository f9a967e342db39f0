"""The main job: pick a cube from the table, place it elsewhere, record everything."""

import sys

from robo47_qp.cli import run_command

if __name__ == "__main__":
    sys.exit(run_command("pick_place"))
