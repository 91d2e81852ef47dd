"""Whether a file can be read at all, tried where a crash does no harm.

One wrong byte in an HDF5 file can end the process that reads it or keep it in a loop, with
checksums in its metadata or without: text of any length lies in a heap that has none. Files are
read once by a process of their own. Those that this package writes hold nothing of the kind and
notice a wrong byte by themselves.
"""

from __future__ import annotations

import math
import subprocess
import sys
from functools import lru_cache
from pathlib import Path
from typing import Final

_SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"
OWN: Final = "piezo_opt records"
"""What a file of this package calls its format; its text stands in the first bytes."""
_HEAD: Final = 4096
_PATIENCE_S: Final = 6.0
"""Processor time of a try; a large file has a second more for each 50 MB. What hangs in a file is
busy, and a good file on a loaded machine is not."""
_LOADED: Final = 10.0
"""Seconds that pass while a loaded machine gives one."""
_BYTES_A_SECOND: Final = 5e7
_READ_ALL: Final = """
import sys
try:
    import resource
    resource.setrlimit(resource.RLIMIT_CPU, (int(sys.argv[2]), int(sys.argv[2])))
except ImportError:
    pass
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
    if not _foreign(file):
        return True
    known = file.stat()
    patience = _PATIENCE_S + known.st_size / _BYTES_A_SECOND
    return _tried(str(file.resolve()), known.st_ino, known.st_mtime_ns, _READ_ALL, patience)


@lru_cache(maxsize=64)
def _tried(file: str, _number: int, _changed: int, program: str, patience: float) -> bool:
    """Whether a process that reads a file ends well; asked once for a file that stays as it is."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", program, file, str(math.ceil(patience))],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=patience * _LOADED,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False
    except OSError:
        return True  # no second process here: the first one takes the risk
    return done.returncode == 0


def _foreign(file: Path) -> bool:
    """Whether a file is HDF5 and not in this package's layout.

    Such a file begins at 0 or, behind a block of its user's own, at a power of two from 512.
    """
    with file.open("rb") as content:
        head = content.read(_HEAD)
        if head[:8] == _SIGNATURE:
            return not (head[8:9] >= b"\x02" and OWN.encode() in head)
        place, size = 512, file.stat().st_size
        while place < size:
            content.seek(place)
            if content.read(8) == _SIGNATURE:
                return True
            place *= 2
    return False
