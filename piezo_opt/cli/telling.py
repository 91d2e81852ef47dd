"""What a long command says while it works: a status on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from piezo_opt.cli.declare import echo

QUIET_S = 5.0
"""Seconds between two plain lines, and before the first: a log of a run of an hour stays readable,
and a run that is over at once says nothing but its answer."""


@contextmanager
def telling(what: str) -> Iterator[Callable[[str], None]]:
    """Shows sentences about what is going on, on standard error.

    Args:
        what: the work, "Fit"; each sentence follows it.
    """
    if not sys.stderr.isatty():
        yield _Lines(what)
        return
    from rich.console import Console

    console = Console(stderr=True)
    with console.status(what) as status:
        yield lambda sentence: status.update(f"{what}: {sentence}")


class _Lines:
    """Plain lines, no more than one in :data:`QUIET_S` seconds."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._began = self._last = time.monotonic()

    def __call__(self, sentence: str) -> None:
        now = time.monotonic()
        if now - self._last < QUIET_S:
            return
        self._last = now
        echo(f"{self._what}, {now - self._began:.0f} s: {sentence}", err=True)
