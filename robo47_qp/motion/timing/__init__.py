"""Timing of motions with bounded velocity, acceleration and jerk."""
