"""Readings that look wrong: which they are, and a sentence about them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from piezo_opt.measurement.arrays import FloatArray, IndexArray
from piezo_opt.units import show

_LONE, _FAR, _VISIBLE = 5.0, 10.0, 0.01
"""A reading stands alone where it is off what is around it by so many times what all but one in a
thousand are, by so many times the median third difference, and by so large a share of the range."""
_AROUND = 3
"""Samples on either side in which the drive must not move more than it usually does."""


def outlier_remarks(
    time: FloatArray, drive: FloatArray, reading: FloatArray, unit: str
) -> Iterator[str]:
    """On readings that neither what comes before nor what comes after leads to."""
    alone = lone_readings(drive, reading)
    if alone.size:
        first = int(alone[0])
        many = alone.size > 1
        yield (
            f"{alone.size} reading{'s' if many else ''} stand{'' if many else 's'} alone, far off "
            f"what comes before and after, {'the first ' if many else ''}at {time[first]:g} s "
            f"(sample {first + 1}, {show(float(reading[first]), unit)}): a fit bends to reach "
            f"{'them' if many else 'it'}; leave {'those rows' if many else 'that row'} out, or "
            "give the identification a robust loss."
        )


def lone_readings(drive: FloatArray, reading: FloatArray) -> IndexArray:
    """Indices of readings that stand alone while the drive moves no more than usual.

    Every reading but two at either end is compared with the cubic through the two before and the
    two after it. A jump and a peak are off that as well, but there the neighbours differ, or rise
    with it. A record that rings or steps has many such readings, and none stands alone.

    Args:
        drive: (N,) in any unit.
        reading: (N,) in any unit.

    Returns:
        indices in order; none for fewer than 16 samples.
    """
    n = reading.size
    if n < 16:
        return np.zeros(0, dtype=np.intp)
    off = np.zeros(n)
    near, beyond = reading[1:-3] + reading[3:-1], reading[:-4] + reading[4:]
    off[2:-2] = np.abs(reading[2:-2] - (4.0 * near - beyond) / 6.0)
    unlike = np.maximum(np.abs(reading[3:-1] - reading[1:-3]), np.abs(near - beyond))
    off[2:-2][unlike > 0.5 * off[2:-2]] = 0.0
    most = max(3, n // 1000)
    order = np.argpartition(-off, most)
    least = max(
        _LONE * float(off[order[most]]), _FAR * float(np.median(np.abs(np.diff(reading, 3)))),
        _VISIBLE * float(np.ptp(reading)),
    )  # fmt: skip
    moves = np.abs(np.diff(drive))
    usual = 2.0 * float(np.quantile(moves, 0.9))
    found = [
        k for k in order[:most]
        if off[k] > least and moves[max(0, k - _AROUND) : k + _AROUND].max() <= usual
    ]  # fmt: skip
    return np.sort(np.array(found, dtype=np.intp))
