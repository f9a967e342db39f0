"""Reaching poses."""
