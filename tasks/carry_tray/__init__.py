"""Carry a tray with two arms."""
