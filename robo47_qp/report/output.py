"""Standard output that cannot take all that is printed: closed, full, or of another encoding."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from io import TextIOBase
from typing import TextIO

from robo47_qp.errors import RecordingError


def open_standard_streams() -> None:
    """Open what is closed of the standard streams, as of a service, to nowhere.

    Their numbers would be those of the next files, pipes and sockets, which a child process takes
    for its standard streams then.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            os.set_inheritable(number, True)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, closefd=False))  # noqa: SIM115


class _Output(TextIOBase):
    """A text stream that drops what it cannot write, and keeps the first reason."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.error: OSError | None = None

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Encoding of the stream."""
        return self._stream.encoding or "utf-8"

    def isatty(self) -> bool:
        """Return whether the stream is a terminal."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """Return the descriptor of the stream."""
        return self._stream.fileno()

    def writable(self) -> bool:
        """Return that it can be written to."""
        return True

    def write(self, text: str) -> int:
        """Write a text; what the encoding lacks becomes a question mark."""
        if self.error is None:
            try:
                self._stream.write(text.encode(self.encoding, "replace").decode(self.encoding))
            except OSError as error:
                self._fail(error)
        return len(text)

    def flush(self) -> None:
        """Write what is buffered."""
        if self.error is None:
            try:
                self._stream.flush()
            except OSError as error:
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.error = error
        # What the stream still holds must not fail again when the process ends.
        with suppress(OSError), open(os.devnull, "wb") as nowhere:  # noqa: PTH123
            os.dup2(nowhere.fileno(), self._stream.fileno())


@contextmanager
def forgiving_output() -> Iterator[None]:
    """Let a block print, whatever becomes of the standard output and the standard error.

    A reader that has enough, such as `head`, ends neither the block nor its exit code.

    Raises:
        RecordingError: At the end: the standard output could not be written.
    """
    open_standard_streams()
    out, err = _Output(sys.stdout), _Output(sys.stderr)
    try:
        with redirect_stdout(out), redirect_stderr(err):
            yield
    finally:
        out.flush()
        err.flush()
        if out.error is not None and not isinstance(out.error, BrokenPipeError):
            raise RecordingError(
                f"The standard output cannot be written: {out.error.strerror}. Send it to a place "
                "with room; files that the command has named are written."
            )
