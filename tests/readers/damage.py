"""What happens to files."""

from __future__ import annotations

import numpy as np


def damaged(content: bytes, generator: np.random.Generator) -> bytes:
    """Bytes changed, a stretch of zeros or noise, or an end cut off."""
    wounded = bytearray(content)
    kind = generator.integers(4)
    place = int(generator.integers(len(content)))
    if kind == 0:
        for at in generator.integers(len(content), size=int(generator.integers(1, 6))):
            wounded[at] = int(generator.integers(256))
    elif kind == 1:
        length = int(generator.integers(1, 64))
        wounded[place : place + length] = generator.bytes(min(length, len(content) - place))
    elif kind == 2:
        wounded[place : place + 16] = bytes(min(16, len(content) - place))
    else:
        del wounded[place:]
    return bytes(wounded)
