"""One arm gives a bar to the other in the air."""

import sys

from robo47_qp.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["run", "handover", *sys.argv[1:]]))
