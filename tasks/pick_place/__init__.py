"""Picking an item and placing it."""
