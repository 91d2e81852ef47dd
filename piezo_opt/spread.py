"""Independent jobs on any executor: what they share travels once, and a dead worker loses nothing.

The shared part (records, a question) is written once to a file that is named by the hash of its
content, and every process that gets a job opens it once. An executor of Dask is handed it by
``scatter`` instead; a worker that sees neither is sent it with its next job. So a job itself is
small, whatever the size of the records.

When processes die (out of memory, killed by a scheduler), finished answers are kept, and what was
not finished goes on in new processes; a job that dies on its own, alone in a process, is given up
with a sentence, and the others go on.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import pickle
import signal
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, TypeVar, final

Shared = TypeVar("Shared")
Job = TypeVar("Job")
Answer = TypeVar("Answer")

_AT_ONCE: Final = 256
"""Jobs handed over and not answered: enough for any number of workers that one person has, and few
enough that looking through them takes no time."""
_OPEN: Final = 4
"""Shared parts that a process keeps open."""
_ALONE: Final = 2
"""Deaths among others after which a job is run alone."""


@final
@dataclass(frozen=True)
class Lost:
    """A job without an answer, and a sentence of why."""

    sentence: str


@final
@dataclass(frozen=True, eq=False)
class Parcel:
    """What all jobs share, known by its content wherever it is.

    Attributes:
        key: hash of the content.
        path: file that holds it.
        content: the content itself, where the file cannot be seen.
    """

    key: str
    path: str
    content: bytes | None = None

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Parcel) and other.key == self.key


@final
class NotHere(Exception):
    """A worker sees no file with the shared part."""


def spread(
    work: Callable[[Shared, Job], Answer],
    shared: Shared,
    jobs: Sequence[Job],
    executor: Executor | None,
) -> Iterator[tuple[int, Answer | Lost]]:
    """Answers to ``work(shared, job)`` with the jobs' numbers, in the order in which they finish.

    Args:
        work: a function of a module, which other processes can import.
        shared: goes to every process once.
        jobs: small.
        executor: None works here, one after the other.

    When the caller stops, what has not begun is cancelled. What ``work`` raises is raised here.
    """
    if executor is None:
        for index, job in enumerate(jobs):
            yield index, work(shared, job)
        return
    if isinstance(executor, ThreadPoolExecutor):
        yield from _Spread(work, jobs, executor).answers(shared, shared)
        return
    with _parcel(shared) as parcel:
        yield from _Spread(_opening, [(work, job) for job in jobs], executor).answers(
            _scattered(executor, parcel), parcel
        )


def _opening(parcel: Parcel, job: tuple[Callable[[Any, Any], Any], Any]) -> Any:
    work, own = job
    return work(_opened(parcel), own)


@lru_cache(maxsize=_OPEN)
def _opened(parcel: Parcel) -> Any:
    content = parcel.content
    if content is None:
        try:
            content = Path(parcel.path).read_bytes()
        except OSError:
            raise NotHere from None
        if hashlib.sha256(content).hexdigest() != parcel.key:
            raise NotHere
    return pickle.loads(content)


@contextmanager
def _parcel(shared: object) -> Iterator[Parcel]:
    """The shared part in a file, in a folder of this user's alone."""
    content = pickle.dumps(shared, protocol=pickle.HIGHEST_PROTOCOL)
    key = hashlib.sha256(content).hexdigest()
    with tempfile.TemporaryDirectory(prefix="piezo_opt_") as folder:
        path = Path(folder) / key
        path.write_bytes(content)
        yield Parcel(key, str(path), content)


def _scattered(executor: Executor, parcel: Parcel) -> Any:
    """How jobs name the shared part: Dask's own reference, or the file's name."""
    scatter = _scatters(executor)
    return replace(parcel, content=None) if scatter is None else scatter(parcel, broadcast=True)


def _scatters(executor: Executor) -> Callable[..., Any] | None:
    """How a Dask client lays data beside its workers."""
    found: Callable[..., Any] | None = getattr(getattr(executor, "_client", None), "scatter", None)
    return found


