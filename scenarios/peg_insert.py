"""Put a peg into a hole that is known to 2 mm and 2 degrees: search, give way, insert."""

import sys

from robo47_qp.cli import run_command

if __name__ == "__main__":
    sys.exit(run_command("peg_insert"))
