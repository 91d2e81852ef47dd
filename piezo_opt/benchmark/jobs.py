"""Independent jobs on any executor, in the order in which they finish."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from typing import TypeVar

Job = TypeVar("Job")
Answer = TypeVar("Answer")

Counted = Callable[[int, int], None]
"""Progress of a benchmark: jobs done, jobs in all."""


def run_jobs(
    work: Callable[[Job], Answer],
    jobs: Sequence[Job],
    executor: Executor | None,
    progress: Counted | None,
) -> Iterator[Answer]:
    """Answers as they come; when the caller stops, what has not begun is cancelled."""
    done = 0
    if executor is None:
        for job in jobs:
            answer = work(job)
            done += 1
            if progress is not None:
                progress(done, len(jobs))
            yield answer
        return
    futures = [executor.submit(work, job) for job in jobs]
    try:
        for future in as_completed(futures):
            answer = future.result()
            done += 1
            if progress is not None:
                progress(done, len(jobs))
            yield answer
    finally:
        for future in futures:
            future.cancel()
