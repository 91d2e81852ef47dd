"""Pools of threads that stop when they are told to."""

from __future__ import annotations

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
