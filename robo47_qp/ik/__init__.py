"""Inverse kinematics: solvers behind one protocol."""
