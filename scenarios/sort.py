"""Sort boxes and cylinders into two bins by their colour."""

import sys

from robo47_qp.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["run", "sort", *sys.argv[1:]]))
