"""Independent jobs on any executor, in the order in which they finish."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from typing import TypeVar

from piezo_opt.spread import Lost, spread

Shared = TypeVar("Shared")
Job = TypeVar("Job")
Answer = TypeVar("Answer")

Counted = Callable[[int, int], None]
"""Progress of a benchmark: jobs done, jobs in all."""


def run_jobs(
    work: Callable[[Shared, Job], Answer],
    shared: Shared,
    jobs: Sequence[Job],
    executor: Executor | None,
    progress: Counted | None,
    lost: Callable[[Job, str], Answer],
) -> Iterator[Answer]:
    """Answers as they come; when the caller stops, what has not begun is cancelled.

    Args:
        work: what is to be done, as for :func:`piezo_opt.spread.spread`.
        shared: what all jobs need; travels to each worker once.
        jobs: small.
        executor: None works here, one after the other.
        progress: called after each.
        lost: the answer for a job whose worker died again and again, and the sentence of why.
    """
    answers = spread(work, shared, jobs, executor)
    for done, (index, answer) in enumerate(answers, start=1):
        if progress is not None:
            progress(done, len(jobs))
        yield lost(jobs[index], answer.sentence) if isinstance(answer, Lost) else answer
