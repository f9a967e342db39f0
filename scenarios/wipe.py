"""Wipe a board of unknown height, pressing with a constant force while the sponge slides."""

import sys

from robo47_qp.cli import run_command

if __name__ == "__main__":
    sys.exit(run_command("wipe"))
