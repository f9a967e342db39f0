"""Stacking cubes."""
