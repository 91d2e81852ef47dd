"""``piezo-opt workbench``: the whole story in a browser, on this machine only."""

from __future__ import annotations

import os
import time
import webbrowser
from pathlib import Path
from typing import Annotated

from piezo_opt.cli.declare import Argument, Option, echo
from piezo_opt.errors import InputError
from piezo_opt.keeping import own_directory


def workbench(
    records: Annotated[
        list[Path] | None,
        Argument(help="Record files: .csv, .h5, .mat and others."),
    ] = None,
    session: Annotated[
        Path | None,
        Option(
            metavar="FILE.json",
            help="Keep every step here; a file that exists is gone on with.",
        ),
    ] = None,
    port: Annotated[
        int, Option(min=0, max=65535, metavar="N", help="To listen on; 0 takes a free one.")
    ] = 0,
    browser: Annotated[bool, Option("--browser/--no-browser", help="Open the page.")] = True,
) -> None:
    """Compare, see what is missing, add it and watch the error fall, in a browser.

    Serves a page on this machine only, at an address with a secret in it. Every step is kept in
    the session file at once; Ctrl-C ends the server. The page hands out the script that gives the
    same numbers without it.

    \b
    Examples:
      piezo-opt workbench loop.csv
      piezo-opt workbench first.csv second.csv --session loop.json
      piezo-opt workbench --session loop.json
    """
    from piezo_opt.workbench.load import Load, Source
    from piezo_opt.workbench.serve import serve
    from piezo_opt.workbench.session import Session, read_session

    paths = [path.absolute() for path in records or []]
    for path in paths:
        if not path.exists():
            raise InputError(f"{path}: there is no such file: check the path")
    if session is not None and session.exists():
        if paths:
            raise InputError(
                f"--session {session}: exists and has its records: leave them out to go on with "
                "it, or name a new file"
            )
        begun = read_session(session)
    else:
        begun = Session(Load(tuple(Source(str(path)) for path in paths)))
    file = _unnamed() if session is None else session.absolute()
    begun.save(file)

    def ready(address: str) -> None:
        echo(f"Workbench: {address}\nSession: {file}\nCtrl-C ends it.")
        if browser:
            webbrowser.open(address)

    serve(begun, file, port=port, ready=ready)


def _unnamed() -> Path:
    """A file of its own for a session that nobody has named."""
    folder = own_directory() / "workbench"
    folder.mkdir(mode=0o700, exist_ok=True)
    stem = time.strftime("session-%Y%m%d-%H%M%S")
    # The process is part of the name: two that begin in one second have two files.
    return folder / f"{stem}-{os.getpid()}.json"
