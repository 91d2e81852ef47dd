"""A new folder, whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from piezo_opt.errors import InputError


def check_new(path: str | os.PathLike[str]) -> Path:
    """The path of a folder that is not there yet, in one that is.

    Raises:
        InputError: it exists, or there is nothing to put it into.
    """
    target = Path(path)
    if target.exists() or target.is_symlink():
        raise InputError(f"{target}: exists already: choose another name, or remove it first")
    if not target.absolute().parent.is_dir():
        raise InputError(f"{target.parent}: there is no such folder: make it first")
    return target


@contextmanager
def appearing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A folder beside ``path`` that takes its name when the block succeeds, and else is gone.

    Raises:
        InputError: as :func:`check_new`, or the folder cannot be written.
    """
    target = check_new(path)
    beside = target.absolute().with_name(f".{target.name[:40]}.{secrets.token_hex(6)}")
    try:
        beside.mkdir()
        yield beside
        check_new(target)
        beside.rename(target)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)
