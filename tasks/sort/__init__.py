"""Sorting items into bins."""
