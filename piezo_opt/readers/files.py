"""What every reader and writer asks of the file system, answered in one sentence when it fails."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from piezo_opt.errors import InputError

LARGEST_FILE = 2 * 1024**3
"""[bytes] Larger files are refused."""
MOST_ROWS = 50_000_000
"""Longer records are refused."""


def checked(path: str | os.PathLike[str]) -> Path:
    """The path of an existing, readable, ordinary file of bearable size; else `InputError`."""
    file = Path(path)
    try:
        if not file.exists():
            raise InputError(f"{file}: there is no such file: check the path")
        if file.is_dir():
            raise InputError(f"{file}: is a directory: name a file in it")
        if not file.is_file():
            raise InputError(f"{file}: is not an ordinary file: copy the record to one")
        size = file.stat().st_size
        if size > LARGEST_FILE:
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


def refuse_rows(file: Path, rows: int) -> None:
    """Raise `InputError` for more rows than a record may have."""
    if rows > MOST_ROWS:
        raise InputError(
            f"{file}: has more than {MOST_ROWS} samples: cut the record into slices and read one"
        )


@contextmanager
def replacing(path: str | os.PathLike[str], *, overwrite: bool) -> Iterator[Path]:
    """A temporary file beside ``path`` that takes its place when the block succeeds.

    A reader sees the old file or the new one, never half of it; a failure leaves the old one.
    Raises `InputError` when the file exists and may not be overwritten, or cannot be written.
    """
    target = Path(path)
    exists = f"{target}: exists already: choose another name or pass overwrite=True"
    if target.is_dir():
        raise InputError(f"{target}: is a directory: name a file in it")
    if not target.parent.is_dir():
        raise InputError(f"{target.parent}: there is no such directory: make it first")
    if target.exists() and not overwrite:
        raise InputError(exists)
    temporary = target.with_name(f".{target.stem[:40]}.{secrets.token_hex(6)}{target.suffix}")
    try:
        yield temporary
        if overwrite:
            temporary.replace(target)
        else:
            # A link fails when somebody else has made the file meanwhile; a rename would not.
            os.link(temporary, target)
    except FileExistsError as error:
        raise InputError(exists) from error
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)
