"""Inverse kinematics compared: damped least squares, QP, restarts, on paired targets."""

import sys

from robo47_qp.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["compare-ik", *sys.argv[1:]]))
