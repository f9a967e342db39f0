"""Motion: timed joint references between configurations."""
