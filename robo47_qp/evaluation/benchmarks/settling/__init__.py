"""Benchmark of settling times."""
