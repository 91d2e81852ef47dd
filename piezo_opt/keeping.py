"""What takes long to make and is the same every time, kept in files between processes.

A file is named by the hash of all that its content follows from, and begins with the hash of that
content: one that has been cut off or changed is made again. Two processes may make the same at
once: each writes a file of its own and renames it into place, which is atomic. Where nothing can
be written, nothing is kept.

Environment: ``PIEZO_OPT_CACHE`` is the directory.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeVar

_Made = TypeVar("_Made")

_DIGITS: Final = 32
"""Of a hash that stand in a name."""


def cache_directory() -> Path:
    """Where things are kept: ``PIEZO_OPT_CACHE``, else below the user's cache directory."""
    wished = os.environ.get("PIEZO_OPT_CACHE")
    if wished:
        return Path(wished)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "piezo_opt"


def digest(content: bytes) -> str:
    """The hash by which content is known."""
    return hashlib.sha256(content).hexdigest()[:_DIGITS]


def kept(
    kind: str,
    origin: str,
    make: Callable[[], _Made],
    written: Callable[[_Made], str],
    read: Callable[[str], _Made],
) -> _Made:
    """A thing that another process may have made already; made and kept here if none has.

    Args:
        kind: what it is: the directory that it is kept in.
        origin: all that it follows from.
        make: makes it.
        written: the thing as a text.
        read: the thing of such a text.
    """
    file = cache_directory() / kind / digest(origin.encode())
    with contextlib.suppress(OSError):
        known, _, text = file.read_bytes().partition(b"\n")
        if known.decode(errors="replace") == digest(text):
            return read(text.decode())
    thing = make()
    text = written(thing).encode()
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".build_", dir=file.parent) as scratch:
            whole = Path(scratch) / "whole"
            whole.write_bytes(digest(text).encode() + b"\n" + text)
            os.replace(whole, file)
    return thing
