"""Comparison of reproduced figures with those kept before."""
