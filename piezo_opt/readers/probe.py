"""Whether a file can be read at all, tried where a crash does no harm.

HDF5 files of the old kind have metadata without checksums, and one wrong byte in them can end the
process or keep it in a loop. They are read once by a process of their own; those of the new kind,
which this package writes, notice such a byte by themselves.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Final

_SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"
_PLACES: Final = (0, 512, 1024, 2048)
_PATIENCE_S: Final = 10.0
"""Nothing that hangs is waited for longer; a large file has a second more for each 50 MB."""
_BYTES_A_SECOND: Final = 5e7
_READ_ALL: Final = """
import sys
import h5py

def visit(name, item):
    dict(item.attrs)
    if isinstance(item, h5py.Dataset) and item.shape:
        if item.size <= 400_000_000:
            item[()]

try:
    with h5py.File(sys.argv[1], "r") as file:
        dict(file.attrs)
        file.visititems(visit)
except Exception:
    pass
"""


def survives(file: Path) -> bool:
    """Whether reading all of an HDF5 file ends; an error that the library raises is an end."""
    if not _unchecked(file):
        return True
    patience = _PATIENCE_S + file.stat().st_size / _BYTES_A_SECOND
    try:
        done = subprocess.run(
            [sys.executable, "-c", _READ_ALL, str(file)],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=patience,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False
    except OSError:
        return True  # no second process here: the first one takes the risk
    return done.returncode == 0


def _unchecked(file: Path) -> bool:
    """Whether the file's metadata have no checksums: a superblock before version 2."""
    with file.open("rb") as content:
        for place in _PLACES:
            content.seek(place)
            head = content.read(9)
            if head[:8] == _SIGNATURE:
                return len(head) > 8 and head[8] < 2
    return False
