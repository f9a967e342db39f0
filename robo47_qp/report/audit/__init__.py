"""Audit: the limits of a scenario against what the simulated robot did."""
