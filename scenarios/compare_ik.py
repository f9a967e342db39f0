"""Inverse kinematics compared: damped least squares, QP, restarts, on paired targets."""

import sys

from robo47_qp.evaluation.benchmarks.ik.command import compare_command

if __name__ == "__main__":
    sys.exit(compare_command())
