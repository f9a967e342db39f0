"""Stack three cubes at a goal."""

import sys

from robo47_qp.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["run", "stack", *sys.argv[1:]]))
