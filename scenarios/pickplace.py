"""The main job: pick a cube from the table, place it elsewhere, record everything."""

import sys

from robo47_qp.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["run", "pick_place", *sys.argv[1:]]))
