"""The audit: what was promised against what the simulated robot did."""
