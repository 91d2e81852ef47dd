"""A worker process, begun before anything heavy is loaded: both sides load at the same time."""

from __future__ import annotations

import multiprocessing
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import final


@final
@dataclass(frozen=True)
class Worker:
    """A process and this side of the pipe to it."""

    process: SpawnProcess
    pipe: Connection


def begin() -> Worker:
    """Begin a worker; it ends with this process at the latest."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_run, args=(there,), daemon=True)
    process.start()
    there.close()
    return Worker(process, here)


def _run(connection: Connection) -> None:
    from piezo_opt.workbench.worker import run

    run(connection)
