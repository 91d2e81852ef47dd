"""Where a clock begins anew: several runs that were written into one file."""

from __future__ import annotations

import numpy as np

from piezo_opt.measurement import FloatArray
from piezo_opt.measurement.arrays import IndexArray

_SHORTEST = 3
"""Samples of a run: fewer are rows in a wrong order."""


def restarts(time: FloatArray) -> IndexArray:
    """First samples of the second and later runs, (R,); none where the clock only goes back.

    A run begins where the clock falls to where the first run began, or before it. Instants of a
    wrong order fall to somewhere between.
    """
    falls = np.flatnonzero(np.diff(time) <= 0.0) + 1
    ends = np.array([0, *falls, time.size])
    if falls.size == 0 or np.min(np.diff(ends)) < _SHORTEST:
        return np.zeros(0, dtype=np.intp)
    # Rounding of a printed clock, far below a step.
    slack = 1e-9 * float(np.ptp(time))
    return falls if np.all(time[falls] <= time[0] + slack) else np.zeros(0, dtype=np.intp)
