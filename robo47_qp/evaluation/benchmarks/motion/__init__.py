"""Benchmark of planned motions."""
