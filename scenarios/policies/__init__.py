"""Policies to try and to learn from: each a file that needs of the package its policy module."""
