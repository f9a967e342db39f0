"""Picking and placing."""
