"""Advised drives as files that can be played."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from piezo_opt.diagnosis.advice.experiment import Advice
from piezo_opt.errors import InputError


def write_drives(
    experiments: Sequence[Advice], directory: str | os.PathLike[str], *, overwrite: bool = False
) -> tuple[Path, ...]:
    """Write the drive of each experiment as a CSV that can be played; the files written.

    Args:
        experiments: ``diagnosis.experiments``.
        directory: an existing folder.
        overwrite: replace files that exist.

    Raises:
        InputError: there is no such folder, a file exists, or it cannot be written.
    """
    folder = Path(directory)
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such directory: make it first")
    chosen = {f"{one.drive.name}.csv": one for one in experiments}
    for name in chosen:
        if (folder / name).exists() and not overwrite:
            raise InputError(
                f"{folder / name}: exists already: choose another directory or pass overwrite=True"
            )
    for name, one in chosen.items():
        one.drive.write(folder / name, one.rate, overwrite=overwrite)
    return tuple(folder / name for name in chosen)
