"""Picking from a moving belt."""
