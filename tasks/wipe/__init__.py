"""Wiping a board."""
