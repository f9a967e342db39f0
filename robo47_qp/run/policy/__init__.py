"""Policies in place of a task's program."""
