"""Wipe a board of unknown height, pressing with a constant force while the sponge slides."""

import sys

from robo47_qp.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["run", "wipe", *sys.argv[1:]]))
