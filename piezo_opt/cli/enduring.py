"""A standard output that may be full: files are written all the same."""

from __future__ import annotations

import errno
import os
from typing import Any, TextIO, final


@final
class Enduring:
    """A stream that takes everything, and remembers that it could not pass something on.

    A reader that has gone (``| head``) is none of its business: that ends the command, as usual.

    Attributes:
        failed: why something was lost; empty where nothing was.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.failed = ""

    def write(self, text: str) -> int:
        """Pass a text on."""
        if self.failed:
            return len(text)
        try:
            return self._stream.write(text)
        except OSError as error:
            self._lost(error)
            return len(text)

    def flush(self) -> None:
        """Pass on what is held back."""
        if self.failed:
            return
        try:
            self._stream.flush()
        except OSError as error:
            self._lost(error)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _lost(self, error: OSError) -> None:
        if error.errno == errno.EPIPE:
            raise error
        self.failed = error.strerror or str(error)
        # What the stream still holds is lost, too; the interpreter would complain of it at its end.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)
