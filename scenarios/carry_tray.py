"""Two arms carry a tray over a wall."""

import sys

from robo47_qp.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["run", "carry_tray", *sys.argv[1:]]))
