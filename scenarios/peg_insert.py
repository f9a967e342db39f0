"""Put a peg into a hole that is known to 2 mm and 2 degrees: search, give way, insert."""

import sys

from robo47_qp.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["run", "peg_insert", *sys.argv[1:]]))
