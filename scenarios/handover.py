"""One arm gives a bar to the other in the air."""

import sys

from robo47_qp.cli import run_command

if __name__ == "__main__":
    sys.exit(run_command("handover"))
