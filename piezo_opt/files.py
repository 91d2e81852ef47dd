"""What every reader and writer asks of the file system, answered in one sentence when it fails."""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from piezo_opt.errors import InputError

LARGEST_FILE = 2 * 1024**3
"""[bytes] Larger files are refused."""
MOST_ROWS = 50_000_000
"""Longer records are refused."""


def checked(path: str | os.PathLike[str], *, largest: int | None = LARGEST_FILE) -> Path:
    """The path of an existing, readable, ordinary file of bearable size; else `InputError`."""
    _refuse_others(path, "The file")
    file = Path(path)
    try:
        if not file.exists():
            raise InputError(f"{file}: there is no such file: check the path")
        if file.is_dir():
            raise InputError(f"{file}: is a directory: name a file in it")
        if not file.is_file():
            raise InputError(f"{file}: is not an ordinary file: copy the record to one")
        size = file.stat().st_size
        if largest is not None and size > largest:
            raise InputError(
                f"{file}: has {size / 1024**3:.1f} GiB, more than "
                f"{LARGEST_FILE / 1024**3:.0f}: cut the record into slices and read one"
            )
        if size == 0:
            raise InputError(f"{file}: is empty: export the record again")
        with file.open("rb"):
            pass
    except InputError:
        raise
    except PermissionError as error:
        raise InputError(f"{file}: may not be read: change its permissions") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{str(file)!r}: cannot be opened: {error}") from error
    return file


def _refuse_others(path: object, what: str) -> None:
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"{what} is {path!r}: give its path.")


def refuse_rows(file: Path, rows: int) -> None:
    """Raise `InputError` for more rows than a record may have."""
    if rows > MOST_ROWS:
        raise InputError(
            f"{file}: has more than {MOST_ROWS} samples: cut the record into slices and read one"
        )


def target_of(path: str | os.PathLike[str]) -> Path:
    """The file that an output goes to: the path itself, or what a link at that place leads to.

    Raises:
        InputError: it is a folder, a device, a pipe or a socket, its name is too long, or there is
            no folder to write it into.
    """
    _refuse_others(path, "The file to write")
    asked = Path(path)
    try:
        target = Path(os.path.realpath(asked, strict=False))
        kind = target.stat().st_mode if target.exists() else None
        folder, longest = target.parent.is_dir(), _longest_name(target.parent)
    except (OSError, ValueError) as error:
        what = getattr(error, "strerror", None) or error
        raise InputError(f"{str(asked)!r}: cannot be written: {what}: choose another") from error
    if kind is not None and stat.S_ISDIR(kind):
        raise InputError(f"{asked}: is a directory: name a file in it")
    if kind is not None and not stat.S_ISREG(kind):
        raise InputError(f"{asked}: is a device, a pipe or a socket, not a file: name a file")
    if not folder:
        raise InputError(f"{asked}: there is no folder {asked.parent}: make it first")
    if len(os.fsencode(target.name)) > longest:
        raise InputError(f"{str(asked)[:60]}...: the name is too long: choose a shorter one")
    if target.is_symlink():
        raise InputError(f"{asked}: is a link that leads in a circle: name a file")
    return target


def _longest_name(folder: Path) -> int:
    """[bytes] that a name in this folder may have; what is common where nobody knows."""
    try:
        return os.pathconf(folder, "PC_NAME_MAX")
    except (AttributeError, OSError, ValueError):
        return 255


@contextmanager
def replacing(path: str | os.PathLike[str], *, overwrite: bool) -> Iterator[Path]:
    """A temporary file beside ``path`` that takes its place when the block succeeds.

    A reader sees the old file or the new one, never half of it; a failure leaves the old one, and
    nothing else. A link keeps leading to where it led. Raises `InputError` when the file exists and
    may not be overwritten, is none, or cannot be written.
    """
    target = target_of(path)
    # Any text is true, "no" as well, and would replace a file.
    if not isinstance(overwrite, bool):
        raise InputError(f"overwrite is {overwrite!r}: give True or False.")
    exists = f"{path}: exists already: choose another name or pass overwrite=True"
    if target.exists() and not overwrite:
        raise InputError(exists)
    # A name of forty letters at most, whatever the target's: it must not be too long itself.
    stem, suffix = target.stem[:10], target.suffix[:10]
    temporary = target.with_name(f".{stem}.{secrets.token_hex(6)}{suffix}")
    try:
        yield temporary
        if overwrite:
            temporary.replace(target)
        else:
            _put(temporary, target)
    except FileExistsError as error:
        raise InputError(exists) from error
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {_why(error)}") from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _put(temporary: Path, target: Path) -> None:
    """Give a file its name, unless somebody else has made one of that name meanwhile."""
    try:
        # A link fails when the name is taken; a rename would not.
        os.link(temporary, target)
    except FileExistsError:
        raise
    except OSError:
        # Not every file system has such links (sticks, network drives).
        if target.exists():
            raise FileExistsError(str(target)) from None
        temporary.replace(target)


def _why(error: OSError) -> str:
    """The system's reason; libraries hide it in their own sentences."""
    text = error.strerror or str(error)
    if error.errno == errno.ENOSPC or "No space left" in text:
        return "the disk is full: make room"
    if error.errno == errno.EFBIG or "File too large" in text:
        return "the file is larger than the system allows"
    return text