@final
class _Spread:
    """Jobs under way, which deaths they have seen, and where they run now."""

    def __init__(
        self, work: Callable[[Any, Any], Any], jobs: Sequence[Any], executor: Executor
    ) -> None:
        self._work = work
        self._jobs = jobs
        self._executor = executor
        self._own: ProcessPoolExecutor | None = None
        self._workers = int(getattr(executor, "_max_workers", 0) or os.cpu_count() or 1)
        self._context = getattr(executor, "_mp_context", None)
        self._deaths: Counter[int] = Counter()
        # Dask takes equal calls for the same call, and a second attempt for the first.
        self._said = {"pure": False} if _scatters(executor) else {}

    def answers(self, named: Any, whole: Any) -> Iterator[tuple[int, Any]]:
        """All answers.

        Args:
            named: the shared part as jobs name it.
            whole: the same as a worker can be sent it that does not find it by that name.
        """
        waiting = list(range(len(self._jobs)))[::-1]
        running: dict[Future[Any], int] = {}
        unseen: set[int] = set()
        try:
            while waiting or running:
                room = _AT_ONCE if not self._deaths else self._workers
                while waiting and len(running) < room:
                    if self._deaths[waiting[-1]] >= _ALONE:
                        if running:
                            break
                        room = 1
                    index = waiting.pop()
                    shared = whole if index in unseen else named
                    try:
                        future = self._submitted(index, shared)
                    except BrokenExecutor:
                        waiting.append(index)
                        self._renew()
                        continue
                    running[future] = index
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                broken = False
                for future in done:
                    index = running.pop(future)
                    try:
                        answer = future.result()
                    except NotHere:
                        unseen.add(index)
                        waiting.append(index)
                    except (BrokenExecutor, CancelledError) as error:
                        broken |= isinstance(error, BrokenExecutor)
                        yield from self._died(index, error, waiting, unseen)
                    except Exception as error:
                        if not self._of_the_executor(error):
                            raise
                        yield from self._died(index, error, waiting, unseen)
                    else:
                        yield index, answer
                if broken:
                    self._renew()
        finally:
            for future in running:
                future.cancel()
            if self._own is not None:
                self._own.shutdown(wait=False, cancel_futures=True)

    def _died(
        self, index: int, error: BaseException, waiting: list[int], unseen: set[int]
    ) -> Iterator[tuple[int, Lost]]:
        """Try a job again whose worker died, or give it up."""
        self._deaths[index] += 1
        unseen.add(index)
        if self._deaths[index] <= _ALONE:
            # Those that may be the cause come last: the others are in safety by then.
            waiting.insert(0, index)
            return
        told = " ".join(str(error).split()) or type(error).__name__
        yield index, Lost(f"The process that worked on it died {_ALONE + 1} times ({told}).")

    def _submitted(self, index: int, shared: Any) -> Future[Any]:
        if self._own is not None and self._deaths[index] >= _ALONE and self._workers > 1:
            self._workers = 1
            self._renew()
        if self._own is not None:
            return self._own.submit(self._work, shared, self._jobs[index])
        return self._executor.submit(self._work, shared, self._jobs[index], **self._said)

    def _renew(self) -> None:
        """New processes beside an executor that cannot be used any more."""
        if self._own is not None:
            self._own.shutdown(wait=False, cancel_futures=True)
        context = self._context or multiprocessing.get_context("spawn")
        self._own = ProcessPoolExecutor(self._workers, mp_context=context, initializer=deaf)

    def _of_the_executor(self, error: Exception) -> bool:
        """Whether an error is the executor's own, a worker that was killed, and not the work's."""
        mine = type(self._executor).__module__.partition(".")[0]
        return mine != "concurrent" and type(error).__module__.partition(".")[0] == mine


def deaf() -> None:
    """Ctrl-C reaches every process of a terminal; only the first one answers it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
