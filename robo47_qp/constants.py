"""Constants of the whole stack."""

TIMESTEP = 1e-3
"""Period of control and physics [s]."""
TASKS = "robo47.tasks"
"""Group of entry points by which a package offers its tasks, each as name = "module:Class"."""
MANY = 2**30
"""More control periods than a run has."""
