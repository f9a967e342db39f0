"""Any task on any robot: --task NAME --robot NAME."""

import sys

from robo47_qp.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["run", *sys.argv[1:]]))
