"""Benchmark of IK solvers: target sets, independent evaluation, statistics and reports."""
