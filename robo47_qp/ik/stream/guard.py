"""Guard around code of a user's own: what it raises is an event of the tick, never an exception."""


class Guard:
    """Catches every exception in a `with` block but those that end the program."""

    def __init__(self) -> None:
        self.raised = False
        """True once the block has raised."""

    def __enter__(self) -> "Guard":
        """Return the guard."""
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        """Keep that there was an exception."""
        self.raised = isinstance(error, Exception)
        return self.raised
