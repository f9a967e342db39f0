"""A task evaluated: many episodes under one policy or several, on paired seeds."""

import sys

from robo47_qp.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["evaluate", *sys.argv[1:]]))
