"""Constants of the whole stack."""

TIMESTEP = 1e-3
"""Period of control and physics [s]."""
