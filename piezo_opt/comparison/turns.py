"""Where a drive turns, steps and rests: what branches, half cycles and events are made of."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.measurement import FloatArray

IntArray = NDArray[np.int64]

_TURN: Final = 0.02
"""Share of the drive's range by which it must come back before a turn is believed: noise on a
measured drive turns at every sample."""
_STILL: Final = 0.01
"""Share of the drive's range within which it rests."""
_MOVED: Final = 0.05
"""Share of the drive's range by which it must have moved before a rest is an answer to it."""
_LONG: Final = 8
"""Samples that make a rest."""


def turning_points(drive: FloatArray) -> IntArray:
    """Indices where the drive turns, the first and the last sample included.

    A turn is an extremum from which the drive comes back by 2 % of its range. At a flat top
    the last sample of it counts, so that a hold belongs to the movement before it.
    """
    least = _TURN * float(np.ptp(drive))
    # Only strict changes matter; runs of equal values are represented by their last sample.
    ends = np.append(np.flatnonzero(np.diff(drive) != 0.0), drive.size - 1)
    # Between two local extrema nothing can turn: only those go through the loop.
    moves = np.sign(np.diff(drive[ends]))
    ends = ends[np.concatenate([[True], moves[1:] != moves[:-1], [True]])]
    values = drive[ends]
    found = [0]
    high = low = 0
    direction = 0
    for k in range(1, values.size):
        value = values[k]
        if direction >= 0 and value >= values[high]:
            high = k
        if direction <= 0 and value <= values[low]:
            low = k
        if direction >= 0 and values[high] - value >= least:
            if direction > 0 or ends[high] > found[-1]:
                found.append(int(ends[high]))
            direction, low = -1, k
        elif direction <= 0 and value - values[low] >= least:
            if direction < 0 or ends[low] > found[-1]:
                found.append(int(ends[low]))
            direction, high = 1, k
    if found[-1] != drive.size - 1:
        found.append(drive.size - 1)
    return np.array(sorted(set(found)), dtype=np.int64)


def directions(drive: FloatArray, turns: IntArray) -> FloatArray:
    """(N,) +1 where the drive rises (loading), -1 where it falls; 0 where it never moved.

    The sample at a turn belongs to the branch that ends there, and a hold to the movement
    before it.

    Args:
        drive: (N,) in any unit.
        turns: its :func:`turning_points`.
    """
    signs = np.sign(np.diff(drive[turns]))
    branch = np.searchsorted(turns[1:-1], np.arange(drive.size), side="left")
    return np.asarray(signs[branch], dtype=np.float64)


def rests(drive: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Where the drive rests after a movement: first index, index after the last, sign moved.

    A rest has 8 samples or more within 1 % of the drive's range, and the drive moved by 5 % of
    the range or more since the rest before.
    """
    if drive.size < _LONG:
        nothing = np.zeros(0, dtype=np.int64)
        return nothing, nothing, np.zeros(0)
    spread = float(np.ptp(drive))
    # White noise on a measured drive: its second differences have a deviation of sqrt(6) sigma.
    noise = float(np.median(np.abs(np.diff(drive, 2)))) / (0.6745 * np.sqrt(6.0))
    # On a fine ramp or a sine second differences are no noise, but then they are small.
    tolerance = _STILL * spread + 6.0 * min(noise, _STILL * spread)
    still = _over(np.maximum, drive) - _over(np.minimum, drive) <= tolerance
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
    first: list[int] = []
    last: list[int] = []
    sign: list[float] = []
    level = drive[0]
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        end = int(stop) + _LONG - 1
        # A slow ramp is still over any few samples, but not from its first to its last.
        if np.ptp(drive[start:end]) > 1.5 * tolerance:
            continue
        moved = float(drive[start] - level)
        level = float(np.median(drive[start:end]))
        if abs(moved) >= _MOVED * spread:
            first.append(int(start))
            last.append(end)
            sign.append(float(np.sign(moved)))
    return np.array(first, dtype=np.int64), np.array(last, dtype=np.int64), np.array(sign)


def _over(larger: np.ufunc, values: FloatArray) -> FloatArray:
    """The largest (or smallest) of each 8 samples in a row: of 2, of 2 such, of 2 of those."""
    for apart in (1, 2, 4):
        values = larger(values[:-apart], values[apart:])
    return values
