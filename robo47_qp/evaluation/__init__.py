"""Evaluation: many episodes of one task under one policy, with paired seeds."""
