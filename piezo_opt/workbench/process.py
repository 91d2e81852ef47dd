"""A worker process; the first one is a copy of the server, and has loaded what that has."""

from __future__ import annotations

import multiprocessing
import socket
import sys
import threading
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, final


@final
@dataclass(frozen=True)
class Worker:
    """A process and this side of the pipe to it."""

    process: BaseProcess
    pipe: Connection


def begin(*own: socket.socket) -> Worker:
    """Begin a worker; it ends with this process at the latest.

    A copy of this process is there at once, where another one would take half a second to load
    numpy; but only a process without other threads can be copied, and on Linux alone.

    Args:
        own: sockets of this process, which a copy closes.
    """
    alone = sys.platform == "linux" and threading.active_count() == 1
    context: Any = multiprocessing.get_context("fork" if alone else "spawn")
    here, there = context.Pipe()
    process = context.Process(target=_run, args=(there, (here, *own) if alone else ()), daemon=True)
    process.start()
    there.close()
    return Worker(process, here)


def _run(connection: Connection, copied: tuple[Connection | socket.socket, ...]) -> None:
    for one in copied:
        one.close()
    from piezo_opt.workbench.worker import run

    run(connection)
