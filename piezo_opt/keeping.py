"""What takes long to make and is the same every time, kept in files between processes.

A file is named by the hash of all that its content follows from, and begins with the hash of that
content: one that has been cut off or changed is made again. Two processes may make the same at
once: each writes a file of its own and renames it into place, which is atomic. Where nothing can
be written, nothing is kept.

The directory belongs to its user alone, because what lies in it is executed. Once a day what has
not been used for long, or is too much, and what killed processes have left, is removed.

Environment: ``PIEZO_OPT_CACHE`` is the directory.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeVar

from piezo_opt.errors import InputError

_Made = TypeVar("_Made")

_DIGITS: Final = 32
"""Of a hash that stand in a name."""
DAY: Final = 86400.0
"""[s]; a build takes seconds: what is still half made after a day was killed."""
UNUSED: Final = 60 * DAY
"""[s] after which what was not used is removed; making it again takes a second or two."""
MOST_BYTES: Final = 1 << 30
"""What may be kept in all: some ten thousand programs."""
_LAST: Final = ".pruned"


def cache_directory() -> Path:
    """Where things are kept: ``PIEZO_OPT_CACHE``, else below the user's cache directory."""
    wished = os.environ.get("PIEZO_OPT_CACHE")
    if wished:
        return Path(wished)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "piezo_opt"


def own_directory() -> Path:
    """The cache directory, made or set to be for its user alone.

    Raises:
        InputError: it belongs to another user, others can write there, or it is a file.
        OSError: it cannot be made.
    """
    directory = cache_directory()
    try:
        directory.mkdir(parents=True, exist_ok=True, mode=0o700)
    except (FileExistsError, NotADirectoryError):
        raise InputError(
            f"The cache {directory} is no directory: set PIEZO_OPT_CACHE to one of your own."
        ) from None
    if not hasattr(os, "getuid"):
        return directory  # where there are no such owners, the system's own rights hold
    found = directory.stat()
    if found.st_uid != os.getuid():
        raise InputError(
            f"The cache {directory} belongs to another user, and what lies in it is executed: set "
            "PIEZO_OPT_CACHE to a directory of your own."
        )
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise InputError(
            f"Others can write to the cache {directory}, and what lies in it is executed: remove "
            "it, or set PIEZO_OPT_CACHE to a directory that only you can write to."
        )
    if found.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        directory.chmod(stat.S_IRWXU)
        _remove_planted(directory)
    return directory


def _remove_planted(directory: Path) -> None:
    """What others could write to, while they could enter, is not to be believed."""
    for child in _children(directory):
        with contextlib.suppress(OSError):
            found = child.lstat()
            open_to_others = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
            if found.st_uid == os.getuid() and not open_to_others:
                continue
            if stat.S_ISDIR(found.st_mode):
                shutil.rmtree(child, ignore_errors=True)
            else:
                child.unlink()


def used(path: Path) -> None:
    """Note that a file or folder of the cache is in use."""
    with contextlib.suppress(OSError):
        os.utime(path)


def prune(directory: Path, *, most_bytes: int = MOST_BYTES, unused: float = UNUSED) -> None:
    """Remove what is old, too much, or left by killed processes; once a day at most.

    Programs that are in use stay loaded, whatever happens to their files.

    Args:
        directory: the cache.
        most_bytes: what may be kept; what was used last goes last.
        unused: [s] after which anything goes.
    """
    now, mark = time.time(), directory / _LAST
    with contextlib.suppress(OSError):
        if now - mark.stat().st_mtime < DAY:
            return
    with contextlib.suppress(OSError):
        mark.touch()
        os.utime(mark)
    entries = []
    for path in (p for top in _children(directory) for p in (top, *_children(top))):
        with contextlib.suppress(OSError):
            age = now - path.stat().st_mtime
            if path.name.startswith(".build_"):
                if age > DAY:
                    shutil.rmtree(path, ignore_errors=True)
            elif path.is_file() and path != mark and not path.parent.name.startswith(".build_"):
                # A program counts by its folder, which is touched when it is loaded.
                age = min(age, now - path.parent.stat().st_mtime)
                entries.append((age, path.stat().st_size, path))
    kept_bytes = 0
    for age, size, path in sorted(entries):
        kept_bytes += size
        if age > unused or kept_bytes > most_bytes:
            with contextlib.suppress(OSError):
                path.unlink()
    for folder in _children(directory):
        with contextlib.suppress(OSError):
            if folder.is_dir() and now - folder.stat().st_mtime > DAY:
                folder.rmdir()  # refused unless it is empty


def _children(directory: Path) -> list[Path]:
    try:
        return sorted(directory.iterdir()) if directory.is_dir() else []
    except OSError:
        return []


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
        own_directory()
        known, _, text = file.read_bytes().partition(b"\n")
        if known.decode(errors="replace") == digest(text):
            used(file)
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
