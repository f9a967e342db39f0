"""Differential inverse kinematics at a fixed rate."""
