"""A drive alone, as something else than the sensor's instrument recorded it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import final

import numpy as np

from piezo_opt.measurement import Between, FloatArray


@final
@dataclass(frozen=True, eq=False)
class DriveSignal:
    """A drive (N,) [unit] over its own clock (N,) [s]."""

    time: FloatArray
    values: FloatArray
    unit: str
    between: Between
    source: str | os.PathLike[str] = ""

    def at(self, time: FloatArray) -> FloatArray:
        """The drive at other instants (M,): held between samples, or by straight lines."""
        if self.between is Between.HELD:
            return self.values[np.searchsorted(self.time, time, side="right") - 1]
        return np.interp(time, self.time, self.values)
