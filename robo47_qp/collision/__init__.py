"""Distances between geoms: one engine for inverse kinematics, planner and audit."""
