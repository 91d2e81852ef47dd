"""A limit of time on a command: the best so far, or one sentence where there is none yet."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from piezo_opt.cli.codes import INTERRUPTED
from piezo_opt.cli.declare import Exit
from piezo_opt.errors import InputError
from piezo_opt.stopping import TimeLimit
from piezo_opt.units import quantity, show


def limit_of(max_time: str | None) -> TimeLimit:
    """The limit that ``--max-time`` says, counted from now; none without it.

    Raises:
        InputError: it is no positive time.
    """
    try:
        return TimeLimit(None if max_time is None else quantity(max_time, "s"))
    except InputError as error:
        raise InputError(f"--max-time: {error}") from None


@contextmanager
def limited(limit: TimeLimit) -> Iterator[None]:
    """The block is interrupted when the time is over, as by Ctrl-C.

    Raises:
        InputError: that was before there was a result.
    """
    try:
        with limit:
            yield
    except KeyboardInterrupt:
        if limit.seconds is None or not limit.passed:
            raise
        raise InputError(
            f"--max-time: {show(limit.seconds, 's')} were over before there was a result: give more"
        ) from None


def leave_early(interrupted: bool, limit: TimeLimit) -> None:
    """End the command as a shell expects after Ctrl-C; a limit of time is no interrupt.

    Raises:
        Exit: the work was interrupted by the user.
    """
    if interrupted and not limit.passed:
        raise Exit(INTERRUPTED)
