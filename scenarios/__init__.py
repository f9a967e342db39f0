"""Scripts that run a task under a set of choices."""
