"""Reach tool poses spread over the workspace and hold each of them."""

import sys

from robo47_qp.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["run", "reach", *sys.argv[1:]]))
