"""The compiled core: what is hot, in plain C; see `library` for how it is built and loaded."""
