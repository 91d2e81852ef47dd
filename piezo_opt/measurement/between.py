"""What the drive does where nobody looked: between two samples."""

from __future__ import annotations

from enum import Enum


class Between(Enum):
    """How the drive moves between two samples."""

    LINEAR = "linear"
    """On a straight line: a measured voltage, a ramp."""
    HELD = "held"
    """Constant, then a step at the next sample: a digital-to-analogue converter."""
    BANDLIMITED = "bandlimited"
    """The one smooth signal without content above half the sampling rate: a filtered multisine."""
    UNKNOWN = "unknown"
    """Nobody has said: on a straight line, until a first fit tells (``as_driven``)."""
