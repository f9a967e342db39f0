"""Pick a cube from a moving belt and put it beside the belt."""

import sys

from robo47_qp.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["run", "conveyor_pick", *sys.argv[1:]]))
