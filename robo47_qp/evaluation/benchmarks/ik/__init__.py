"""Benchmark of IK solvers: target sets, one judge, statistics, and what people look at."""
