"""Jobs on any executor: shared once, none lost."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import get_all_start_methods, get_context
from pathlib import Path
from typing import Any, final

import pytest

from piezo_opt.spread import Lost, Parcel, spread

METHOD = "fork" if "fork" in get_all_start_methods() else "spawn"
OPENED: list[int] = []
PACKED: list[int] = []


@final
class Heavy:
    """A record that counts how often it is packed and opened, in each process."""

    def __init__(self, folder: Path, number: float = 2.0) -> None:
        self.folder = folder
        self.number = number

    def __getstate__(self) -> dict[str, Any]:
        PACKED.append(1)
        return self.__dict__

    def __setstate__(self, state: dict[str, Any]) -> None:
        OPENED.append(1)
        self.__dict__.update(state)


def times(shared: Heavy, job: int) -> tuple[float, int, int]:
    return shared.number * job, len(OPENED), os.getpid()


def deadly(shared: Heavy, job: int) -> int:
    """Job 3 kills its process once, job 5 whenever it is tried."""
    mark = shared.folder / f"died_{job}_{os.getpid()}"
    if job == 5 or (job == 3 and not list(shared.folder.glob("died_3_*"))):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.01)
    return 10 * job


def wrong(shared: Heavy, job: int) -> float:
    return shared.number / job


@contextmanager
def processes() -> Iterator[Executor]:
    OPENED.clear()
    PACKED.clear()
    # Forked, because they begin at once; the jobs touch nothing that has threads.
    with ProcessPoolExecutor(2, mp_context=get_context(METHOD)) as pool:
        yield pool


@pytest.mark.parametrize("inside", [lambda: None, lambda: ThreadPoolExecutor(2)])
def test_within_a_process_nothing_is_packed(
    inside: Callable[[], Executor | None], tmp_path: Path
) -> None:
    PACKED.clear()
    answers = dict(spread(times, Heavy(tmp_path), [4, 5, 6], inside()))
    assert {k: a[0] for k, a in answers.items() if not isinstance(a, Lost)} == {0: 8, 1: 10, 2: 12}
    assert PACKED == []


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_what_is_shared_travels_to_each_process_once(tmp_path: Path) -> None:
    with processes() as pool:
        answers = dict(spread(times, Heavy(tmp_path), list(range(40)), pool))
    assert sorted(answers) == list(range(40))
    assert [answers[k][0] for k in range(40)] == [2.0 * k for k in range(40)]  # type: ignore[index]
    assert len(PACKED) == 1
    assert {a[1] for a in answers.values()} == {1}  # type: ignore[index]
    assert os.getpid() not in {a[2] for a in answers.values()}  # type: ignore[index]


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_dead_processes_lose_one_job_that_kills_them_all_and_no_other(tmp_path: Path) -> None:
    with processes() as pool:
        answers = dict(spread(deadly, Heavy(tmp_path), list(range(8)), pool))
    lost = answers.pop(5)
    assert answers == {k: 10 * k for k in (0, 1, 2, 3, 4, 6, 7)}
    assert isinstance(lost, Lost)
    assert "died 3 times" in lost.sentence
    assert len(list(tmp_path.glob("died_3_*"))) == 1


@final
class Elsewhere(Executor):
    """Workers that see no file of this machine."""

    def __init__(self) -> None:
        self.sent = 0

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run here, as if far away."""
        parcel, job = args
        assert isinstance(parcel, Parcel)
        self.sent += parcel.content is not None
        done: Future[Any] = Future()
        try:
            done.set_result(fn(replace(parcel, path="/nowhere"), job))
        except Exception as error:
            done.set_exception(error)
        return done


def test_a_worker_that_sees_no_file_is_sent_the_content(tmp_path: Path) -> None:
    far = Elsewhere()
    answers = dict(spread(times, Heavy(tmp_path, 7.0), [1, 2], far))
    assert {k: a[0] for k, a in answers.items() if not isinstance(a, Lost)} == {0: 7.0, 1: 14.0}
    assert far.sent >= 1


def test_what_the_work_raises_is_raised() -> None:
    with ThreadPoolExecutor(1) as pool, pytest.raises(ZeroDivisionError):
        list(spread(wrong, Heavy(Path()), [1, 0], pool))


# Its own threads and sockets are closed by themselves, some time later.
@pytest.mark.filterwarnings("ignore")
def test_a_dask_cluster_is_an_executor(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    PACKED.clear()
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        pool = client.get_executor()
        answers = dict(spread(times, Heavy(tmp_path, 3.0), list(range(20)), pool))
        assert [answers[k][0] for k in range(20)] == [3.0 * k for k in range(20)]
        assert len(PACKED) == 1
        assert {a[1] for a in answers.values()} == {1}
        # Job 3 kills its worker once: Dask starts another, and nobody notices.
        died = dict(spread(deadly, Heavy(tmp_path), [0, 1, 2, 3, 4], pool))
        assert died == {k: 10 * k for k in range(5)}
        assert len(list(tmp_path.glob("died_3_*"))) == 1
