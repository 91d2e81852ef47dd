"""Ending work early: a limit of wall time that acts as Ctrl-C does, and threads that heed it."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import FrameType, TracebackType
from typing import Any, final

from piezo_opt.errors import InputError


@final
class TimeLimit:
    """A limit of wall time [s], counted from when it is made; None never ends.

    Within its ``with`` block the main thread is interrupted once the limit has passed, as by
    Ctrl-C: whoever answers that with the best so far answers this in the same way. In another
    thread, which cannot be interrupted, only :meth:`check` ends the work. A block that is entered
    after the limit is interrupted at once. An interrupt that somebody on the way answers with an
    error of his own (CasADi, where it hears it while it reads its arguments) leaves the block as
    the interrupt that it is.

    Raises:
        InputError: the limit is no positive number.
    """

    def __init__(self, seconds: float | None) -> None:
        try:
            legal = seconds is None or 0.0 < seconds < threading.TIMEOUT_MAX
        except TypeError:
            legal = False
        if not legal:
            said = f"{seconds:g} s" if isinstance(seconds, int | float) else repr(seconds)
            raise InputError(f"A limit of {said} is no limit: give a positive time in seconds.")
        self.seconds = seconds
        self._end = None if seconds is None else time.monotonic() + seconds
        self._lock = threading.Lock()
        self._timer: threading.Timer | None = None
        self._before: Any = None
        self._interrupted = False
        self._timed = False

    @property
    def passed(self) -> bool:
        """Whether the time is over."""
        return self._end is not None and time.monotonic() >= self._end

    @property
    def left(self) -> float | None:
        """Time that is left [s], a millisecond at least; None without a limit."""
        return None if self._end is None else max(1e-3, self._end - time.monotonic())

    def check(self) -> None:
        """Interrupt when the time is over, or the block was interrupted, and threads are at work.

        Raises:
            KeyboardInterrupt: it is, or was.
        """
        if self.passed or self._interrupted:
            raise KeyboardInterrupt

    def checking(self, tell: Callable[[str], None]) -> Callable[[str], None]:
        """What tells a sentence, and ends the work there when the time is over."""

        def told(sentence: str) -> None:
            self.check()
            tell(sentence)

        return told

    def __enter__(self) -> TimeLimit:
        self.check()
        if threading.current_thread() is not threading.main_thread():
            return self
        before = signal.getsignal(signal.SIGINT)
        # A shell starts what runs in its background deaf to interrupts; a limit it hears.
        hears = before is not None and (before is not signal.SIG_IGN or self._end is not None)
        self._before = signal.signal(signal.SIGINT, self._heard) if hears else None
        if self._end is not None:
            timer = threading.Timer(max(0.0, self._end - time.monotonic()), self._interrupt)
            timer.daemon = True
            self._timer = timer
            timer.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._lock:
            timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
            self._before = None
        heard, self._interrupted = self._interrupted, False
        if heard and isinstance(error, Exception):
            raise KeyboardInterrupt from error

    def _heard(self, number: int, frame: FrameType | None) -> None:
        self._interrupted = True
        timed, self._timed = self._timed, False
        # The end of this block's own time is no business of whoever listened before.
        before = None if timed else self._before
        if callable(before) and before is not signal.default_int_handler:
            before(number, frame)
            return
        raise KeyboardInterrupt

    def _interrupt(self) -> None:
        # Under the lock: nobody who has left the block is interrupted any more.
        with self._lock:
            main = threading.main_thread().ident
            if self._timer is not None and main is not None:
                self._timed = True
                signal.pthread_kill(main, signal.SIGINT)


@final
class Pool(ThreadPoolExecutor):
    """Threads that drop what they have not begun when their block is left by an exception.

    The library's pool would finish everything that was queued before an interrupt gets through.
    """

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool | None:
        """Wait for what runs; after an exception nothing more is begun."""
        self.shutdown(wait=True, cancel_futures=kind is not None)
        return None
