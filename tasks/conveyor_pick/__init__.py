"""Picking from a belt."""
