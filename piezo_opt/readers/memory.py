"""HDF5 files that are made in memory and written in one go.

The library cannot tell a full disk apart from the end of the world: objects that it could not write
raise while they are collected, or end the process. So it never writes to a disk here.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def hdf5_in_memory(path: Path, *, begin: Path | None = None) -> Iterator[Any]:
    """An open file in memory, which goes to ``path`` when the block succeeds.

    Args:
        path: the file to write.
        begin: the file whose content it begins with; empty without one.

    Raises:
        OSError: it cannot be written.
    """
    import h5py

    mode, name = ("w", path) if begin is None else ("r+", begin)
    options = {"driver": "core", "backing_store": False, "libver": ("v110", "v110")}
    with h5py.File(name, mode, **options) as file:
        yield file
        file.flush()
        content = file.id.get_file_image()
    path.write_bytes(content)
