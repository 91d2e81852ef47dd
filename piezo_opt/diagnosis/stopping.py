"""Ending a diagnosis early: a time limit, and pools of threads that stop when they are told to."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import final


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


@final
class TimeLimit:
    """A limit of wall time, counted from when it is made; None never ends.

    Within its ``with`` block the main thread is interrupted, as by Ctrl-C, once the limit has
    passed. In another thread, which cannot be interrupted, only :meth:`check` ends the work. A
    block that is entered after the limit is interrupted at once.
    """

    def __init__(self, seconds: float | None) -> None:
        self._end = None if seconds is None else time.monotonic() + seconds
        self._lock = threading.Lock()
        self._timer: threading.Timer | None = None

    @property
    def passed(self) -> bool:
        """Whether the time is over."""
        return self._end is not None and time.monotonic() >= self._end

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
            timer = threading.Timer(self._end - time.monotonic(), self._interrupt)
            timer.daemon = True
            self._timer = timer
            timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()

    def _interrupt(self) -> None:
        # Under the lock: nobody who has left the block is interrupted any more.
        with self._lock:
            main = threading.main_thread().ident
            if self._timer is not None and main is not None:
                signal.pthread_kill(main, signal.SIGINT)
