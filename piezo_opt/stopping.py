"""Ending work early: a limit of wall time that acts as Ctrl-C does, and threads that heed it."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import final

from piezo_opt.errors import InputError


@final
class TimeLimit:
    """A limit of wall time [s], counted from when it is made; None never ends.

    Within its ``with`` block the main thread is interrupted once the limit has passed, as by
    Ctrl-C: whoever answers that with the best so far answers this in the same way. In another
    thread, which cannot be interrupted, only :meth:`check` ends the work. A block that is entered
    after the limit is interrupted at once.

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
        self._deaf = False

    @property
    def passed(self) -> bool:
        """Whether the time is over."""
        return self._end is not None and time.monotonic() >= self._end

    @property
    def left(self) -> float | None:
        """Time that is left [s], a millisecond at least; None without a limit."""
        return None if self._end is None else max(1e-3, self._end - time.monotonic())

    def check(self) -> None:
        """Interrupt when the time is over.

        Raises:
            KeyboardInterrupt: it is.
        """
        if self.passed:
            raise KeyboardInterrupt

    def checking(self, tell: Callable[[str], None]) -> Callable[[str], None]:
        """What tells a sentence, and ends the work there when the time is over."""

        def told(sentence: str) -> None:
            self.check()
            tell(sentence)

        return told

    def __enter__(self) -> TimeLimit:
        self.check()
        if self._end is not None and threading.current_thread() is threading.main_thread():
            timer = threading.Timer(max(0.0, self._end - time.monotonic()), self._interrupt)
            timer.daemon = True
            self._timer = timer
            # A shell starts what runs in its background deaf to interrupts.
            if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
                signal.signal(signal.SIGINT, signal.default_int_handler)
                self._deaf = True
            timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
        if self._deaf:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            self._deaf = False

    def _interrupt(self) -> None:
        # Under the lock: nobody who has left the block is interrupted any more.
        with self._lock:
            main = threading.main_thread().ident
            if self._timer is not None and main is not None:
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
