"""Guard: the border to code that may raise anything."""

import traceback
from types import TracebackType


class Guard:
    """Keeps what is raised inside a `with` block, whatever it is.

    Only where code that is not ours is called, which must not take everything else with it,
    by `sys.exit` neither. Interrupts go through.
    """

    def __init__(self) -> None:
        self.error: Exception | SystemExit | None = None
        """What was raised; None where nothing was."""

    def __enter__(self) -> "Guard":
        """Begin."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool:
        """Keep an exception."""
        if isinstance(error, Exception | SystemExit):
            self.error = error
        return self.error is not None

    @property
    def words(self) -> str:
        """The traceback."""
        error = self.error
        return "" if error is None else "".join(traceback.format_exception(error)).rstrip()
