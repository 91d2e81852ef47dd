"""From a session to a page that is served on this machine, until Ctrl-C."""

from __future__ import annotations

import contextlib
import secrets
import socket
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from types import FrameType

from piezo_opt.errors import InputError
from piezo_opt.workbench.session import Session


def serve(
    session: Session,
    file: Path,
    *,
    port: int = 0,
    ready: Callable[[str], None] | None = None,
) -> None:
    """Serve a session on the loopback address until the process is interrupted.

    Args:
        session: where it begins.
        file: where every step is kept.
        port: to listen on; 0 takes a free one.
        ready: called with the address, once it is answered.

    Raises:
        InputError: the extra is not installed, or the port is taken.
    """
    for needed in ("uvicorn", "starlette"):
        if find_spec(needed) is None:
            raise InputError(f"The workbench needs {needed}: pip install 'piezo_opt[workbench]'")
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    with listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            raise InputError(
                f"--port {port}: cannot be listened on ({error}): choose another"
            ) from None
        listening.listen(128)
        taken, token = listening.getsockname()[1], secrets.token_urlsafe(24)
        if ready is not None:
            # From here on the system holds a connection until the server answers it.
            ready(f"http://127.0.0.1:{taken}/{token}/")
        # The browser begins while numpy is loaded, and the records are read while the server is.
        from piezo_opt.workbench.bench import Bench

        bench = Bench(session, file)
        bench.ahead(listening)

        import uvicorn

        from piezo_opt.workbench.app import application

        class Ending(uvicorn.Server):
            """Lets the pages go when it is asked to end, or it would wait for them, and say so."""

            def handle_exit(self, sig: int, frame: FrameType | None) -> None:
                super().handle_exit(sig, frame)
                bench.let_go()

        # No log of requests: their addresses hold the token.
        config = uvicorn.Config(
            application(bench, token, taken), log_level="error", access_log=False,
            server_header=False, timeout_graceful_shutdown=1, ws="none",
        )  # fmt: skip
        with contextlib.suppress(KeyboardInterrupt):
            Ending(config).run(sockets=[listening])
