"""Benchmarks of the parts of the stack."""
