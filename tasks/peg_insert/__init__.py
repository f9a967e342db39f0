"""Inserting a peg."""
