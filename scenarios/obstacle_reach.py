"""Reach behind a post and under a shelf without touching either."""

import sys

from robo47_qp.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["run", "obstacle_reach", *sys.argv[1:]]))
