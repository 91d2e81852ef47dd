"""What large arrays leave behind when they are freed."""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from typing import Final

_TRIM, _MAPPED = -1, -3
"""Names of its choices in ``malloc.h``."""
_LARGE: Final = 1 << 20
"""Bytes from which an array is large: the derivatives of some ten thousand samples."""
_KEPT: Final = 8 << 20
"""Bytes that may wait at the end of the heap for what comes next."""


@cache
def give_back() -> None:
    """Let the system have large arrays as soon as nobody needs them.

    The GNU C library begins so, but holds on to ever larger ones, among which small things come to
    lie: a search leaves a third of its memory behind like that. Other C libraries are left alone.
    """
    if sys.platform == "linux":
        choose = getattr(ctypes.CDLL(None), "mallopt", None)
        if choose is not None:
            choose(_MAPPED, _LARGE)
            choose(_TRIM, _KEPT)
